"""Decompositions: every joint in one part, connectors shared, on rigs of different trees."""

from __future__ import annotations

import numpy as np
import pytest

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import BODY_GROUPS
from stages.shared.humanoid.body_parts import body_part, groups_of_part
from stages.shared.humanoid.decompositions import DECOMPOSITIONS

# CMU's body of 31 joints: pelvis, legs of five, spine of six, arms of seven.
_SPINE, _ARMS = [0, 11, 12, 13, 14, 15], [13, 17, 18, 19, 20, 21, 20, 13, 24, 25, 26, 27, 28, 27]
CMU_PARENTS = np.array([-1, 0, 1, 2, 3, 4, 0, 6, 7, 8, 9, *_SPINE, *_ARMS])
CMU_GROUPS = np.array([0, *[3] * 5, *[4] * 5, *[0] * 6, *[1] * 7, *[2] * 7])
# Arms on different joints of the spine; legs on a joint below the pelvis.
ODD_PARENTS = np.array([-1, 0, 1, 1, 0, 4, 5, 4, 5])
ODD_GROUPS = np.array([0, 0, 3, 4, 0, 0, 0, 1, 2])
BODIES = [(CMU_PARENTS, CMU_GROUPS), (ODD_PARENTS, ODD_GROUPS)]


@pytest.mark.parametrize(("parents", "groups"), BODIES)
@pytest.mark.parametrize("count", DECOMPOSITIONS)
def test_each_joint_belongs_to_one_part(parents: np.ndarray, groups: np.ndarray, count: int):
    parts = [body_part(name, parents, groups) for name in DECOMPOSITIONS[count]]
    assert len(parts) == count
    own = np.concatenate([part.own for part in parts])
    assert sorted(own.tolist()) == list(range(len(parents)))


@pytest.mark.parametrize(("parents", "groups"), BODIES)
@pytest.mark.parametrize("count", DECOMPOSITIONS)
def test_a_part_is_a_tree_of_its_own(parents: np.ndarray, groups: np.ndarray, count: int):
    for name in DECOMPOSITIONS[count]:
        part = body_part(name, parents, groups)
        assert part.parents[0] == -1 and (part.parents[1:] >= 0).all()
        for place in range(1, len(part.joints)):
            assert part.parents[place] < place
            assert part.joints[part.parents[place]] == parents[part.joints[place]]


def test_neighbours_share_one_joint_of_cmu_s_body():
    names = ("upper", "lower", "spine", "arms", "legs", "left_arm")
    parts = {name: body_part(name, CMU_PARENTS, CMU_GROUPS) for name in names}
    assert {name: len(part.joints) for name, part in parts.items()} == {
        "upper": 21, "lower": 11, "spine": 7, "arms": 15, "legs": 11, "left_arm": 8,
    }  # fmt: skip
    assert set(parts["upper"].joints) & set(parts["lower"].joints) == {0}
    assert set(parts["spine"].joints) & set(parts["arms"].joints) == {13}  # the thorax
    assert parts["spine"].connectors == 0 and parts["left_arm"].connectors == 1


def test_arms_on_two_joints_of_the_spine_share_both():
    arms = body_part("arms", ODD_PARENTS, ODD_GROUPS)
    assert arms.joints.tolist() == [4, 5, 7, 8] and arms.connectors == 2


def test_a_rig_without_an_arm_is_refused_in_one_sentence():
    keep = CMU_GROUPS != 1
    place = np.cumsum(keep) - 1
    parents = np.array([place[p] if p >= 0 else -1 for p in CMU_PARENTS[keep]])
    with pytest.raises(InputError, match="no joint of the left arm, which the part arms needs"):
        body_part("arms", parents, CMU_GROUPS[keep])


def test_an_unknown_part_is_refused_with_the_parts_that_there_are():
    with pytest.raises(UsageError, match=r"no body part 'tail'.*left_leg"):
        groups_of_part("tail")


def test_each_decomposition_has_every_body_group_once_in_the_project_s_words():
    for parts in DECOMPOSITIONS.values():
        assert sorted(group for groups in parts.values() for group in groups) == sorted(BODY_GROUPS)
    assert tuple(DECOMPOSITIONS[5]) == BODY_GROUPS
