"""Variants of BVH found in public data: each gives the same motion as the plain spelling."""

from __future__ import annotations

import re

import numpy as np
import pytest

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of, read_bvh_motion
from stages.shared.formats.recording import Asked
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.bvh_texts import HUMANOID, PLACES, TURNS, BvhText

NAMES = [name for name, *_ in HUMANOID]


def _motion(data: bytes) -> tuple[Skeleton, Motion]:
    skeleton, motion, _ = motion_of(read_bvh(data, "a.bvh"))
    return skeleton, motion


def _same_body(data: bytes, plain: bytes) -> None:
    """Same places, same groups."""
    skeleton, motion = _motion(data)
    other, expected = _motion(plain)
    assert np.allclose(positions_of(skeleton, motion), positions_of(other, expected), atol=2e-6)
    assert np.array_equal(skeleton.groups, other.groups) and np.array_equal(skeleton.sampled, other.sampled)


@pytest.mark.parametrize("form", ["mixamorig:{}", "mixamorig1:{}", "ORG_{}", "Character1_{}", "ns:rig:{}", "{} x"])
def test_names_with_namespaces_and_prefixes(form: str) -> None:
    text = BvhText(names={name: form.format(name) for name in NAMES})
    _same_body(text.data(), BvhText().data())
    assert _motion(text.data())[0].names[0] == form.format("Hips")


def _channels(text: BvhText, order: tuple[str, ...]) -> bytes:
    """The same text with the six channels of the root in another order, columns moved along."""
    old = (*PLACES, *TURNS)
    whole = text.text().replace(" ".join(("CHANNELS 6", *old)), " ".join(("CHANNELS 6", *order)))
    head, rows = whole.split(f"Frame Time: {text.frame_time}\n")
    moved = []
    for row in rows.splitlines():
        words = row.split()
        moved.append(" ".join([*(words[old.index(channel)] for channel in order), *words[6:]]))
    return (head + f"Frame Time: {text.frame_time}\n" + "\n".join(moved) + "\n").encode()


@pytest.mark.parametrize(
    "order",
    [
        (*TURNS, *PLACES),
        (*TURNS, *reversed(PLACES)),
        tuple(x for pair in zip(PLACES, TURNS, strict=True) for x in pair),
    ],
)
def test_rotation_channels_before_and_between_position_channels(order: tuple[str, ...]) -> None:
    assert order != (*PLACES, *TURNS)
    _same_body(_channels(BvhText(), order), BvhText().data())


def test_no_end_sites() -> None:
    without = BvhText(end_site=False).data()
    assert b"End Site" not in without
    skeleton, motion = _motion(without)
    other, expected = _motion(BvhText().data())
    assert np.allclose(positions_of(skeleton, motion), positions_of(other, expected), atol=2e-6)
    hand = skeleton.names.index("LeftHand")  # a leaf whose end nothing tells goes on as its parent does
    assert np.allclose(skeleton.tails[hand], [0.1, 0, 0], atol=1e-6) and skeleton.sampled[hand]


def test_positions_on_all_joints() -> None:
    """Some exporters repeat the offsets in every row: no joint moves relative to its parent, so there is no track."""
    skeleton, motion = _motion(BvhText(placed=tuple(NAMES)).data())
    _same_body(BvhText(placed=tuple(NAMES)).data(), BvhText().data())
    assert len(motion.track_joints) == 0 and skeleton.joints == 21


def test_three_and_six_channels_mixed() -> None:
    text = BvhText(placed=("Hips", "Spine", "LeftHand"), orders={"Head": ("Yrotation",), "Neck": ()})
    counts = re.findall(r"CHANNELS (\d)", text.text())
    assert set(counts) == {"0", "1", "3", "6"}
    skeleton, motion = _motion(text.data())
    assert skeleton.joints == 21 and motion.frames == 12


def test_several_roots_are_refused_by_name_and_line() -> None:
    second = BvhText(names={name: f"B_{name}" for name in NAMES}).header().partition("HIERARCHY\n")[2]
    head, _, rest = BvhText().text().partition("MOTION")
    with pytest.raises(InputError, match=r"line \d+: there is a second ROOT 'B_Hips' after 'Hips'") as caught:
        read_bvh((head + second + "MOTION" + rest).encode(), "two.bvh")
    assert "Split the file" in (caught.value.hint or "")


def test_one_frame_is_a_pose() -> None:
    (recording,) = read_bvh_motion(BvhText(frames=1).data(), "pose.bvh", Asked(trim_first="auto"))
    assert recording.motion.frames == 1 and np.isfinite(recording.motion.rotations).all()


def test_twenty_thousand_frames() -> None:
    text = BvhText(frames=40)
    head, _, rows = text.text().partition(f"Frame Time: {text.frame_time}\n")
    long = head.replace("Frames: 40", "Frames: 20000") + f"Frame Time: {text.frame_time}\n" + rows * 500
    skeleton, motion = _motion(long.encode())
    _, short = _motion(text.data())
    assert motion.frames == 20_000 and skeleton.joints == 21
    turns = np.abs((motion.rotations[19_960:] * short.rotations).sum(axis=-1))
    assert turns.min() > 1 - 1e-6 and np.isfinite(motion.rotations).all()
