"""What moves a latent, on embedded clips and the shipped weights: the changes are what they say, the figures too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.errors import InputError
from data_schemas.metrics import read_metrics
from data_schemas.motion import MotionReader
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.measure.latents import run as stage
from stages.measure.latents.changes import OriginalWindow, changes, unchanged
from stages.measure.latents.config import Config
from stages.measure.latents.run import run
from stages.shared.humanoid.rig_changes import RIGS, with_stiff_spine
from stages.shared.kinematics.forward import positions_of

CLIPS = Path(stage.__file__).resolve().parents[2] / "shared" / "clips"
FRAMES = 16


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("latents") / "motions"
    ingest(IngestConfig(sources=(str(CLIPS / "dance_b.bvh"), str(CLIPS / "kick.bvh")), output=path))
    return path


def config(motions: Path, output: Path, **more) -> Config:
    settings = {"splits": ("train", "val", "test"), "window": FRAMES, "max_windows": 2, "device": "cpu", **more}
    return Config(motion=motions, output=output, **settings)


@pytest.fixture(scope="module")
def original(motions: Path) -> OriginalWindow:
    with MotionReader(motions) as reader:
        return stage._original_windows(reader, config(motions, Path("unused")), 64)[0]


@pytest.fixture(scope="module")
def measured(motions: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], float]:
    """Means over clips, by change and metric."""
    output = tmp_path_factory.mktemp("measured") / "out"
    run(config(motions, output))
    rows, summary = read_metrics(output)
    assert all(f"| {change.name} |" in summary for change in changes())
    keys = {(row.method, row.metric) for row in rows}
    return {key: float(np.mean([r.value for r in rows if (r.method, r.metric) == key])) for key in keys}


def test_every_change_is_measured(measured):
    for change in changes():
        for metric in ("move_window", "move_any", "cosine", "frames_off", "found", "own_mm"):
            assert np.isfinite(measured[change.name, metric])
        assert ((change.name, "cross_mm") in measured) == change.same_cloud


def test_latents_go_with_time_and_a_frame_later_is_found_a_frame_later(measured):
    assert measured["1 frames later", "move_any"] < measured["5 frames later", "move_any"]
    assert measured["1 frames later", "frames_off"] == pytest.approx((FRAMES - 1) / FRAMES)
    assert measured["1 frames later", "found"] == 1


def test_points_spread_evenly_move_latents_less_than_points_drawn(measured):
    assert measured["points spread evenly, anew", "move_any"] < 0.8 * measured["points redrawn", "move_any"]
    assert measured["points spread evenly, anew", "cosine"] > measured["points redrawn", "cosine"]


def test_other_axes_of_the_joints_are_far_less_than_another_draw(measured):
    """Offsets are spread in the bones' frames, which turn with the axes: more than nothing."""
    assert measured["rig: other-axes, spread", "move_any"] < 0.7 * measured["points redrawn", "move_any"]


def test_a_half_turn_moves_latents_more_than_other_points(measured):
    assert measured["turned by 180 degrees, same draw", "move_any"] > 1.5 * measured["points redrawn", "move_any"]


def test_changes_change_what_they_say(original):
    base = unchanged(original).cloud
    applied = {change.name: change.apply(original, np.random.default_rng(0)) for change in changes()}
    torch.testing.assert_close(applied["5 frames later"].cloud[:-5], base[5:])
    torch.testing.assert_close(applied["turned by 180 degrees, same draw"].cloud[..., 1], base[..., 1])
    torch.testing.assert_close(applied["turned by 180 degrees, same draw"].cloud[..., 0], -base[..., 0])
    torch.testing.assert_close(
        applied["turned by 15 degrees, same draw"].cloud.norm(dim=-1), base.norm(dim=-1), atol=1e-5, rtol=1e-5
    )
    bones = original.bones.cloud(replace(original.drawn, sigma_m=0.0))
    near, far = ((applied[f"sigma {s:g} m, same draw"].cloud - bones).norm(dim=-1) for s in (0.025, 0.075))
    torch.testing.assert_close(far, 3 * near, atol=1e-5, rtol=1e-4)
    assert applied["half the points"].cloud.shape[1] == 32
    assert applied["four times the points"].cloud.shape[1] == 256
    assert applied["points spread evenly, anew"].spread and not applied["points redrawn"].spread


@pytest.mark.parametrize("name", ["extra-spine", "twist-joints", "fingers", "other-axes"])
def test_changed_rigs_move_as_before(original, name):
    changed = RIGS[name](original.rigged, np.random.default_rng(0))
    before, after = (positions_of(each.skeleton, each.motion) for each in (original.rigged, changed))
    names, new = original.rigged.skeleton.names, changed.skeleton.names
    kept = [new.index(each) for each in names]
    tolerance = 0.06 if name == "extra-spine" else 1e-4  # a spine that bends in more places is a little shorter
    if name != "twist-joints":
        assert np.abs(after[:, kept] - before).max() < tolerance
    assert len(new) >= len(names)


def test_a_stiff_spine_is_rigid_and_leaves_the_legs_alone(original):
    stiff = with_stiff_spine(original.rigged)
    skeleton = original.rigged.skeleton
    before, after = positions_of(skeleton, original.rigged.motion), positions_of(skeleton, stiff.motion)
    legs = np.flatnonzero(skeleton.groups >= 3)
    np.testing.assert_allclose(after[:, legs], before[:, legs], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(stiff.motion.rotations, axis=-1), 1, atol=1e-5)


def test_motions_are_retargeted_to_the_other_skeletons(original):
    grown = RIGS["extra-spine"](original.rigged, np.random.default_rng(0))
    named = {change.name: change for change in changes({"grown": grown, "same": original.rigged})}
    rng = np.random.default_rng(0)
    moved = named["retargeted to grown, spread"].apply(original, rng)
    assert moved is not None and moved.cloud.shape == (FRAMES, 64, 3)
    assert named["retargeted to same, spread"].apply(original, rng) is None
    assert not any("retargeted" in change.name for change in changes())


def test_what_cannot_be_measured_is_said(motions, tmp_path):
    with pytest.raises(InputError, match="no clip of 5000 frames"):
        run(config(motions, tmp_path / "x", window=5000))
    with pytest.raises(InputError, match="no weights"):
        run(config(motions, tmp_path / "x", weights="nowhere"))
