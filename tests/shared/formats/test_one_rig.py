"""One rig is one skeleton and one unit, whatever its clips show; nodes without a skin are a rig too."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from data_schemas.errors import InputError
from data_schemas.motion import skeleton_id
from data_schemas.notes import Flag
from stages.shared.formats.bvh_header import parse_header
from stages.shared.formats.bvh_motion import read_bvh_motion
from stages.shared.formats.bvh_of_motion import bvh_of_motion, with_channels
from stages.shared.formats.gltf_motion import read_gltf
from stages.shared.formats.recording import Asked, Recording
from stages.shared.humanoid.reference_pose import find_unit
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.formats.gltf_files import NAMES, GltfText, edited


def read(data: bytes) -> list[Recording]:
    return read_gltf(data, "a.glb", Asked())


def heads(recording: Recording) -> np.ndarray:
    order = [recording.skeleton.names.index(name) for name in NAMES]
    return positions_of(recording.skeleton, recording.motion)[:, order]


@pytest.mark.parametrize("moving", [("Hips",), ("Hips", "Chest", "LeftHand"), ("Hips", "LeftUpLeg", "Neck", "Head")])
def test_clips_of_one_file_are_on_one_skeleton(moving: tuple[str, ...]) -> None:
    text = GltfText(parts=("walk", "run", "jump"), moving=moving, bind=True)
    recordings = read(text.data())
    assert len({skeleton_id(each.skeleton) for each in recordings}) == 1
    for part, recording in enumerate(recordings):
        assert np.abs(heads(recording) - text.heads(part)).max() < 2e-5


def test_files_of_one_rig_are_on_one_skeleton_whichever_joints_they_move() -> None:
    files = [GltfText(seed=seed, moving=moving) for seed, moving in
             enumerate([("Hips",), ("Hips", "Chest"), ("Hips", "LeftHand", "Neck"), ()])]  # fmt: skip
    recordings = [read(text.data())[0] for text in files]
    assert len({skeleton_id(each.skeleton) for each in recordings}) == 1
    # As stored in an artefact: every clip has the header of the first one, which has fewer channels.
    for text, recording in zip(files, recordings, strict=True):
        data = bvh_of_motion(recordings[0].skeleton, recording.motion, "a")
        (back,) = read_bvh_motion(data, "a.bvh", Asked())
        assert np.abs(heads(back) - text.heads()).max() < 2e-4


@pytest.mark.parametrize(("size", "unit_m"), [(1.0, 1.0), (2.2, 1.0), (0.3, 1.0), (100.0, 0.01)])
def test_gltf_is_in_metres_unless_that_cannot_be(size: float, unit_m: float) -> None:
    def larger(scene: dict) -> None:
        scene["nodes"][0]["scale"] = [size] * 3

    (recording,) = read(edited(GltfText(), larger))
    assert recording.skeleton.unit_m == unit_m
    assert (Flag.UNIT_UNCERTAIN in {each.flag for each in recording.notes}) == (size in (2.2, 0.3))
    assert np.abs(heads(recording) - unit_m * size * GltfText().heads()).max() < 1e-3 * size


def test_units_of_other_formats_are_found_as_ever() -> None:
    assert [find_unit(stature)[0] for stature in (160.0, 1.6, 1600.0)] == [0.01, 1.0, 0.001]
    assert find_unit(5.2, 1.0)[0] == 1.0 != find_unit(5.2)[0]


def test_nodes_without_a_skin_are_joints() -> None:
    def bare(scene: dict) -> None:
        del scene["skins"]
        scene["nodes"].append({"name": "Camera", "camera": 0})
        scene["nodes"][0]["children"].append(len(scene["nodes"]) - 1)

    text = GltfText(scale=0.01, turn=(-90, 0, 0), parts=("walk", "run"))
    with_skin, without = read(text.data()), read(edited(text, bare))
    assert [skeleton_id(each.skeleton) for each in with_skin] == [skeleton_id(each.skeleton) for each in without]
    for one, other in zip(with_skin, without, strict=True):
        np.testing.assert_array_equal(one.motion.rotations, other.motion.rotations)
        assert Flag.NODES_AS_JOINTS in {each.flag for each in other.remarks}


def test_still_nodes_at_the_ends_of_chains_are_joints_too() -> None:
    hand = NAMES.index("LeftHand")

    def bare(scene: dict) -> None:
        del scene["skins"]
        for animation in scene["animations"]:
            animation["channels"] = [c for c in animation["channels"] if c["target"]["node"] != hand + 1]

    (recording,) = read(edited(GltfText(), bare))
    assert set(recording.skeleton.names) == set(NAMES)


@pytest.mark.parametrize("stature", [1e-9, 1e30, float("inf")])
def test_a_size_that_no_unit_explains_is_refused(stature: float) -> None:
    with pytest.raises(InputError, match="not a body in any unit"):
        find_unit(stature)


HEADER = (
    "HIERARCHY\nROOT A\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
    "JOINT B\n{\nOFFSET 0 1 0\nCHANNELS 0\nJOINT C\n{\nOFFSET 0 1 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
    "JOINT D joint {\n  OFFSET 0 1 0 End Site a joint {\nOFFSET 0 1 0\n}\n}\n"
    "JOINT E\n{\nOFFSET 0 1 0\nCHANNELS 1 Zrotation\nEnd Site\n{\nOFFSET 0 1 0\n}\n}\n}\n}\n}\n"
)


def test_channels_go_to_their_joint_past_joints_without_channels() -> None:
    """A joint that turns about no axis has `CHANNELS 0` or none; added channels must not slip to another joint."""
    before = parse_header(HEADER)
    places = ("Xposition", "Yposition", "Zposition")
    turns = ("Zrotation", "Xrotation", "Yrotation")
    for at in itertools.product((0, 1, 2, 3), repeat=3):
        positions = {joint for joint, each in zip((1, 2, 3), at, strict=True) if each & 1}
        rotations = {joint for joint, each in zip((1, 2, 3), at, strict=True) if each & 2} - {2}
        joints = parse_header(with_channels(HEADER, positions, rotations))
        for index, (old, new) in enumerate(zip(before, joints, strict=True)):
            expected = places * (index in positions) + old.channels + turns * (index in rotations)
            assert new.channels == expected and (new.name, new.offset, new.end_site) == (
                old.name, old.offset, old.end_site,
            )  # fmt: skip
    assert with_channels(HEADER, ()) == HEADER


@pytest.mark.parametrize("line", ["", "CHANNELS 0\n"])
def test_a_joint_without_channels_keeps_its_track_and_its_turns(line: str) -> None:
    """Clips of one skeleton share the header of the first, in which this joint has no channels."""
    rng = np.random.default_rng(0)
    header, rows = BvhText(frames=9).text().split("MOTION")
    joint = next(index for index, each in enumerate(parse_header(header)) if each.name == "LeftHand")
    (still,) = read_bvh_motion(f"{header}MOTION{rows}".encode(), "a.bvh", Asked())
    channels = "CHANNELS 3 Zrotation Xrotation Yrotation"
    start = header.index(channels, header.index("LeftHand"))
    bare = header[:start] + line.strip() + header[start + len(channels) :]
    assert parse_header(bare)[joint].channels == ()
    tracks = still.skeleton.offsets[joint] + rng.normal(0, 0.02, (9, 1, 3))
    moving = replace(still.motion, track_joints=np.array([joint], np.int32), tracks=tracks.astype(np.float32))
    data = bvh_of_motion(replace(still.skeleton, header=bare), moving, "a")
    (back,) = read_bvh_motion(data, "a.bvh", Asked())
    assert np.abs(positions_of(back.skeleton, back.motion) - positions_of(still.skeleton, moving)).max() < 1e-5
    agreement = (back.motion.rotations[:, joint] * moving.rotations[:, joint]).sum(-1)
    assert np.abs(agreement).min() > 1 - 1e-6


@pytest.mark.parametrize("z_up", [False, True])
def test_a_joint_0_that_does_not_turn_gets_no_channels(z_up: bool) -> None:
    """A still joint above the hips, with positions alone, in worlds of both axes."""
    header, rest = BvhText(frames=5, above="World", z_up=z_up).text().split("MOTION")
    start = header.index("CHANNELS")
    bare = header[:start] + "CHANNELS 3 Xposition Yposition Zposition" + header[header.index("\n", start) :]
    head, rows = rest.split("0.0333333\n")
    still = ["0 0 0 " + " ".join(row.split()[6:]) for row in rows.strip().split("\n")]
    data = f"{bare}MOTION{head}0.0333333\n" + "\n".join(still)
    (recording,) = read_bvh_motion(data.encode(), "a.bvh", Asked())
    assert recording.skeleton.up_axis == ("z" if z_up else "y") and recording.skeleton.names[0] == "World"
    assert bvh_of_motion(recording.skeleton, recording.motion, "a").decode().startswith(bare)
