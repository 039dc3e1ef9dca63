"""Skeleton maps: printed, read back, used; all faults of a map are reported at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.skeleton_map import SkeletonMap, choose_map, read_skeleton_map, text_of_anatomy
from stages.shared.formats.source_body import body_of, motion_of_poses
from stages.shared.humanoid.anatomy import anatomy_of
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.humanoid.rig_changes import renamed
from tests.shared.humanoid.written_rigs import WRITTEN, written_rig


def _map(tmp_path: Path, text: str) -> SkeletonMap:
    path = tmp_path / "map.toml"
    path.write_text(text, encoding="utf-8")
    return read_skeleton_map(path)


@pytest.mark.parametrize("bare", [False, True], ids=["named", "nameless"])
@pytest.mark.parametrize("name", WRITTEN)
def test_what_is_printed_gives_the_same_skeleton_back(tmp_path: Path, name: str, bare: bool) -> None:
    written = written_rig(name)
    rig, poses = renamed(written.rig, written.poses) if bare else (written.rig, written.poses)
    skeleton, motion, _ = motion_of_poses(body_of(rig), poses)
    anatomy = anatomy_of(skeleton, positions_of(skeleton, motion), motion.rotations.astype(float), 1 / 30)
    given = _map(tmp_path, text_of_anatomy(anatomy, skeleton.names, skeleton.parents, "a\nfile.bvh"))
    assert not given.faults
    again = motion_of_poses(body_of(replace(rig, maps=(given,))), poses)[0]
    for field in ("groups", "sampled", "offsets", "tails"):
        assert np.array_equal(getattr(again, field), getattr(skeleton, field)), field
    assert (again.root, again.unit_m, again.up_axis) == (skeleton.root, skeleton.unit_m, skeleton.up_axis)


CHAINS = """[chains]
spine = ["Hips", "Head"]
left_arm = ["RightShoulder", "RightHand"]
right_arm = ["LeftShoulder", "LeftHand"]
left_leg = ["RightUpLeg", "RightToe"]
right_leg = ["LeftUpLeg", "LeftFoot"]
"""


def test_a_map_overrides_what_is_found(tmp_path: Path) -> None:
    """Sides swapped against the names, a toe and a forearm in other groups, unit and up axis overridden."""
    text = 'unit_m = 0.02\nup = "z"\noutside = ["Neck"]\n' + CHAINS.replace(', "Head"', ', "Chest"')
    text += '[beside]\nspine = ["LeftToe"]\n'
    bvh = read_bvh(BvhText().data(), "a")
    skeleton = motion_of(bvh, skeleton_maps=(_map(tmp_path, text),))[0]
    group = {n: BODY_GROUPS[g] if g >= 0 else None for n, g in zip(skeleton.names, skeleton.groups, strict=True)}
    assert group["RightForeArm"] == "left_arm" and group["LeftLeg"] == "right_leg" and group["LeftToe"] == "spine"
    assert group["Neck"] is None and group["Head"] is None and group["Chest"] == "spine"
    seen = dict(zip(skeleton.names, skeleton.sampled, strict=True))
    assert seen["RightToe"] and not seen["LeftToe"] and not seen["Head"]
    assert (skeleton.unit_m, skeleton.up_axis) == (0.02, "z")


def test_a_map_makes_an_unrecognised_rig_readable(tmp_path: Path) -> None:
    names = {name: f"b{i}" for i, name in enumerate(("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToe"))}
    text = BvhText(names=names).data().replace(b"0.000000 -42.000000 1.000000", b"0 0 0").replace(b"-41.0", b"-01.0")
    with pytest.raises(InputError, match="not a humanoid"):
        motion_of(read_bvh(text, "a"))
    chains = CHAINS
    for old, new in names.items():
        chains = chains.replace(f'"{old}"', f'"{new}"')
    skeleton = motion_of(read_bvh(text, "a"), skeleton_maps=(_map(tmp_path, chains),))[0]
    assert BODY_GROUPS[skeleton.groups[skeleton.names.index("b2")]] == "right_leg"


def test_all_faults_are_reported_at_once(tmp_path: Path) -> None:
    text = 'units = 3\nup = "q"\nunit_m = -1\n' + CHAINS.replace("RightHand", "RightHnd") + 'tail = ["Hips"]\n'
    text = text.replace('["LeftUpLeg", "LeftFoot"]', "3").replace('"Head"', '"Haed"')
    bvh = read_bvh(BvhText().data(), "a.bvh")
    with pytest.raises(InputError) as caught:
        motion_of(bvh, skeleton_maps=(_map(tmp_path, text),))
    said = caught.value.message
    for part in (
        "'units' is not a key", "up is 'q'", "unit_m is -1", "chains.tail is not a body group", "chains.right_leg",
        "no joint 'RightHnd'; is it 'RightHand'?", "no joint 'Haed'", "a.bvh",
    ):  # fmt: skip
        assert part in said


def test_chains_that_do_not_run_down_the_rig_are_reported_at_once(tmp_path: Path) -> None:
    text = 'pelvis = "Spine"\n' + CHAINS.replace('["RightShoulder", "RightHand"]', '["RightHand", "RightShoulder"]')
    text = text.replace('"LeftFoot"', '"RightToe"')
    with pytest.raises(InputError) as caught:
        motion_of(read_bvh(BvhText().data(), "a"), skeleton_maps=(_map(tmp_path, text),))
    for part in (
        "left_arm 'RightShoulder' is not below 'RightHand'", "'RightToe' is not below 'LeftUpLeg'",
        "left_leg begins at 'RightUpLeg', which is not below 'Spine'",
    ):  # fmt: skip
        assert part in caught.value.message


def test_each_rig_uses_the_map_that_matches_it(tmp_path: Path) -> None:
    mine, other = _map(tmp_path, CHAINS), SkeletonMap("other", ((("x",)), ("y",), ("z",), ("u",), ("v",)))
    assert choose_map((other, mine), _joint_names()) is mine
    assert choose_map((other,), _joint_names()) is None
    with pytest.raises(InputError, match="no joint 'x'"):
        choose_map((other,), _joint_names(), must_fit=True)
    with pytest.raises(InputError, match=r"skeleton map .*gone\.toml does not exist.*"):
        read_skeleton_map(tmp_path / "gone.toml")


def _joint_names() -> list[str]:
    return [name for name, _, _ in BvhText().joints()]
