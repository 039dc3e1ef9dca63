"""`pumps infill --method concepts`: transitions of a trained rig between whole keyframes, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError, UsageError
from stages.infill.config import Config
from stages.infill.run import run
from stages.shared.concepts.body_positions import body_of, body_positions
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.inference.concept_filling import concept_fill
from stages.shared.inference.filling import FillOptions
from stages.shared.inference.refining import load_concepts, sampled_transition

pytest.importorskip("sklearn")
from tests.shared.concepts.two_actions import CLIPS, train_two_actions

WALK = CLIPS / "walk.bvh"


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return train_two_actions(tmp_path_factory.mktemp("concepts"))


def filled(weights: Path, output: Path, **settings) -> list[Path]:
    config = Config(
        input=WALK, output=output, weights=str(weights), method="concepts", device="cpu",
        **({"keyframes": "every:20"} | settings),
    )  # fmt: skip
    run(config)
    return list(config.outputs_of(output))


def test_keys_stay_as_they_are_and_samples_differ(weights: Path, tmp_path: Path):
    paths = filled(weights, tmp_path / "out.bvh", samples=3)
    lines = WALK.read_bytes().splitlines()
    first = next(at for at, line in enumerate(lines) if line.startswith(b"Frame Time")) + 1
    keys = [first + frame for frame in (*range(0, len(lines) - first, 20), len(lines) - first - 1)]
    made = [path.read_bytes().splitlines() for path in paths]
    for each in made:
        assert [each[key] for key in keys] == [lines[key] for key in keys]
        assert len(each) == len(lines)
    assert made[0] != made[1] != made[2] != made[0]
    again = filled(weights, tmp_path / "again.bvh", samples=2)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in paths[:2]]


def test_rows_between_keys_are_not_read(weights: Path, tmp_path: Path):
    text = WALK.read_text().splitlines()
    first = next(at for at, line in enumerate(text) if line.startswith("Frame Time")) + 1
    text[first + 7] = " ".join("1" for _ in text[first].split())
    (tmp_path / "other.bvh").write_text("\n".join(text))
    config = {"weights": str(weights), "method": "concepts", "device": "cpu", "keyframes": "every:20"}
    run(Config(input=tmp_path / "other.bvh", output=tmp_path / "a.bvh", **config))
    run(Config(input=WALK, output=tmp_path / "b.bvh", **config))
    assert (tmp_path / "a.bvh").read_bytes().split() == (tmp_path / "b.bvh").read_bytes().split()


def test_joints_lie_where_the_transition_has_them(weights: Path):
    """Bones keep their lengths, so a joint is as near to its place as the lengths of the bones allow; the pelvis is
    exactly there."""
    model = load_concepts(weights, "cpu")
    skeleton, motion, _ = motion_of(read_bvh(WALK.read_bytes(), "walk"))
    motion, body = motion.at(slice(0, 25)), body_of(skeleton)
    known = np.zeros(25, bool)
    known[[0, 24]] = True
    made = concept_fill(model, skeleton, motion, known, options=FillOptions(ease_s=0.0)).motion
    truth = body_positions(skeleton, motion, body) * body.scale
    asked = sampled_transition(model, truth[0], truth[24], 24, None, fps=motion.fps) / body.scale
    places = body_positions(skeleton, made, body)
    np.testing.assert_allclose(places[:, 0], asked[:, 0], atol=1e-4)
    assert np.linalg.norm(places - asked, axis=-1).mean() < 0.03


@pytest.mark.parametrize(
    ("settings", "error", "says"),
    [
        ({"keyframes": "10,40"}, None, ""),  # rows outside of the keys are kept
        ({"keyframes": "every:20", "keep": ("legs:all",)}, UsageError, "whole keyframes"),
        ({"keyframes": None, "predict": 10}, UsageError, "from one keyframe to another"),
        ({"weights": "small-free"}, UsageError, "checkpoint of a rig"),
    ],
)
def test_what_it_does_not_fill_is_refused(
    weights: Path, tmp_path: Path, settings: dict, error: type[Exception] | None, says: str
):
    out = tmp_path / "out.bvh"
    named = Path(settings.pop("weights", weights))
    if error is None:
        assert filled(named, out, **settings)[0].is_file()
        return
    with pytest.raises(error, match=says):
        filled(named, out, **settings)
    assert not out.exists()


def test_another_rig_is_refused(weights: Path):
    model = load_concepts(weights, "cpu")
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / "walk.bvh").read_bytes(), "walk"))
    model = type(model)(**{**vars(model), "names": model.names[::-1]})
    known = np.zeros(motion.frames, bool)
    known[[0, -1]] = True
    with pytest.raises(InputError, match="another rig"):
        concept_fill(model, skeleton, motion, known)
