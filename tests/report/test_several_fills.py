"""The page of several fills: what is played, and how far the fills are from each other and from the truth."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError, UsageError
from stages.report.config import Config
from stages.report.run import run
from stages.report.several_fills import several_fills, several_fills_html
from tests.report.pages import FRAMES, bvh_text, parsed

KEYS = "0,20,-1"


def raised(by_cm: float, *, between: tuple[int, ...] = (0, 20, FRAMES - 1)) -> str:
    """The recording with the root higher in all frames but the keys, which changes no distance between joints."""
    head, mark, rows = bvh_text().partition("Frame Time: ")
    first, *lines = rows.splitlines()
    moved = []
    for frame, line in enumerate(lines):
        x, y, *rest = line.split()
        moved.append(" ".join([x, y if frame in between else repr(float(y) + by_cm), *rest]))
    return "\n".join([head + mark + first, *moved, ""])


@pytest.fixture(scope="module")
def tries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tries")
    for number, by_cm in enumerate((2.0, -1.0, 5.0), 1):
        (folder / f"tries-{number}.bvh").write_text(raised(by_cm))
    (folder / "true.bvh").write_text(bvh_text())
    return folder


def config(tries: Path, **given: object) -> Config:
    settings = {"samples": (str(tries / "tries-*.bvh"),), "keyframes": KEYS, "output": tries / "page.html"}
    return Config.model_validate({**settings, **given})


def test_distances_are_those_of_the_joints(tries: Path) -> None:
    page = str(several_fills_html(several_fills(config(tries, truth=tries / "true.bvh"))))
    rows = [re.findall(r"<td[^>]*>([^<]*)</td>", row) for row in page.split("<tr")[2:]]
    assert [row[:3] for row in rows] == [
        ["tries-1", "30.0", "20.0"], ["tries-2", "45.0", "10.0"], ["tries-3", "45.0", "50.0"], ["truth", "", ""],
    ]  # fmt: skip
    assert "nearest fill from the truth" in page
    lines = [
        [tuple(map(float, pair.split(","))) for pair in text.split()] for text in re.findall(r'points="(.*?)"', page)
    ]
    assert [len(line) for line in lines] == [FRAMES] * 7  # three fills and the truth; two fills, first and nearest
    heights = np.array([[y for _, y in line] for line in lines])
    bottom = heights.max()
    keys = np.isin(np.arange(FRAMES), (0, 20, FRAMES - 1))
    np.testing.assert_allclose(heights[:, keys], bottom, atol=0.11)
    assert (heights[[1, 2, 3]][:, ~keys] < bottom - 5).all()


def test_the_page_plays_the_fills_over_the_truth_or_over_plain_interpolation(tries: Path) -> None:
    run(config(tries, truth=tries / "true.bvh"))
    _, scenes, text = parsed(tries / "page.html")
    assert [motion["name"] for motion in scenes[0]["motions"]] == ["truth", "tries-1", "tries-2", "tries-3"]
    assert scenes[0]["overlay"] and scenes[0]["keys"] == [0, 20, FRAMES - 1]
    run(config(tries, overwrite=True))
    _, scenes, text = parsed(tries / "page.html")
    assert scenes[0]["motions"][0]["name"] == "slerp" and "from the truth" not in text.partition("<script")[0]


def test_what_cannot_be_compared_is_refused(tries: Path, tmp_path: Path) -> None:
    one = str(tries / "tries-1.bvh")
    with pytest.raises(UsageError, match="names one"):
        several_fills(config(tries, samples=(one, one)))
    with pytest.raises(UsageError, match="No frame lies between"):
        several_fills(config(tries, keyframes="0:"))
    longer = tmp_path / "longer.bvh"
    longer.write_text(bvh_text().replace("Frame Time: 0.0333333", "Frame Time: 0.05"))
    with pytest.raises(InputError, match=r"longer\.bvh has 41 frames at 20 a second, and"):
        several_fills(config(tries, truth=longer))
    other = tmp_path / "other.bvh"
    other.write_text(bvh_text().replace("Head", "Skull"))
    with pytest.raises(InputError, match="another rig"):
        several_fills(config(tries, samples=(one, str(other))))
    with pytest.raises(UsageError, match="there are none"):
        run(config(tries, truth=other, samples=(), motions=("a=b",), output=tmp_path / "page.html"))
    assert not (tmp_path / "page.html").exists()


def test_fills_of_one_name_are_told_apart_by_their_folders(tries: Path, tmp_path: Path) -> None:
    (tmp_path / "tries-1.bvh").write_text(raised(3.0))
    found = several_fills(config(tries, samples=(str(tries / "tries-1.bvh"), str(tmp_path / "tries-1.bvh"))))
    assert found.names == [str(tries / "tries-1.bvh"), str(tmp_path / "tries-1.bvh")]
