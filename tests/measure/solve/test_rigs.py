"""Stranger rigs keep what they say they keep: places, lengths, the truth of the motion."""

from __future__ import annotations

import numpy as np
import pytest

from data_schemas.motion import fault_of_skeleton
from stages.measure.solve.rigs import RIGS, Rigged, with_other_proportions
from stages.shared.kinematics.forward import positions_of
from tests.shared.inference.examples import humanoid, swinging


def rigged(above: bool = False) -> Rigged:
    skeleton = humanoid(above=above)
    return Rigged(skeleton, swinging(skeleton, 20))


@pytest.mark.parametrize("above", [False, True])
@pytest.mark.parametrize("name", list(RIGS))
def test_rigs_are_skeletons_and_motions(name: str, above: bool):
    before = rigged(above)
    after = RIGS[name](before, np.random.default_rng(0))
    assert fault_of_skeleton(after.skeleton) is None
    assert len(set(after.skeleton.names)) == after.skeleton.joints
    assert after.motion.rotations.shape == (20, after.skeleton.joints, 4)
    np.testing.assert_allclose(np.linalg.norm(after.motion.rotations, axis=-1), 1, atol=1e-5)
    assert ((after.motion.rotations[1:] * after.motion.rotations[:-1]).sum(-1) > 0).all()
    assert after.skeleton.names[after.skeleton.root] == "pelvis"
    # The legs, which no new spine bends, are where they were; twists and axes leave all where it was.
    still = [n for n in before.skeleton.names if "leg" in n or "shin" in n]
    if name in ("twist-joints", "fingers", "other-axes"):
        still = list(before.skeleton.names)
    places = [
        positions_of(r.skeleton, r.motion)[:, [r.skeleton.names.index(n) for n in still]] for r in (before, after)
    ]
    np.testing.assert_allclose(places[1], places[0], atol=1e-5)
    lengths = [np.linalg.norm(r.skeleton.tails[r.skeleton.sampled], axis=1).sum() for r in (before, after)]
    assert lengths[1] == pytest.approx(lengths[0])


def test_new_joints_are_where_they_are_said_to_be():
    before = rigged()
    spine = RIGS["extra-spine"](before, np.random.default_rng(0)).skeleton
    assert spine.joints == 14 and {"pelvis_mid", "chest_mid"} <= set(spine.names)
    assert spine.parents[spine.names.index("chest")] == spine.names.index("pelvis_mid")
    assert spine.parents[spine.names.index("left_leg")] == spine.root
    twist = RIGS["twist-joints"](before, np.random.default_rng(0))
    joint = twist.skeleton.names.index("left_leg_twist")
    above = twist.skeleton.parents[joint]
    np.testing.assert_allclose(twist.motion.rotations[:, joint], twist.motion.rotations[:, above], atol=1e-6)
    fingers = RIGS["fingers"](before, np.random.default_rng(0)).skeleton
    assert fingers.joints == 12 + 16 and not fingers.sampled[12:].any()


def test_other_proportions_keep_every_rotation():
    before = rigged(above=True)
    after = with_other_proportions(before, np.random.default_rng(0))
    assert after.motion.rotations is before.motion.rotations
    ratio = np.linalg.norm(after.skeleton.tails, axis=1)[1:] / np.linalg.norm(before.skeleton.tails, axis=1)[1:]
    np.testing.assert_allclose(np.abs(np.log(ratio)), np.log(1.15), rtol=1e-6)
