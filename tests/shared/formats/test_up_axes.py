"""Which way is up: found from the motion, kept through every format, and set by an option."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stages.shared.clips
from data_schemas.errors import InputError
from data_schemas.notes import Flag
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.amass import read_amass
from stages.shared.formats.amass_write import amass_of_motion
from stages.shared.formats.bvh_motion import read_bvh_motion
from stages.shared.formats.bvh_of_motion import bvh_of_motion
from stages.shared.formats.positions import read_positions
from stages.shared.formats.readers import recognise
from stages.shared.formats.recording import Asked, Recording
from stages.shared.formats.smpl import LAYOUTS
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.amass_files import npz

CLIPS = sorted(Path(stages.shared.clips.__file__).parent.glob("*.bvh"))
FRAMES = 40
Z_TO_Y = Rotation.from_euler("x", -90, degrees=True)


def walking(up: str, *, flat: bool = False) -> dict[str, np.ndarray]:
    """SMPL's parameters of a body that walks in a world whose Y or Z is up, or lies on its back and slides."""
    vectors = np.random.default_rng(0).normal(0, 0.05, (FRAMES, 24, 3))
    vectors[:, 0] = 0.0
    ahead = np.linspace(0, 2, FRAMES)
    places = np.stack([np.zeros(FRAMES), np.full(FRAMES, 0.95), ahead], axis=1)
    if flat:
        back = Rotation.from_euler("x", -90, degrees=True)
        vectors[:, 0] = back.as_rotvec()
        places = np.stack([np.zeros(FRAMES), np.full(FRAMES, 0.1), ahead + 3], axis=1)
    if up == "z":
        turn = Z_TO_Y.inv()
        vectors[:, 0] = (turn * Rotation.from_rotvec(vectors[:, 0])).as_rotvec()
        places = turn.apply(places)
    return {"poses": vectors.reshape(FRAMES, 72), "trans": places}


def amass(up: str, **options: object) -> bytes:
    return npz(**walking(up, **options), mocap_framerate=np.array(30.0))  # type: ignore[arg-type]


def read(data: bytes, **options: object) -> Recording:
    (recording,) = read_amass(data, "a.npz", Asked(**options))  # type: ignore[arg-type]
    return recording


def height_m(skeleton: Skeleton, motion: Motion) -> float:
    """The median height of the head above the feet along Y."""
    places = positions_of(skeleton, motion)
    feet = [skeleton.names.index(name) for name in ("left_foot", "right_foot")]
    return float(np.median(places[:, skeleton.names.index("head"), 1] - places[:, feet, 1].mean(axis=1)))


def test_a_body_that_stands_along_y_is_upright_and_reported() -> None:
    recording = read(amass("y"))
    assert height_m(recording.skeleton, recording.motion) > 1.2
    assert np.ptp(recording.motion.root_positions[:, 1]) < 0.1  # its walk is level
    assert Flag.UP_FROM_MOTION in {each.flag for each in recording.remarks}
    usual = read(amass("z"))
    assert height_m(usual.skeleton, usual.motion) > 1.2
    assert Flag.UP_FROM_MOTION not in {each.flag for each in usual.remarks}


@pytest.mark.parametrize("up", ["y", "z"])
def test_an_option_goes_before_what_the_motion_shows(up: str) -> None:
    other = {"y": "z", "z": "y"}[up]
    wrong, right = read(amass(up), up_axis=other), read(amass(up), up_axis=up)
    assert abs(height_m(wrong.skeleton, wrong.motion)) < 0.3 < 1.2 < height_m(right.skeleton, right.motion)


def test_a_body_that_lies_on_the_floor_of_a_z_up_world_stays_there() -> None:
    recording = read(amass("z", flat=True))
    assert np.ptp(positions_of(recording.skeleton, recording.motion)[..., 1]) < 0.7


def smplx_names(up: str = "y", **changed: np.ndarray | None) -> bytes:
    given = walking(up)
    vectors = given["poses"].astype(np.float32)
    arrays = {"global_orient": vectors[:, :3], "body_pose": vectors[:, 3:66], "transl": given["trans"],
              "betas": np.zeros((FRAMES, 10)), **changed}  # fmt: skip
    return npz(**{key: value for key, value in arrays.items() if value is not None})


@pytest.mark.parametrize("shape", [(FRAMES, 63), (FRAMES, 21, 3), (1, FRAMES, 63), (1, FRAMES, 21, 3)])
def test_names_of_the_smplx_package_in_all_shapes(shape: tuple[int, ...]) -> None:
    vectors = walking("y")["poses"]
    lead = (1,) if shape[0] == 1 else ()
    data = smplx_names(
        body_pose=vectors[:, 3:66].reshape(shape), global_orient=vectors[:, :3].reshape(*lead, FRAMES, 3),
        transl=walking("y")["trans"].reshape(*lead, FRAMES, 3),
    )  # fmt: skip
    chosen = recognise(data, "a.npz")
    assert chosen is not None and chosen.name == "amass"
    recording, plain = read(data), read(smplx_names())
    assert set(recording.skeleton.names) == set(LAYOUTS["body"])
    np.testing.assert_allclose(recording.motion.rotations, plain.motion.rotations, atol=1e-6)
    np.testing.assert_allclose(recording.motion.root_positions, plain.motion.root_positions, atol=1e-6)
    assert height_m(recording.skeleton, recording.motion) > 1.2
    assert {Flag.NO_FRAME_RATE, Flag.UP_FROM_MOTION} <= {each.flag for each in recording.remarks}
    assert recording.motion.fps == 30 and read(data, fps_override=50.0).motion.fps == 50


def test_hands_of_the_smplx_package() -> None:
    hands = np.random.default_rng(1).normal(0, 0.1, (FRAMES, 45))
    whole = read(smplx_names(left_hand_pose=hands, right_hand_pose=hands))
    assert len(whole.skeleton.names) == len(LAYOUTS["smplh"])
    face = read(smplx_names(left_hand_pose=hands, right_hand_pose=hands, jaw_pose=np.zeros((FRAMES, 3))))
    assert len(face.skeleton.names) == len(LAYOUTS["smplx"])
    reduced = read(smplx_names(left_hand_pose=hands[:, :12], right_hand_pose=hands[:, :12]))
    assert len(reduced.skeleton.names) == 22 and Flag.HANDS_LEFT_OUT in {each.flag for each in reduced.notes}
    with pytest.raises(InputError, match="body_pose has the shape"):
        read(smplx_names(body_pose=np.zeros((FRAMES, 60))))


def torch_file() -> bytes:
    """A zip whose members are called as in PyTorch's files."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("clip/data.pkl", b"\x80\x02}q\x00.")
        archive.writestr("clip/data/0", bytes(64))
    return stream.getvalue()


@pytest.mark.parametrize(
    ("data", "name", "says"),
    [
        (b"\x80\x04\x95\x10\x00", "a.pkl", "pickle of Python"),
        (b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.", "a.pth", "PyTorch file"),
        (torch_file(), "a.pt", "PyTorch"),
    ],
)
def test_pickles_are_named_and_never_opened(data: bytes, name: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        recognise(data, name)
    assert "numpy.savez" in (caught.value.hint or "")


def test_a_bvh_of_an_amass_file_rests_and_moves_y_up() -> None:
    recording = read(amass("z"))
    (back,) = read_bvh_motion(bvh_of_motion(recording.skeleton, recording.motion, "a"), "a.bvh", Asked(up_axis="y"))
    assert height_m(back.skeleton, back.motion) > 1.2
    np.testing.assert_allclose(
        positions_of(back.skeleton, back.motion), positions_of(recording.skeleton, recording.motion), atol=1e-4
    )


def test_z_up_positions_become_a_bvh_that_rests_and_moves_y_up() -> None:
    person = read(amass("z"))
    order = [person.skeleton.names.index(name) for name in LAYOUTS["smpl"]]
    places = Z_TO_Y.inv().apply(positions_of(person.skeleton, person.motion)[:, order].reshape(-1, 3))
    (found,) = read_positions(
        npz(joints=places.reshape(FRAMES, 24, 3), fps=np.array(30.0)), "a.npz", Asked(rig_name="smpl24")
    )
    (back,) = read_bvh_motion(bvh_of_motion(found.skeleton, found.motion, "a"), "a.bvh", Asked(up_axis="y"))
    assert height_m(found.skeleton, found.motion) > 1.2 and height_m(back.skeleton, back.motion) > 1.2


@pytest.mark.parametrize("path", CLIPS, ids=lambda path: path.stem)
def test_no_format_in_between_turns_a_clip(path: Path) -> None:
    (first,) = read_bvh_motion(path.read_bytes(), path.name, Asked())
    data, _ = amass_of_motion(first.skeleton, first.motion)
    (second,) = read_amass(data, "a.npz", Asked())
    (third,) = read_bvh_motion(bvh_of_motion(second.skeleton, second.motion, "a"), "a.bvh", Asked())
    assert third.skeleton.up_axis == first.skeleton.up_axis
    order = [third.skeleton.names.index(name) for name in first.skeleton.names]
    places = positions_of(third.skeleton, third.motion)[:, order]
    np.testing.assert_allclose(places, positions_of(first.skeleton, first.motion), atol=2e-4)
