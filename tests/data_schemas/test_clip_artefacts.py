"""Motion, point cloud and latent artefacts: what goes in comes out, and only what belongs together goes in."""

from __future__ import annotations

import pickle
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.clips import read_clips
from data_schemas.errors import InputError
from data_schemas.latent import LatentReader, LatentWriter
from data_schemas.motion import MotionReader, MotionWriter, skeleton_id
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.tpc import TpcReader, TpcWriter
from tests.data_schemas.examples import a_motion, a_row, a_skeleton, some_bones, unit_quaternions, write_motion

any_text = st.text(max_size=40) | st.text(st.characters(min_codepoint=0xDC80, max_codepoint=0xDCFF), max_size=5)
joint_names = any_text.filter(lambda name: "\n" not in name)
clip_names = st.text(st.characters(categories=("L", "N", "P", "S"), exclude_characters="/"), min_size=1, max_size=60)


def _same_skeleton(one: Skeleton, other: Skeleton) -> bool:
    arrays = ("parents", "offsets", "tails", "groups", "sampled")
    plain = ("names", "root", "unit_m", "up_axis", "header")
    return all(np.array_equal(getattr(one, a), getattr(other, a)) for a in arrays) and all(
        getattr(one, p) == getattr(other, p) for p in plain
    )


def _same_motion(one: Motion, other: Motion) -> bool:
    arrays = ("rotations", "root_positions", "track_joints", "tracks")
    return one.fps == other.fps and all(
        np.array_equal(getattr(one, a), getattr(other, a)) and getattr(other, a).dtype == getattr(one, a).dtype
        for a in arrays
    )


@settings(deadline=None, max_examples=30)
@given(st.data())
def test_motion_round_trip(data):
    names = data.draw(st.lists(joint_names, min_size=1, max_size=6))
    joints, frames = len(names), data.draw(st.integers(1, 600))
    tracked = data.draw(st.integers(0, joints - 1))
    seed = data.draw(st.integers(0, 2**32 - 1))
    skeleton = replace(a_skeleton(joints, seed), names=tuple(names), header=data.draw(any_text))
    motion = a_motion(frames, joints, tracked, seed)
    clip = data.draw(clip_names.filter(lambda name: name not in (".", "..")))
    start = data.draw(st.integers(0, frames - 1))
    stop = data.draw(st.none() | st.integers(start + 1, frames))

    with tempfile.TemporaryDirectory() as folder:
        with (
            write_artefact(Path(folder) / "m", "motion", stage="s", config={}) as draft,
            MotionWriter(draft.folder) as writer,
        ):
            row = replace(a_row(clip, writer.add_skeleton(skeleton), frames), source=data.draw(st.text(max_size=40)))
            writer.add_clip(row, motion)
        with MotionReader(Path(folder) / "m") as reader:
            assert reader.clips == (row,)
            assert reader.skeletons() == (row.skeleton,)
            assert _same_skeleton(reader.skeleton(row.skeleton), skeleton)
            assert _same_motion(reader.motion(clip), motion)
            assert _same_motion(reader.motion(clip, start, stop), motion.at(slice(start, stop)))


def test_bytes_do_not_depend_on_when_or_where(tmp_path):
    one, other = write_motion(tmp_path / "a"), write_motion(tmp_path / "b")
    assert (one.folder / "motions.h5").read_bytes() == (other.folder / "motions.h5").read_bytes()
    assert (one.folder / "clips.parquet").read_bytes() == (other.folder / "clips.parquet").read_bytes()


def test_equal_skeletons_are_stored_once(tmp_path):
    skeleton = a_skeleton()
    with MotionWriter(tmp_path) as writer:
        first = writer.add_skeleton(skeleton)
        nudged = replace(skeleton, offsets=np.round(skeleton.offsets, 5) + 1e-7, header="spelt differently")
        assert writer.add_skeleton(nudged) == first == skeleton_id(skeleton)
        others = [
            replace(skeleton, names=("a", "b", "c")),
            replace(skeleton, offsets=skeleton.offsets + 0.001),
            replace(skeleton, groups=np.array([-1, 0, 0], np.int8)),
            replace(skeleton, unit_m=1.0),
            replace(skeleton, up_axis="y"),
        ]
        assert len({first, *map(writer.add_skeleton, others)}) == 6


BAD_SKELETONS = {
    "cycle": {"parents": np.array([-1, 2, 1], np.int32)},
    "two roots": {"parents": np.array([-1, -1, 1], np.int32)},
    "shape": {"tails": np.zeros((2, 3))},
    "nan": {"offsets": np.full((3, 3), np.nan)},
    "group": {"groups": np.array([-1, 0, 5], np.int8)},
    "pelvis": {"root": 3},
    "unit": {"unit_m": 0.0},
    "line break": {"names": ("a", "b\n", "c")},
    "up": {"up_axis": "up"},
    "no joints": {
        "names": (),
        "parents": np.zeros(0, np.int32),
        "offsets": np.zeros((0, 3)),
        "tails": np.zeros((0, 3)),
        "groups": np.zeros(0, np.int8),
        "sampled": np.zeros(0, bool),
    },
}


@pytest.mark.parametrize("fault", BAD_SKELETONS)
def test_bad_skeletons_are_refused(tmp_path, fault):
    with MotionWriter(tmp_path) as writer, pytest.raises(InputError, match="skeleton has"):
        writer.add_skeleton(replace(a_skeleton(), **BAD_SKELETONS[fault]))


def test_bad_clips_are_refused(tmp_path):
    motion = a_motion()
    not_finite = a_motion().rotations.copy()
    not_finite[3, 1, 2] = np.inf
    with MotionWriter(tmp_path) as writer:
        row = a_row(skeleton=writer.add_skeleton(a_skeleton()))
        writer.add_clip(row, motion)
        for bad_row, bad_motion, words in (
            (row, motion, "twice"),
            (replace(row, clip="a/b"), motion, "without '/'"),
            (replace(row, clip=".."), motion, "without '/'"),
            (replace(row, clip=""), motion, "printable"),
            (replace(row, clip="a", skeleton="other"), motion, "was not added"),
            (replace(row, clip="a", frames=11), motion, "11 frames, but its arrays have 10"),
            (replace(row, clip="a", split="tset"), motion, "'tset'"),
            (replace(row, clip="a", fps=60.0), motion, "its row says 60"),
            (replace(row, clip="a"), a_motion(joints=4), "expected"),
            (replace(row, clip="a"), replace(motion, rotations=not_finite), "not finite"),
            (replace(row, clip="a"), replace(motion, rotations=2 * motion.rotations), "not unit quaternions"),
            (replace(row, clip="a"), replace(motion, track_joints=np.array([0], np.int32)), "track on a joint"),
            (replace(row, clip="a"), replace(motion, tracks=motion.tracks[:5]), "tracks of the shape"),
            (replace(row, clip="a"), motion.at(slice(0, 0)), "no frames"),
        ):
            with pytest.raises(InputError, match=words):
                writer.add_clip(bad_row, bad_motion)
    assert read_clips(tmp_path) == (row,)


def test_reading_unknown_clips_and_frames_is_refused(tmp_path):
    write_motion(tmp_path / "m")
    with MotionReader(tmp_path / "m") as reader:
        for start, stop in ((-1, 5), (0, 11), (5, 5), (10, None)):
            with pytest.raises(InputError, match="outside the clip 'walk', which has 10 frames"):
                reader.motion("walk", start, stop)
        for name in ("run", "", "..", "/", "walk/rotations"):
            with pytest.raises(InputError, match="has no clip"):
                reader.motion(name)
            with pytest.raises(InputError, match="has no skeleton"):
                reader.skeleton(name)


def test_a_reader_can_be_sent_to_another_process(tmp_path):
    write_motion(tmp_path / "m")
    with MotionReader(tmp_path / "m") as reader, pickle.loads(pickle.dumps(reader)) as copy:
        assert _same_motion(copy.motion("walk"), reader.motion("walk"))


def test_no_clips_is_an_artefact_too(tmp_path):
    with write_artefact(tmp_path / "m", "motion", stage="s", config={}) as draft, MotionWriter(draft.folder):
        pass
    with MotionReader(tmp_path / "m") as reader:
        assert reader.clips == () and reader.skeletons() == ()


def test_rigid_cloud_round_trip_and_places(tmp_path):
    rng = np.random.default_rng(1)
    bones, frames = some_bones(), 300
    heads, rotations = rng.normal(size=(frames, 2, 3)).astype(np.float32), unit_quaternions(rng, frames, 2)
    with write_artefact(tmp_path / "t", "tpc", stage="s", config={}) as draft, TpcWriter(draft.folder) as writer:
        by_content = writer.add_bones(bones)
        assert writer.add_bones(bones) == by_content
        row = a_row(skeleton=writer.add_bones(bones, skeleton="abc"), frames=frames)
        writer.add_rigid(row, heads, rotations)
        with pytest.raises(InputError, match="Two different"):
            writer.add_bones(some_bones(seed=5), skeleton="abc")
    with TpcReader(tmp_path / "t") as reader:
        assert reader.layout("walk") == "rigid"
        for name, values in vars(reader.bones("abc")).items():
            np.testing.assert_array_equal(values, getattr(bones, name))
        got_heads, got_rotations = reader.transforms("walk", 100, 150)
        np.testing.assert_array_equal(got_heads, heads[100:150])
        np.testing.assert_array_equal(got_rotations, rotations[100:150])
        points, groups = reader.points("walk", 100, 150, sigma_m=0.07)

    assert groups.tolist() == [0, 3, 3, 3, 0] and groups.dtype == np.int8
    assert points.shape == (50, 5, 3) and points.dtype == np.float32
    for p, bone in enumerate(bones.point_bones):  # the equation, point by point
        local = bones.point_alphas[p] * bones.tails[bone] + 0.07 * bones.point_offsets[p]
        for t in range(50):
            expected = heads[100 + t, bone] + Rotation.from_quat(rotations[100 + t, bone]).apply(local)
            np.testing.assert_allclose(points[t, p], expected, atol=1e-5)


def test_dense_cloud_round_trip(tmp_path):
    rng = np.random.default_rng(2)
    points, groups = rng.normal(size=(300, 7, 3)).astype(np.float32), rng.integers(0, 5, 7).astype(np.int8)
    with write_artefact(tmp_path / "t", "tpc", stage="s", config={}) as draft, TpcWriter(draft.folder) as writer:
        writer.add_dense(a_row(frames=300), points, groups)
        with pytest.raises(InputError, match="body group"):
            writer.add_dense(a_row("b", frames=300), points, groups + 5)
        with pytest.raises(InputError, match="expected"):
            writer.add_dense(a_row("b", frames=300), points, groups[:3])
    with TpcReader(tmp_path / "t") as reader:
        assert reader.layout("walk") == "dense"
        got, got_groups = reader.points("walk", 250, 300)
        np.testing.assert_array_equal(got, points[250:])
        np.testing.assert_array_equal(got_groups, groups)
        with pytest.raises(InputError, match="no bones"):
            reader.transforms("walk")


def test_bad_rigid_clouds_are_refused(tmp_path):
    heads, rotations = np.zeros((10, 2, 3), np.float32), unit_quaternions(np.random.default_rng(0), 10, 2)
    with TpcWriter(tmp_path) as writer:
        with pytest.raises(InputError, match="were not added"):
            writer.add_rigid(a_row(skeleton="x"), heads, rotations)
        row = a_row(skeleton=writer.add_bones(some_bones()))
        with pytest.raises(InputError, match="heads of the shape"):
            writer.add_rigid(row, heads[:, :1], rotations)
        with pytest.raises(InputError, match="unit quaternions"):
            writer.add_rigid(row, heads, 0 * rotations)
        for change in (
            {"parents": np.array([-1, 1])},
            {"point_bones": np.array([0, 1, 2, 0, 0])},
            {"weights": np.array([-0.5, 1.5])},
            {"groups": np.array([0, 9])},
            {"point_alphas": np.full(5, np.nan)},
            {"point_offsets": np.zeros((4, 3))},
        ):
            with pytest.raises(InputError, match="The set of bones has"):
                writer.add_bones(replace(some_bones(), **change))


@settings(deadline=None, max_examples=15)
@given(st.integers(1, 600), st.integers(1, 40), st.sampled_from([np.float16, np.float32, np.float64]), st.data())
def test_latent_round_trip(frames, width, dtype, data):
    rng = np.random.default_rng(frames)
    latents, centroids = rng.normal(size=(frames, width)).astype(dtype), rng.normal(size=(frames, 3))
    start = data.draw(st.integers(0, frames - 1))
    with tempfile.TemporaryDirectory() as folder:
        with (
            write_artefact(Path(folder) / "l", "latent", stage="s", config={}) as draft,
            LatentWriter(draft.folder, "e" * 64) as writer,
        ):
            writer.add(a_row(frames=frames), latents, centroids)
        with LatentReader(Path(folder) / "l") as reader:
            got, got_centroids = reader.latents("walk", start)
            np.testing.assert_array_equal(got, latents[start:].astype(np.float32))
            np.testing.assert_array_equal(got_centroids, centroids[start:].astype(np.float32))
            assert got.dtype == got_centroids.dtype == np.float32


def test_latents_of_another_encoder_are_refused(tmp_path):
    with (
        write_artefact(tmp_path / "l", "latent", stage="s", config={}) as draft,
        LatentWriter(draft.folder, "e" * 64) as writer,
    ):
        writer.add(a_row(), np.zeros((10, 4)), np.zeros((10, 3)))
        with pytest.raises(InputError, match=r"expected \(10, 4\)"):
            writer.add(a_row("b"), np.zeros((10, 5)), np.zeros((10, 3)))
        with pytest.raises(InputError, match="not finite"):
            writer.add(a_row("b"), np.full((10, 4), np.nan), np.zeros((10, 3)))
    with LatentReader(open_artefact(tmp_path / "l")) as reader:
        reader.check_encoder("e" * 64)
        with pytest.raises(InputError, match="another encoder"):
            reader.check_encoder("f" * 64)
