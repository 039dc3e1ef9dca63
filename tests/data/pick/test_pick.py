"""Which clips are picked to be filled, and that they come out byte for byte."""

from __future__ import annotations

from pathlib import Path

import pytest

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from stages.data.pick.config import Config
from stages.data.pick.run import pick, run
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"


def row(clip: str, **changes: object) -> ClipRow:
    """A clip of the test split, four seconds long, with changes."""
    values = {
        "source": f"{clip}.bvh", "sha256": "", "skeleton": "s", "frames": 120, "fps": 30.0, "seconds": 4.0,
        "split": "test", "licence": "", "flags": "",
    }  # fmt: skip
    return ClipRow(clip=clip, **{**values, **changes})  # type: ignore[arg-type]


def picked(rows: list[ClipRow], **settings: object) -> list[str]:
    """Names of the clips that are picked."""
    return [each.clip for each in pick(rows, Config(motion=Path("m"), output=Path("o"), **settings))]  # type: ignore[arg-type]


def test_only_the_wanted_split_and_count():
    rows = [row("d"), row("c", split="train"), row("b"), row("a", split="val")]
    assert picked(rows) == ["b", "d"]
    assert picked(rows, count=1) == ["b"]
    assert picked(rows, splits=("train", "val")) == ["a", "c"]


def test_archives_and_skeletons_take_turns():
    rows = [row(f"a{n}", source=f"one.zip!a{n}.bvh") for n in range(5)] + [row("z", source="two.zip!z.bvh")]
    assert picked(rows, count=3) == ["a0", "z", "a1"]


def test_handy_clips_come_first():
    rows = [row("a", seconds=300.0), row("b", seconds=1.0), row("c", flags="unit-uncertain trimmed"), row("d")]
    assert picked(rows) == ["d", "a", "b"]
    rows += [row("e", flags="unit-uncertain")]  # ingest needs no option for it
    assert picked(rows) == ["d", "e", "a"]


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("picking") / "ingest"
    sources = tuple(str(CLIPS / f"{name}.bvh") for name in ("jump", "kick", "walk"))
    ingest(IngestConfig(sources=sources, splits=CLIPS / "splits.json", output=output, workers=1))
    return output


def test_files_come_out_as_they_were_and_stale_ones_go(motion: Path, tmp_path: Path):
    for name in ("old", "mine"):
        (tmp_path / f"{name}.bvh").write_text("stale")
    (tmp_path / "clips.txt").write_text("old.bvh\n../mine.bvh\n")
    with pytest.raises(UsageError, match="exists"):
        run(Config(motion=motion, output=tmp_path))
    report = run(Config(motion=motion, output=tmp_path, overwrite=True))
    assert not (tmp_path / "old.bvh").exists(), "an earlier pick"
    (tmp_path / "mine.bvh").unlink()  # no earlier pick, so it stayed
    assert (tmp_path / "clips.txt").read_text().splitlines() == [f"{name}.bvh" for name in report.figures["clips"]]
    found = {path.read_bytes() for path in tmp_path.glob("*.bvh")}
    assert found == {(CLIPS / f"{name}.bvh").read_bytes() for name in ("jump", "kick")}


def test_no_clip_of_the_split_is_bad_input(motion: Path, tmp_path: Path):
    with pytest.raises(InputError, match="val"):
        run(Config(motion=motion, output=tmp_path, splits=("val",)))
