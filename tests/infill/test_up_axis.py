"""`--up-axis` of infill and `up_axis` of pumps.load: what the user says wins over what the poses show."""

from __future__ import annotations

from pathlib import Path

import pytest

import pumps
from data_schemas.errors import UsageError
from stages.infill.config import Config
from stages.infill.run import run
from stages.shared.formats.bvh import read_bvh
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.inference.examples import write_random_weights

FRAMES = 31
KEYS = "0,15,30"


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_random_weights(tmp_path_factory.mktemp("weights")))


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """A body that stands along Y in its file."""
    path = tmp_path / "walk.bvh"
    path.write_bytes(BvhText(frames=FRAMES).data())
    return path


def filled(path: Path, weights: str, **options: object) -> bytes:
    output = path.with_name("out.bvh")
    settings = {"keyframes": KEYS, "weights": weights, "points": 32, "device": "cpu", "overwrite": True, **options}
    run(Config(input=path, output=output, **settings))  # type: ignore[arg-type]
    return output.read_bytes()


def test_infill_takes_the_axis_that_it_is_given(walk: Path, weights: str) -> None:
    found, same, other = (filled(walk, weights, **more) for more in ({}, {"up_axis": "y"}, {"up_axis": "z"}))
    assert found == same != other
    before, after = read_bvh(walk.read_bytes(), "in"), read_bvh(other, "out")
    assert after.header == before.header and all(after.rows[key] == before.rows[key] for key in (0, 15, 30))


def test_the_axis_that_the_poses_show_may_be_given_too(tmp_path: Path, weights: str) -> None:
    path = tmp_path / "z.bvh"
    path.write_bytes(BvhText(frames=FRAMES, z_up=True).data())
    found, same, other = (filled(path, weights, **more) for more in ({}, {"up_axis": "z"}, {"up_axis": "y"}))
    assert found == same != other


@pytest.mark.parametrize("axis", ["y", "z"])
def test_load_takes_it_and_fills_as_the_command_does(walk: Path, weights: str, axis: str) -> None:
    motion = pumps.load(walk, up_axis=axis)
    assert motion.skeleton.up_axis == axis
    head, foot = motion.names.index("Head"), motion.names.index("LeftFoot")
    height = (motion.positions[:, head, 1] - motion.positions[:, foot, 1]).mean()
    assert (height > 1) == (axis == "y")
    again = pumps.infill(motion, KEYS, weights=weights, points=32, device="cpu")
    assert again.skeleton.up_axis == axis and again.source == filled(walk, weights, up_axis=axis)
    pumps.save(again, walk.with_name("saved.bvh"))
    assert walk.with_name("saved.bvh").read_bytes() == again.source
    twice = pumps.infill(again, KEYS, weights=weights, points=32, device="cpu")
    assert twice.source == again.source


def test_other_axes_are_refused(walk: Path) -> None:
    with pytest.raises(UsageError, match="up_axis is 'x'"):
        pumps.load(walk, up_axis="x")
    with pytest.raises(ValueError, match="up_axis"):
        Config(input=walk, output=walk, up_axis="x")  # type: ignore[arg-type]
