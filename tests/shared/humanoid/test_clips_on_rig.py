"""Clips on one rig: the rotations put the joints where they were, corresponding rigs, retargeted ones, rates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.shared.humanoid.clips_on_rig import (
    STATURE_M,
    body_joints_of,
    clips_on_rig,
    is_corresponding,
    rig_of_clips,
)
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.matrix_poses import global_matrices, positions_of_matrices
from stages.shared.kinematics.rotations import matrices
from tests.docs.pages import ROOT
from tests.train.body_parts.small_parts import ingested


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ingested(tmp_path_factory.mktemp("rig"))


def test_local_rotations_and_scaled_offsets_give_the_joints_back(motion: Path):
    with MotionReader(motion) as reader:
        skeleton, stature = rig_of_clips(reader, reader.clips)
        body = body_joints_of(skeleton, stature)
        clips, notes = clips_on_rig(reader, reader.clips, body, 30.0, 16)
        assert not notes and len(clips) == 3
        for clip in clips:
            whole = global_matrices(matrices(torch.from_numpy(clip.local)), body.parents)
            found = positions_of_matrices(whole, torch.from_numpy(body.offsets), body.parents).numpy()
            wanted = positions_of(skeleton, reader.motion(clip.row.clip))[:, body.joints]
            np.testing.assert_allclose(found, body.scale * (wanted - wanted[:, :1]), atol=2e-5)


def test_the_scaled_body_is_1_80_m_tall(motion: Path):
    with MotionReader(motion) as reader:
        skeleton, stature = rig_of_clips(reader, reader.clips)
        body = body_joints_of(skeleton, stature)
        walk = next(row for row in reader.clips if "walk" in row.clip)
        places = body.scale * positions_of(skeleton, reader.motion(walk.clip))
    legs_and_spine = np.isin(skeleton.groups, (0, 3, 4))
    assert np.ptp(places[:, legs_and_spine, 1], axis=1).max() == pytest.approx(STATURE_M, rel=0.05)


def test_other_lengths_and_names_correspond_and_other_directions_do_not(motion: Path):
    with MotionReader(motion) as reader:
        skeleton, _ = rig_of_clips(reader, reader.clips)
    longer = replace(skeleton, offsets=1.3 * skeleton.offsets, names=tuple(f"x_{n}" for n in skeleton.names))
    assert is_corresponding(longer, skeleton)
    turned = skeleton.offsets.copy()
    turned[:] = turned[:, [1, 0, 2]]
    assert not is_corresponding(replace(skeleton, offsets=turned), skeleton)


def test_a_clip_of_another_rig_is_retargeted_and_told(motion: Path, tmp_path: Path):
    head, _, row = (ROOT / "docs" / "examples" / "other_rig.bvh").read_text().strip().rpartition("\n")
    other = tmp_path / "other_rig.bvh"
    other.write_text("\n".join([head.replace("Frames: 1", "Frames: 40"), *[row] * 40, ""]))
    ingest(IngestConfig(sources=(str(other),), output=tmp_path / "other", licence="CC0", workers=1))
    with MotionReader(motion) as reader, MotionReader(tmp_path / "other") as others:
        body = body_joints_of(*rig_of_clips(reader, reader.clips))
        clips, notes = clips_on_rig(others, others.clips, body, 30.0, 16)
    assert clips[0].retargeted and clips[0].local.shape[1] == len(body.joints)
    assert "1 of 1 clips were retargeted to the rig." in notes


def test_every_other_frame_at_half_the_rate_and_interpolation_above_it(motion: Path):
    with MotionReader(motion) as reader:
        body = body_joints_of(*rig_of_clips(reader, reader.clips))
        (half, *_), told = clips_on_rig(reader, reader.clips, body, 15.0, 4)
        (double, *_), told_double = clips_on_rig(reader, reader.clips, body, 60.0, 4)
        (own, *_), _ = clips_on_rig(reader, reader.clips, body, 30.0, 4)
    assert not told and "interpolated to 60 frames a second, from 30" in told_double[0]
    assert len(half.local) == (len(own.local) + 1) // 2
    np.testing.assert_allclose(np.abs((double.local[::2] * own.local).sum(-1)), 1, atol=1e-5)


def test_clips_that_are_all_too_short_are_refused(motion: Path):
    with MotionReader(motion) as reader:
        body = body_joints_of(*rig_of_clips(reader, reader.clips))
        with pytest.raises(InputError, match=r"no clip of use.*3 shorter than a window"):
            clips_on_rig(reader, reader.clips, body, 30.0, 10_000)
        with pytest.raises(InputError, match="no clip of these splits"):
            rig_of_clips(reader, [])
