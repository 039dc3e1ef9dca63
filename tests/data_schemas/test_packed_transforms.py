"""Packed clips: what comes back is what went in, by a fraction of a millimetre, in a fraction of the space."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError
from data_schemas.tpc import BoneSet, TpcReader, TpcWriter
from tests.data_schemas.examples import a_row
from tests.shared.training.tiny_clouds import GROUPS, PARENTS, TAILS, swinging

FRAMES = 600  # more than two chunks
WIDE_TURNS = 4.0  # rotation vectors beyond half a turn, and through it


def _bones() -> BoneSet:
    weights = np.full(12, 1 / 12, np.float32)
    return BoneSet(
        PARENTS, TAILS, GROUPS, weights, np.zeros(1, np.int32), np.zeros(1, np.float32), np.zeros((1, 3), np.float32)
    )


def _write(path, heads, rotations, *, packed=True):
    with (
        write_artefact(path, "tpc", stage="s", config={}) as draft,
        TpcWriter(draft.folder, packed=packed) as writer,
    ):
        writer.add_rigid(a_row(skeleton=writer.add_bones(_bones()), frames=len(heads)), heads, rotations)
    return path


def _apart_degrees(one: np.ndarray, other: np.ndarray) -> float:
    turned = Rotation.from_quat(one.reshape(-1, 4)).inv() * Rotation.from_quat(other.reshape(-1, 4))
    return float(np.degrees(turned.magnitude()).max())


@pytest.mark.parametrize("wide", [1.0, WIDE_TURNS])
def test_what_comes_back_is_what_went_in(tmp_path, wide):
    rng = np.random.default_rng(3)
    heads, rotations = swinging(rng, FRAMES)
    if wide > 1:  # joints that turn round and round, and one that slides on its parent
        for bone in (3, 5, 7):
            axis = rng.normal(size=3)
            spun = Rotation.from_rotvec(np.linspace(0, wide * np.pi, FRAMES)[:, None] * axis / np.linalg.norm(axis))
            rotations[:, bone] = (Rotation.from_quat(rotations[:, bone]) * spun).as_quat()
        heads[:, 3] += 0.02 * np.sin(np.arange(FRAMES) / 9)[:, None]
    heads += np.array([120.0, 0.0, -800.0], np.float32)  # far from the origin
    path = _write(tmp_path / "t", heads, rotations)
    with TpcReader(path) as reader:
        assert reader.layout("walk") == "rigid"
        back_heads, back_rotations = reader.transforms("walk")
        for start, stop in ((0, 1), (100, 150), (250, 520), (599, 600)):
            part = reader.transforms("walk", start, stop)
            np.testing.assert_array_equal(part[0], back_heads[start:stop])
            same = np.abs((part[1] * back_rotations[start:stop]).sum(-1))  # of the two signs either
            np.testing.assert_allclose(same, 1, atol=1e-6)
    assert np.linalg.norm(back_heads - heads, axis=-1).max() < 0.0005
    assert _apart_degrees(back_rotations, rotations) < 0.05
    assert back_heads.dtype == back_rotations.dtype == np.float32
    neighbours = (back_rotations[1:] * back_rotations[:-1]).sum(-1)
    assert (neighbours > 0).all()  # so that windows may be interpolated between frames


def test_packed_clips_take_a_third_of_the_space_and_less(tmp_path):
    heads, rotations = swinging(np.random.default_rng(4), 2000)
    sizes = []
    for packed in (True, False):
        path = _write(tmp_path / f"packed{packed}", heads, rotations, packed=packed)
        sizes.append(next(path.glob("data-*/clouds.h5")).stat().st_size)
    assert 3 * sizes[0] < sizes[1]


def test_the_same_clip_gives_the_same_bytes(tmp_path):
    clip = swinging(np.random.default_rng(5), 90)
    files = [next(_write(tmp_path / name, *clip).glob("data-*/clouds.h5")).read_bytes() for name in "ab"]
    assert files[0] == files[1]


@pytest.mark.parametrize("damage", ["turns", "offsets", "moving", "shape"])
def test_damaged_packed_clips_are_refused(tmp_path, damage):
    path = _write(tmp_path / "t", *swinging(np.random.default_rng(6), 40))
    with h5py.File(next(path.glob("data-*/clouds.h5")), "r+") as file:
        group = file["clips/walk"]
        if damage == "turns":
            group.create_dataset("other", data=np.zeros((36, 40), np.float32))
            del group["turns"]
            group.move("other", "turns")
        elif damage == "shape":
            del group["places"]
            group.create_dataset("places", data=np.zeros((3, 7), np.int32))
        elif damage == "offsets":
            group.attrs["offsets"] = np.full((12, 3), np.nan, np.float32)
        else:
            group.attrs["moving"] = np.array([0, 99], np.int32)
    with TpcReader(path) as reader, pytest.raises(InputError):
        reader.transforms("walk")
