"""From rows to motions and back: unit, up axis, tracks, sides, calibration frames, and the inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, Motion, Skeleton
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_motion import motion_of, rate_of, values_of
from stages.shared.kinematics import forward_numpy
from stages.shared.kinematics.forward import positions_of
from tests.shared.formats.bvh_texts import TURNS, BvhText


def _read(text: BvhText, **options: object) -> tuple[BvhFile, Skeleton, Motion, list[str]]:
    bvh = read_bvh(text.data(), "a.bvh")
    return (bvh, *motion_of(bvh, **options))  # type: ignore[arg-type]


def _positions_by_matrices(bvh: BvhFile) -> np.ndarray:
    """(T, J, 3) in the file's unit, one joint and frame after another, with SciPy."""
    out = np.zeros((bvh.frames, len(bvh.joints), 3))
    for frame, row in enumerate(bvh.values):
        turned: list[Rotation] = []
        for index, joint in enumerate(bvh.joints):
            rotation, offset = Rotation.identity(), np.array(joint.offset)
            for i, channel in enumerate(joint.channels):
                value = row[joint.first_channel + i]
                if channel.endswith("position"):
                    offset["XYZ".index(channel[0])] = value
                else:
                    rotation = rotation * Rotation.from_euler(channel[0], value, degrees=True)
            if joint.parent < 0:
                out[frame, index], total = offset, rotation
            else:
                out[frame, index] = out[frame, joint.parent] + turned[joint.parent].apply(offset)
                total = turned[joint.parent] * rotation
            turned.append(total)
    return out


@pytest.mark.parametrize(
    "text",
    [
        BvhText(frames=5),
        BvhText(frames=5, orders={"Head": ("Xrotation", "Yrotation", "Zrotation"), "LeftArm": ("Yrotation",)}),
        BvhText(frames=5, above="joint_Root"),
        BvhText(frames=5, placed=("Hips", "Neck"), end_site=False),
    ],
    ids=["plain", "mixed-orders", "root-above", "tracks"],
)
def test_joints_are_where_the_matrices_say(text: BvhText) -> None:
    bvh, skeleton, motion, _ = _read(text)
    assert np.allclose(forward_numpy.positions_of(skeleton, motion), positions_of(skeleton, motion), atol=2e-6)
    assert np.allclose(positions_of(skeleton, motion), _positions_by_matrices(bvh) * skeleton.unit_m, atol=2e-6)


@pytest.mark.parametrize(("scale", "unit"), [(1.0, 0.01), (0.01, 1.0), (10.0, 0.001), (1 / 2.54, 0.0254), (0.1, 0.1)])
def test_the_unit_is_found_from_the_stature(scale: float, unit: float) -> None:
    _, skeleton, motion, notes = _read(BvhText(scale=scale, number="{:.9f}"))
    assert skeleton.unit_m == pytest.approx(unit)
    assert np.ptp(positions_of(skeleton, motion)[0, :, 1]) == pytest.approx(1.7, abs=0.25)
    assert bool(notes) == (unit == 0.0254)


def test_an_unusual_unit_is_scaled_to_a_human_and_noted() -> None:
    _, skeleton, _, notes = _read(BvhText(scale=1e-5, number="{:.9f}"))
    assert 1.0 < 165e-5 * skeleton.unit_m < 2.2
    assert "unit" in notes[0]


def test_z_up_is_turned_to_y_up() -> None:
    _, skeleton, motion, _ = _read(BvhText(z_up=True))
    heads = positions_of(skeleton, motion)
    assert skeleton.up_axis == "z"
    assert (heads[:, skeleton.names.index("Head"), 1] > heads[:, skeleton.names.index("LeftFoot"), 1] + 1.0).all()


def test_a_body_that_lies_down_is_still_y_up() -> None:
    text = BvhText()
    values = text.values()
    values[:, 1], values[:, 3:6] = 15.0, (0.0, 90.0, 0.0)
    bvh = read_bvh(text.data(), "a")
    lying = BvhFile(**{**bvh.__dict__, "values": values})
    assert motion_of(lying)[0].up_axis == "y"


def test_still_joints_above_the_pelvis_are_no_part_of_the_body() -> None:
    _, skeleton, motion, _ = _read(BvhText(above="joint_Root"))
    assert skeleton.names[skeleton.root] == "Hips"
    assert skeleton.groups[0] == -1 and not skeleton.sampled[0]
    assert [skeleton.names[j] for j in motion.track_joints] == ["Hips"]
    assert not motion.root_positions.any()
    assert not skeleton.offsets[skeleton.root].any()


def test_skeletons_of_one_rig_are_the_same_however_its_root_is_placed() -> None:
    first = _read(BvhText(above="joint_Root"))[1]
    header_elsewhere = BvhText(above="joint_Root").data().replace(b"90.000000 -400.0", b"93.000000 -412.0", 1)
    second = motion_of(read_bvh(header_elsewhere, "b"))[0]
    assert np.array_equal(first.offsets, second.offsets) and np.array_equal(first.tails, second.tails)


def test_groups_bones_and_tails() -> None:
    _, skeleton, _, _ = _read(BvhText(end_site=False))
    group = dict(zip(skeleton.names, skeleton.groups, strict=True))
    assert BODY_GROUPS[group["LeftHand"]] == "left_arm" and BODY_GROUPS[group["RightToe"]] == "right_leg"
    assert BODY_GROUPS[group["Head"]] == "spine"
    tail = dict(zip(skeleton.names, skeleton.tails, strict=True))
    assert np.allclose(tail["Chest"], (0, 0.20, 0)) and np.allclose(tail["Hips"], (0, 0.20, 0))
    assert np.allclose(tail["LeftHand"], (0.1, 0, 0))  # no end site: the parent's direction at 0.1 m
    assert skeleton.sampled.all()


@pytest.mark.parametrize(
    ("frame_time", "fps"),
    [
        ("0.0333333", 30), ("0.033333", 30), ("0.033", 30), ("0.0333667", 1 / 0.0333667), ("0.008333", 120),
        ("0.00833333", 120), ("0.0166667", 60), ("0.0167", 60), ("0.01", 100), ("0.041667", 24), ("0.04", 25),
    ],
)  # fmt: skip
def test_rounded_frame_times_mean_whole_rates(frame_time: str, fps: float) -> None:
    assert rate_of(float(frame_time)) == pytest.approx(fps)


def test_a_calibration_pose_is_dropped_and_a_motion_is_not() -> None:
    text = BvhText(frames=60)
    bvh = read_bvh(text.data(), "a")
    values = bvh.values.copy()
    values[0] = 0.0
    odd = BvhFile(**{**bvh.__dict__, "values": values})
    _, motion, notes = motion_of(odd, trim_first="auto")
    assert motion.frames == 59 and "first frame" in notes[0]
    assert motion_of(bvh, trim_first="auto")[1].frames == 60
    assert motion_of(odd)[1].frames == 60
    assert motion_of(odd, trim_first=3)[1].frames == 57
    for bad in (60, -1, "some"):
        with pytest.raises(InputError, match=r"a: "):
            motion_of(odd, trim_first=bad)


def test_frame_rate_override_and_rest_frame() -> None:
    bvh = read_bvh(BvhText().data(), "a")
    assert motion_of(bvh, fps_override=60)[1].fps == 60
    assert motion_of(bvh, rest_frame=3)[0].up_axis == "y"
    with pytest.raises(InputError, match="Rest frame 12"):
        motion_of(bvh, rest_frame=12)


def test_no_humanoid_is_refused_by_name() -> None:
    text = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n"
    text += "JOINT b\n{\nOFFSET 0 1 0\nCHANNELS 1 Xrotation\n}\n}\n"
    bvh = read_bvh((text + "MOTION\nFrames: 1\nFrame Time: 0.1\n0 0\n").encode(), "snake.bvh")
    with pytest.raises(InputError, match=r"snake\.bvh: .*not a humanoid"):
        motion_of(bvh)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6),
    st.booleans(),
    st.sampled_from(["", "joint_Root"]),
    st.permutations(TURNS),
    st.permutations(TURNS),
    st.sampled_from([1.0, 0.01, 10.0]),
)
def test_values_are_the_inverse_of_motions(
    seed: int, z_up: bool, above: str, hips: list[str], arms: list[str], scale: float
) -> None:
    orders = {"LeftArm": tuple(arms), "RightArm": ("Zrotation",)}
    if not z_up:
        orders["Hips"] = tuple(hips)
    text = BvhText(seed=seed, z_up=z_up, above=above, orders=orders, scale=scale, placed=("Hips", "Neck"))
    bvh, skeleton, motion, _ = _read(text)
    assert np.allclose(values_of(bvh, skeleton, motion, bvh.values), bvh.values, atol=2e-3)
    again = BvhFile(**{**bvh.__dict__, "values": values_of(bvh, skeleton, motion)})
    back = motion_of(again)[1]
    assert np.allclose(positions_of(skeleton, back), positions_of(skeleton, motion), atol=1e-4)


def test_key_rows_alone_give_the_same_skeleton() -> None:
    bvh, skeleton, motion, _ = _read(BvhText(frames=40, above="joint_Root"))
    keys = np.array([0, 15, 39])
    other, at_keys, _ = motion_of(bvh.select(keys))
    assert np.array_equal(other.offsets, skeleton.offsets) and other.unit_m == skeleton.unit_m
    agree = np.abs((at_keys.rotations * motion.rotations[keys]).sum(-1))
    assert np.allclose(agree, 1, atol=1e-6)


def test_long_clips_computed_in_blocks_give_the_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    text = BvhText(frames=50, z_up=True)
    _, _, whole, _ = _read(text)
    monkeypatch.setattr("stages.shared.formats.source_body.BLOCK_FRAMES", 7)
    _, _, blocks, _ = _read(text)
    assert np.array_equal(blocks.rotations, whole.rotations)
    assert (np.sum(blocks.rotations[1:] * blocks.rotations[:-1], axis=-1) >= 0).all()
