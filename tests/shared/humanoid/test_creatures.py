"""Creatures are refused with the reason, people are not, and the certainty of a body is the measured one."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.formats.source_body import SourcePoses, SourceRig, body_of, motion_of_poses
from stages.shared.humanoid.certainty import SURE_BY_NAMES, SURE_BY_SHAPE, sure_of_margin
from tests.shared.humanoid.creatures import CREATURES, Tree, creature
from tests.shared.humanoid.rig_changes import changed
from tests.shared.humanoid.written_rigs import WRITTEN, written_rig

PAGE = Path(__file__).parents[3] / "docs" / "evaluation.md"
ANIMALS = sorted(set(CREATURES) - {"tree"})


def refusal(rig: SourceRig, poses: SourcePoses) -> str:
    with pytest.raises(InputError) as caught:
        motion_of_poses(body_of(rig), poses)
    assert "--skeleton-map" in (caught.value.hint or "")
    return caught.value.message


@pytest.mark.parametrize("kind", ANIMALS)
def test_creatures_are_refused_under_their_names(kind: str) -> None:
    for seed in range(8):
        assert "is not a humanoid" in refusal(*creature(kind, seed))


@pytest.mark.parametrize("change", ["names", "order", "all"])
@pytest.mark.parametrize("kind", ANIMALS)
def test_creatures_are_refused_without_names(kind: str, change: str) -> None:
    for seed in range(4):
        rig, poses, _ = changed(*creature(kind, seed), change, np.random.default_rng(seed))
        assert "is not a humanoid" in refusal(rig, poses)


def test_a_crab_with_arms_and_legs_is_told_by_its_legs() -> None:
    assert re.search(r"\d legs on each side, such as Leg0_L_1", refusal(*creature("crab", 0)))


def is_taken(rig: SourceRig) -> bool:
    try:
        return bool(body_of(rig).parts.sure)
    except InputError:
        return False


def test_few_trees_are_taken_for_people() -> None:
    assert sum(is_taken(creature("tree", seed)[0]) for seed in range(40)) <= 8


@pytest.mark.parametrize("name", WRITTEN)
def test_people_are_as_sure_as_was_measured(name: str) -> None:
    written = written_rig(name)
    assert body_of(written.rig).parts.sure == SURE_BY_NAMES < 1
    for seed in range(3):
        nameless, poses, order = changed(written.rig, written.poses, "all", np.random.default_rng(seed))
        parts = body_of(nameless).parts
        assert parts.margin is not None and parts.sure == sure_of_margin(parts.margin) < 1
        assert (motion_of_poses(body_of(nameless), poses)[0].groups == written.groups[order]).all()


def with_joints(rig: SourceRig, joints: list[tuple[str, str, tuple[float, float, float]]]) -> SourceRig:
    """The rig with some joints more: name, parent, offset."""
    names, parents, offsets = list(rig.names), list(rig.parents), list(rig.offsets)
    for name, parent, offset in joints:
        parents.append(names.index(parent))
        names.append(name)
        offsets.append(offset)
    more = len(names) - len(rig.names)
    return replace(
        rig, names=tuple(names), parents=tuple(parents), offsets=tuple(offsets),
        end_sites=(*rig.end_sites, *[(0.0, 0.0, 0.0)] * more), placed=(*rig.placed, *[False] * more),
    )  # fmt: skip


def test_people_with_wings_a_tail_and_controls_are_people() -> None:
    rig = written_rig("mixamo").rig
    hips = rig.names[0]
    prefix = hips.removesuffix("Hips")
    extra = [("LeftFootControl", hips, (0.1, -0.9, 0.0)), ("RightFootControl", hips, (-0.1, -0.9, 0.0))]
    for side, sign in (("L", 1.0), ("R", -1.0)):
        extra += [(f"Wing_{side}1", f"{prefix}Spine2", (0.1 * sign, 0.1, -0.1)),
                  (f"Wing_{side}2", f"Wing_{side}1", (0.6 * sign, 0.2, -0.2))]  # fmt: skip
    extra += [("Tail1", hips, (0.0, 0.0, -0.1)), ("Tail2", "Tail1", (0.0, -0.1, -0.3))]
    parts = body_of(with_joints(rig, extra)).parts
    assert parts.sure == SURE_BY_NAMES
    expected = written_rig("mixamo").groups
    assert (parts.groups[: len(expected)] == expected).all()


def test_a_leg_is_never_a_head() -> None:
    """A body whose head is missing, with a leg-like joint on its chest: the spine ends at the chest."""
    tree = Tree(np.random.default_rng(0))
    hips = tree.add("Hips", -1, (0, 1, 0))
    chest = tree.chain("Spine", hips, (0, 0.2, 0), (0, 0.2, 0))
    tree.pair("UpLeg", hips, (0.1, 0, 0), (0, -0.4, 0), (0, -0.4, 0), (0, 0, 0.1))
    tree.pair("Arm", chest, (0.15, 0, 0), (0.3, 0, 0), (0.25, 0, 0))
    tree.chain("Leg_L_extra", chest, (0, 0.3, 0), (0, 0.3, 0))
    joints = len(tree.names)
    rig = SourceRig(
        tuple(tree.names), tuple(tree.parents), tuple(tree.offsets), ((0.0, 0.0, 0.0),) * joints,
        tuple(joint == 0 for joint in range(joints)),
    )  # fmt: skip
    assert body_of(rig).parts.chains[0][-1] == chest


def test_the_page_has_the_shares_that_are_printed() -> None:
    section = PAGE.read_text(encoding="utf-8").split("<!-- body-certainty: begin -->")[1]
    rows = re.findall(r"^\| (names|shape, margin from ([\d.]+)) \|.*\| ([\d.]+) \|$", section, flags=re.M)
    shares = [(float(least or 0), float(share)) for title, least, share in rows]
    assert shares == [(0.0, SURE_BY_NAMES), *SURE_BY_SHAPE]
    rising = [share for _, share in SURE_BY_SHAPE]
    assert rising == sorted(rising)
