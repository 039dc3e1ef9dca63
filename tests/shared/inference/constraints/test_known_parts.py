"""What is given of each frame, on a rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import BODY_GROUPS
from stages.shared.inference.constraints.asked import Constraints, PartFrames
from stages.shared.inference.constraints.flags import constraints_of_flags
from stages.shared.inference.constraints.known_parts import known_parts, locked_joints
from stages.shared.inference.constraints.rig_parts import PARTS, end_effector, rig_part
from tests.shared.inference.examples import humanoid

T = 20


@pytest.mark.parametrize("above", [False, True])
def test_parts_cover_the_body_once(above):
    skeleton = humanoid(above=above)
    groups = [rig_part(skeleton, group, "keep").joints for group in BODY_GROUPS]
    assert np.array_equal(np.sum(groups, axis=0) > 0, skeleton.groups >= 0)
    upper, lower = (rig_part(skeleton, name, "keep") for name in ("upper_body", "lower_body"))
    assert not (upper.joints & lower.joints).any() and (upper.joints | lower.joints).all()
    assert lower.position and not upper.position
    both = rig_part(skeleton, "left_arm, right_arm", "keep").joints
    assert np.array_equal(both, rig_part(skeleton, "arms", "keep").joints)
    assert all(rig_part(skeleton, part, "keep") for part in PARTS)


def test_only_parts_with_keys_are_filled():
    skeleton = humanoid()
    found = known_parts(constraints_of_flags("arms=2,8,15"), skeleton, T)
    arms = rig_part(skeleton, "arms", "keep").joints
    assert found.joints[:, ~arms].all() and found.position.all()
    assert np.flatnonzero(found.whole).tolist() == [0, 1, 2, 8, *range(15, T)]


def test_keys_of_a_part_are_beside_those_of_the_body():
    skeleton = humanoid()
    found = known_parts(constraints_of_flags("2,15;arms=8", keep=["legs:4-6"]), skeleton, T)
    assert np.flatnonzero(found.whole).tolist() == [2, 15]
    assert not found.joints[[0, 1, 16, 19]].any()  # copied as they are, and not read
    arms, legs = (rig_part(skeleton, name, "keep").joints for name in ("arms", "legs"))
    assert np.flatnonzero(found.joints[:, arms].all(axis=1)).tolist() == [2, 8, 15]
    assert np.flatnonzero(found.joints[:, legs].all(axis=1)).tolist() == [2, 4, 5, 6, 15]
    assert np.flatnonzero(found.position).tolist() == [2, 15]


def test_errors_name_the_constraint():
    skeleton = humanoid()
    with pytest.raises(UsageError, match="which frames are keys"):
        known_parts(Constraints(keep=(PartFrames(part="legs"),)), skeleton, T)
    with pytest.raises(InputError, match="'wing'"):
        known_parts(constraints_of_flags("0,9", keep=["wing:all"]), skeleton, T)
    with pytest.raises(InputError, match="0-20"):
        known_parts(constraints_of_flags("0,9", keep=["legs:0-20"]), skeleton, T)
    without = replace(skeleton, groups=np.where(skeleton.groups == 1, 0, skeleton.groups))
    with pytest.raises(InputError, match="no left arm"):
        known_parts(constraints_of_flags("0,9", keep=["left_arm:all"]), without, T)
    with pytest.raises(UsageError, match="place"):
        locked_joints([PartFrames(part="root")], skeleton, T)
    with pytest.raises(InputError, match="no part of the body"):
        rig_part(skeleton, " , ", "keep")


def test_ends_of_limbs():
    skeleton = humanoid()
    hand = end_effector(skeleton, "left_hand", "pin")
    # The last joint of this arm is a forearm: its hand is the tail.
    assert skeleton.names[hand.joint] == "left_hand" and not hand.is_head
    assert [skeleton.names[joint] for joint in hand.limb(skeleton)] == ["left_arm", "left_hand"]
    finger = end_effector(skeleton, "left_finger", "pin")
    assert finger.is_head and [skeleton.names[joint] for joint in finger.limb(skeleton)] == ["left_arm", "left_hand"]
    with pytest.raises(InputError, match="tentacle"):
        end_effector(skeleton, "tentacle", "pin")
