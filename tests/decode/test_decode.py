"""`pumps decode`: latents to clouds, and onto skeletons between keyframes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.latent import ClipRow, LatentWriter
from data_schemas.motion import MotionReader, MotionWriter
from data_schemas.tpc import TpcReader
from stages.decode.config import Config
from stages.decode.run import group_counts, run
from stages.sample_tpc.config import Config as SampleConfig
from stages.sample_tpc.run import run as sample
from stages.shared.inference.clouds import place_on_pose
from stages.shared.inference.models import load_autoencoder
from stages.shared.kinematics.resampling import resample
from stages.shared.pointcloud.drawn_points import draw_on_skeleton
from stages.shared.solve.skeleton_pose import pose_of_motion
from tests.shared.inference.examples import humanoid, swinging, write_random_weights


def row_of(clip: str, frames: int, fps: float, skeleton: str, split: str = "test") -> ClipRow:
    return ClipRow(clip, f"{clip}.bvh", "0" * 64, skeleton, frames, fps, frames / fps, split, "CC0")


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A folder with `motion` (60 fps), `latent` of it and `ae`; two test clips, one of them short, and one other."""
    folder = tmp_path_factory.mktemp("decode")
    write_random_weights(folder)
    autoencoder = load_autoencoder(folder / "ae", "cpu")
    skeleton = humanoid(above=True)
    clips = {"long": (121, "test"), "short": (23, "test"), "other": (81, "train")}
    with (
        write_artefact(folder / "motion", "motion", stage="test", config={}, licences=["CC0"]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        name = writer.add_skeleton(skeleton)
        for seed, (clip, (frames, split)) in enumerate(clips.items()):
            writer.add_clip(row_of(clip, frames, 60.0, name, split), swinging(skeleton, frames, 60.0, seed))
    with (
        MotionReader(folder / "motion") as motions,
        write_artefact(folder / "latent", "latent", stage="test", config={}) as draft,
        LatentWriter(draft.folder, autoencoder.digest) as writer,
    ):
        for row in motions.clips:
            motion = resample(motions.motion(row.clip), 30.0)
            drawn = draw_on_skeleton(skeleton, 48, np.random.default_rng(0), 0.05)
            latents, centroids = autoencoder.encode(
                place_on_pose(drawn, pose_of_motion(skeleton, motion), skeleton), drawn.groups
            )
            here = row_of(row.clip, motion.frames, 30.0, row.skeleton, row.split)
            writer.add(here, latents.numpy(), centroids.numpy())
    return folder


def config(made: Path, output: Path, **options) -> Config:
    return Config(latent=made / "latent", ae=made / "ae", output=output, points=48, device="cpu", **options)


def test_clouds(made, tmp_path):
    report = run(config(made, tmp_path / "clouds"))
    assert report.figures["clips"] == 2 and report.figures["frames"] == 61 + 12
    with TpcReader(tmp_path / "clouds") as reader:
        assert {row.clip for row in reader.clips} == {"long", "short"}
        points, groups = reader.points("long")
        assert reader.layout("long") == "dense"
        assert points.shape == (61, 48, 3) and np.isfinite(points).all()
        np.testing.assert_array_equal(groups, group_counts(48))
        assert "test only" in reader.artefact.manifest.licences
    first = reader.artefact.manifest.digest
    run(config(made, tmp_path / "again"))
    with TpcReader(tmp_path / "again") as reader:
        assert reader.artefact.manifest.digest == first


def test_motions_keep_their_keys(made, tmp_path):
    report = run(config(made, tmp_path / "motions", motion=made / "motion", keyframes="0,10,20"))
    assert list(report.figures["skipped"]) == ["short"] and "go beyond the clip" in report.lines[1]
    with MotionReader(tmp_path / "motions") as reader, MotionReader(made / "motion") as source:
        motion, truth = reader.motion("long"), resample(source.motion("long"), 30.0)
        assert motion.fps == 30.0 and motion.frames == 61
        np.testing.assert_array_equal(motion.rotations[[0, 10, 20]], truth.rotations[[0, 10, 20]])
        assert not np.allclose(motion.rotations[5], truth.rotations[5])
        assert reader.skeleton(reader.row("long").skeleton).names == humanoid(above=True).names


def test_clouds_are_followed_between_keys(made, tmp_path):
    """From the points of a tpc artefact alone, rigid and baked, and the poses at the keys."""
    for name, bake in (("rigid", False), ("baked", True)):
        sample(SampleConfig(motion=made / "motion", output=tmp_path / f"{name}-tpc", points=120, bake=bake))
        options = {"tpc": tmp_path / f"{name}-tpc", "motion": made / "motion", "keyframes": "0,15,30,45,60"}
        report = run(Config(output=tmp_path / name, device="cpu", **options))
        assert list(report.figures["skipped"]) == ["short"]
        with MotionReader(tmp_path / name) as reader, MotionReader(made / "motion") as source:
            motion, truth = reader.motion("long"), resample(source.motion("long"), 30.0)
            seen = reader.skeleton(reader.row("long").skeleton).sampled
        turned = np.abs((motion.rotations[:, seen] * truth.rotations[:, seen]).sum(-1)).clip(0, 1)
        np.testing.assert_array_equal(motion.rotations[::15], truth.rotations[::15])
        assert np.degrees(2 * np.arccos(turned)).mean() < 3


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"splits": ("val",)}, InputError, "no clip in the splits"),
        ({"motion": "motion", "keyframes": "5000"}, InputError, "No clip could be decoded"),
        ({"motion": "motion", "keyframes": "often"}, UsageError, "cannot be read"),
        ({"motion": "ae"}, InputError, "motion"),
    ],
)
def test_refusals(made, tmp_path, options, error, says):
    if "motion" in options:
        options = {**options, "motion": made / options["motion"]}
    with pytest.raises(error, match=says):
        run(config(made, tmp_path / "out", **options))
    assert not (tmp_path / "out" / "manifest.json").exists()


def test_latents_of_another_encoder_are_refused(made, tmp_path):
    write_random_weights(tmp_path, seed=1)
    with pytest.raises(InputError, match="another encoder"):
        run(Config(latent=made / "latent", ae=tmp_path / "ae", output=tmp_path / "out"))


@pytest.mark.parametrize("points", [1, 7, 48, 256])
def test_group_counts(points: int):
    groups = group_counts(points)
    assert len(groups) == points and (np.diff(groups) >= 0).all()
    if points == 256:
        np.testing.assert_allclose(np.bincount(groups) / 256, (0.16, 0.155, 0.155, 0.265, 0.265), atol=0.01)
    assert torch.from_numpy(groups).dtype == torch.int64
