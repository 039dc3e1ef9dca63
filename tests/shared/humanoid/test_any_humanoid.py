"""A body is found on every rig, whatever its joints are called, its bones measure, and which way it is turned."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from data_schemas.skeleton import Skeleton
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import rig_and_poses
from stages.shared.formats.source_body import SourcePoses, SourceRig, body_of, motion_of_poses
from stages.shared.humanoid.anatomy import RigAnatomy, anatomy_of
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.humanoid.rig_changes import changed, renamed, resized, shuffled, turned, with_other_axes
from tests.shared.humanoid.written_rigs import WRITTEN, WrittenRig, standing, written_rig

CHANGES = ("names", "lengths", "order", "world", "axes", "all")


def _found(rig: SourceRig, poses: SourcePoses) -> Skeleton:
    return motion_of_poses(body_of(rig), poses)[0]


@lru_cache
def _written(name: str) -> WrittenRig:
    return written_rig(name)


def _anatomy(rig: SourceRig, poses: SourcePoses) -> RigAnatomy:
    skeleton, motion, _ = motion_of_poses(body_of(rig), poses)
    return anatomy_of(skeleton, positions_of(skeleton, motion), motion.rotations.astype(float), 1 / motion.fps)


@pytest.mark.parametrize("name", WRITTEN)
def test_names_of_every_house_tell_the_groups(name: str) -> None:
    written = _written(name)
    skeleton, _, notes = motion_of_poses(body_of(written.rig), written.poses)
    wrong = np.flatnonzero(skeleton.groups != written.groups)
    assert not [(skeleton.names[j], skeleton.groups[j]) for j in wrong]
    assert not notes and skeleton.up_axis == "y" and skeleton.unit_m == 1.0


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", WRITTEN)
def test_groups_without_names_are_those_the_names_tell(name: str, change: str) -> None:
    written = _written(name)
    expected = _found(written.rig, written.poses)
    for seed in range(2):
        rig, poses, order = changed(written.rig, written.poses, change, np.random.default_rng(seed))
        found = _found(rig, poses)
        assert found.groups.tolist() == written.groups[order].tolist()
        assert order[found.root] == expected.root


@pytest.mark.parametrize("name", WRITTEN)
def test_a_rig_that_only_stands_there_is_enough(name: str) -> None:
    still = standing(_written(name))
    assert _found(*renamed(still.rig, still.poses)).groups.tolist() == still.groups.tolist()


@pytest.mark.parametrize("name", ["lafan1", "mixamo", "smplx", "vicon"])
def test_feet_may_be_missing(name: str) -> None:
    """Where legs end at the ankle, knees and elbows tell what is forward."""
    written = _written(name)
    rig, poses = renamed(written.rig, written.poses)
    feet = [j for j, old in enumerate(written.rig.names) if any(w in old.lower() for w in ("toe", "foot"))]
    drop = [j for j in feet if rig.parents[j] in feet or name == "smplx"]
    kept = [j for j in range(len(rig.names)) if j not in drop]
    place = {old: new for new, old in enumerate(kept)}
    cut = SourceRig(
        tuple(rig.names[j] for j in kept), tuple(place.get(rig.parents[j], -1) for j in kept),
        tuple(rig.offsets[j] for j in kept), tuple(rig.end_sites[j] for j in kept),
        tuple(rig.placed[j] for j in kept),
    )  # fmt: skip
    found = _found(cut, replace(poses, local=poses.local[:, kept]))
    assert found.groups.tolist() == written.groups[kept].tolist()


@pytest.mark.parametrize("name", WRITTEN)
def test_pairs_ends_and_facing(name: str) -> None:
    written = _written(name)
    named = _anatomy(written.rig, written.poses)
    assert named.rest == "T-pose" and named.facing[2] > 0.97 and 1.4 < named.stature_m < 1.9
    assert named.findings["groups"].how == "names" and not named.sides_look_swapped
    lefts = {left: right for left, right in named.pairs}
    for joint in np.flatnonzero(np.isin(written.groups, (1, 3))):
        partner = lefts[int(joint)]
        assert written.groups[partner] == written.groups[joint] + 1
        mirror = np.array(written.rig.offsets[joint]) * (-1, 1, 1)
        assert np.allclose(written.rig.offsets[partner], mirror, atol=1e-9)
    bare = _anatomy(*renamed(written.rig, written.poses))
    assert bare.findings["groups"].how == "shape" and bare.findings["sides"].how == "pose"
    assert bare.facing[2] > 0.97 and bare.findings["facing"].sure > 0.3
    limbs = [pair for pair in named.pairs if written.groups[pair[0]] > 0]
    assert [pair for pair in bare.pairs if written.groups[pair[0]] > 0] == limbs
    assert {k: bare.end_effectors[k] for k in ("left_foot", "head")}.keys() <= named.end_effectors.keys()


def test_swapped_sides_are_noticed() -> None:
    written = _written("lafan1")
    swap = {"Left": "Right", "Right": "Left"}
    names = tuple(swap.get(n[:4], swap.get(n[:5], "")) + n[4 if n[:4] == "Left" else 5 :] if n[:4] in ("Left", "Righ")
                  else n for n in written.rig.names)  # fmt: skip
    assert "RightUpLeg" in names
    assert _anatomy(replace(written.rig, names=names), written.poses).sides_look_swapped


# --- what is not a humanoid ------------------------------------------------------------------------


def _rig(joints: list[tuple[int, tuple[float, float, float]]]) -> tuple[SourceRig, SourcePoses]:
    count = len(joints)
    rig = SourceRig(
        tuple(f"j{j}" for j in range(count)), tuple(parent for parent, _ in joints), tuple(at for _, at in joints),
        ((0.0, 0.0, 0.0),) * count, (True,) + (False,) * (count - 1),
    )  # fmt: skip
    return rig, SourcePoses(np.tile((0.0, 0.0, 0.0, 1.0), (3, count, 1)), np.zeros((3, 3)), 30.0)


def _dog() -> list[tuple[int, tuple[float, float, float]]]:
    joints: list[tuple[int, tuple[float, float, float]]] = [(-1, (0, 0, 0)), (0, (0, 0, 0.25)), (1, (0, 0.02, 0.25))]
    joints += [(2, (0, 0.12, 0.12)), (3, (0, 0.1, 0.1)), (4, (0, -0.02, 0.12))]
    joints += [(0, (0, 0, -0.08)), (6, (0, -0.05, -0.15)), (7, (0, -0.05, -0.15))]
    for side in (1, -1):
        for parent, last in ((0, -0.02), (2, 0.0)):
            joints.append((parent, (0.08 * side, -0.03, 0)))
            for bone in ((0.0, -0.17, 0.04), (0.0, -0.17, -0.04 + last), (0, -0.1, 0), (0, -0.02, 0.06)):
                joints.append((len(joints) - 1, bone))
    order = sorted(range(len(joints)), key=lambda j: (joints[j][0] >= 0, j))
    return [joints[j] for j in order]


def _chain(count: int) -> list[tuple[int, tuple[float, float, float]]]:
    return [(j - 1, (0.0, 0.0, 0.1)) for j in range(count)]


def _hand() -> list[tuple[int, tuple[float, float, float]]]:
    joints = [(-1, (0.0, 0.0, 0.0)), (0, (0.0, 0.0, 0.25))]
    for finger in range(5):
        parent = 1
        for _ in range(4):
            joints.append((parent, (0.02 * (finger - 2), 0.0, 0.03)))
            parent = len(joints) - 1
    return joints


def _spider(legs: int) -> list[tuple[int, tuple[float, float, float]]]:
    joints = [(-1, (0.0, 0.0, 0.0)), (0, (0.0, 0.0, 0.1))]
    for leg in range(legs):
        parent = 1
        for _ in range(4):
            joints.append((parent, (np.cos(leg), 0.1, np.sin(leg))))
            parent = len(joints) - 1
    return joints


def _insect() -> list[tuple[int, tuple[float, float, float]]]:
    joints = [(-1, (0.0, 0.0, 0.0)), (0, (0.0, 0.0, 0.3)), (1, (0.0, 0.0, 0.3)), (2, (0.0, 0.0, 0.2))]
    for body in range(3):
        for side in (-1.0, 1.0):
            parent = body
            for _ in range(3):
                joints.append((parent, (0.3 * side, -0.1, 0.0)))
                parent = len(joints) - 1
    return joints


@pytest.mark.parametrize(
    ("joints", "reason"),
    [
        (_dog(), "times as long as its legs"),
        (_chain(12), "one chain of 12 joints"),
        (_chain(1), "only 1 joint"),
        (_hand(), "5 similar branches at j1"),
        (_spider(8), "8 similar branches"),
        (_insect(), "more than two pairs of limbs"),
        ([(-1, (0, 0, 0)), *[(0, (x, -0.4, z)) for x in (0.3, -0.3) for z in (0.3, -0.3)]], "no two branches"),
        ([*_chain(6), (2, (0.3, 0, 0)), (6, (0.3, 0, 0)), (2, (-0.3, 0, 0)), (8, (-0.3, 0, 0))], "one pair of limbs"),
    ],
    ids=["quadruped", "snake", "prop", "hand", "spider", "insect", "table", "fish"],
)
def test_what_is_no_humanoid_is_refused_with_the_reason(
    joints: list[tuple[int, tuple[float, float, float]]], reason: str
) -> None:
    with pytest.raises(InputError, match=reason) as caught:
        _found(*_rig(joints))
    assert "not a humanoid" in caught.value.message and "--skeleton-map" in (caught.value.hint or "")


def test_a_quadruped_is_refused_however_it_is_written_down() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        rig, poses, _ = shuffled(*with_other_axes(*turned(*resized(*_rig(_dog()), rng), rng), rng), rng)
        with pytest.raises(InputError, match="not a humanoid"):
            _found(rig, poses)


def test_a_man_on_all_fours_is_still_a_man() -> None:
    """His rest pose stands upright, so that what he does now counts for nothing."""
    written = _written("lafan1")
    rig, poses = renamed(written.rig, written.poses)
    local = poses.local.copy()
    bend = np.array((np.sin(np.pi / 4), 0, 0, np.cos(np.pi / 4)))
    local[:, 0] = bend
    for joint, name in enumerate(written.rig.names):
        if name.endswith(("UpLeg", "Arm")) and "Fore" not in name:
            local[:, joint] = -bend * (1, 0, 0, -1)
    assert _found(rig, replace(poses, local=local)).groups.tolist() == written.groups.tolist()


def test_a_wide_and_deep_tree_takes_no_time() -> None:
    rng = np.random.default_rng(0)
    comb = [
        (-1, (0.0, 0.0, 0.0)),
        *[(max(0, j - 1 - (j % 2)), tuple(rng.uniform(0.5, 1, 3))) for j in range(1, 4000)],
    ]
    fan = [
        (-1, (0.0, 0.0, 0.0)),
        *[(0 if j < 2000 else j - 1999, tuple(rng.uniform(0.5, 1, 3))) for j in range(1, 4000)],
    ]
    for joints in (comb, fan):
        with pytest.raises(InputError, match="not a humanoid"):
            _found(*_rig(joints))  # type: ignore[arg-type]


@pytest.mark.parametrize("clip", ["walk", "crawl", "getup_facedown"])
def test_a_figure_of_thirteen_joints_without_names(clip: str) -> None:
    """The embedded clips' figure: no hands, no collars, one bone for the neck and head."""
    path = Path(__file__).parents[3] / "stages" / "shared" / "clips" / f"{clip}.bvh"
    rig, poses = rig_and_poses(read_bvh(path.read_bytes(), clip))
    named = _found(rig, poses)
    for seed in range(12):
        other, moved, order = changed(rig, poses, "all", np.random.default_rng(seed))
        assert _found(other, moved).groups.tolist() == named.groups[order].tolist()
