"""`pumps measure motions`: zeros for the truth itself, known errors for known changes, refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import read_metrics
from data_schemas.motion import MotionWriter
from data_schemas.skeleton import Motion
from stages.measure.motions.config import Config
from stages.measure.motions.run import run
from stages.shared.kinematics.resampling import resample
from tests.shared.inference.examples import humanoid, swinging

SKELETON = humanoid()
TRUE = {f"clip{number}": swinging(SKELETON, 70, 60.0, seed=number) for number in range(3)}


def write(path: Path, motions: dict[str, Motion], skeleton=SKELETON) -> Path:
    with (
        write_artefact(path, "motion", stage="test", config={}, licences=["CC0"]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        name = writer.add_skeleton(skeleton)
        for clip, motion in motions.items():
            split = "train" if clip == "clip2" else "test"
            seconds = motion.frames / motion.fps
            row = ClipRow(
                clip, f"set.zip!{clip}.bvh", "0" * 64, name, motion.frames, motion.fps, seconds, split, "CC0"
            )
            writer.add_clip(row, motion)
    return path


def moved(motion: Motion, by: float) -> Motion:
    return replace(motion, root_positions=motion.root_positions + np.float32(by) * np.array([1, 0, 0], np.float32))


def test_known_errors(tmp_path):
    write(tmp_path / "truth", TRUE)
    write(tmp_path / "same", {clip: resample(motion, 30.0) for clip, motion in TRUE.items()})
    write(tmp_path / "moved", {clip: resample(moved(motion, 0.05), 30.0) for clip, motion in TRUE.items()})
    flipped = {clip: resample(replace(m, rotations=-m.rotations), 30.0) for clip, m in TRUE.items()}
    write(tmp_path / "flipped", flipped)
    made = tuple(f"{name}={tmp_path / name}" for name in ("same", "moved", "flipped"))
    report = run(Config(truth=tmp_path / "truth", made=made, window=20, output=tmp_path / "out"))
    assert report.figures == {"clips": 2, "windows": 2, "methods": ["same", "moved", "flipped"], "left_out": []}
    rows, page = read_metrics(tmp_path / "out")
    values = {(row.method, row.clip, row.metric): row.value for row in rows}
    for clip in ("clip0", "clip1"):
        assert all(values[method, clip, "mpjpe_mm"] < 1e-3 for method in ("same", "flipped"))
        assert values["flipped", clip, "mpjae_deg"] < 0.1  # q and -q are one rotation
        assert values["moved", clip, "mpjpe_mm"] == pytest.approx(50, rel=1e-3)
        assert values["moved", clip, "mpjve_mm"] < 0.01
        assert values["moved", clip, "l2p_m"] == pytest.approx(0.05 * np.sqrt(SKELETON.sampled.sum()), rel=1e-3)
    assert ("same", "clip2", "mpjpe_mm") not in values  # another split
    assert "Reconstruction" in page and "key_jump_mm" not in {row.metric for row in rows}
    assert report.lines[1].startswith("moved: mpjpe_mm 50.0")


def test_clips_on_another_skeleton_are_left_out(tmp_path):
    write(tmp_path / "truth", TRUE)
    above = humanoid(above=True)
    with (
        write_artefact(tmp_path / "mixed", "motion", stage="test", config={}, licences=["CC0"]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for clip, skeleton in (("clip0", SKELETON), ("clip1", above)):
            row = ClipRow(clip, clip, "0" * 64, writer.add_skeleton(skeleton), 70, 60.0, 70 / 60, "test", "CC0")
            writer.add_clip(row, swinging(skeleton, 70, 60.0))
    report = run(Config(truth=tmp_path / "truth", made=(f"a={tmp_path / 'mixed'}",), output=tmp_path / "out"))
    assert report.figures["clips"] == 1 and report.figures["left_out"] == ["clip1"]
    assert any(line.startswith("1 shared clip") for line in report.lines)


@pytest.mark.parametrize(
    ("made", "error", "says"),
    [
        ((), UsageError, "nothing to measure"),
        (("truth",), UsageError, "NAME=MOTION"),
        (("a={0}/truth", "a={0}/truth"), UsageError, "NAME=MOTION"),
        (("a={0}/nowhere",), InputError, "nowhere"),
        (("a={0}/other",), InputError, "on the same joints"),
        (("a={0}/shorter",), InputError, "frames"),
        (("a={0}/strange",), InputError, "share no clip"),
    ],
)
def test_refusals(tmp_path, made, error, says):
    write(tmp_path / "truth", TRUE)
    above = humanoid(above=True)
    write(tmp_path / "other", {"clip0": swinging(above, 70, 60.0)}, above)
    write(tmp_path / "shorter", {"clip0": swinging(SKELETON, 30, 60.0)})
    write(tmp_path / "strange", {"elsewhere": swinging(SKELETON, 30, 60.0)})
    named = tuple(each.format(tmp_path) for each in made)
    with pytest.raises(error, match=says):
        run(Config(truth=tmp_path / "truth", made=named, output=tmp_path / "out"))
    assert not (tmp_path / "out" / "manifest.json").exists()
