"""`pumps train denoiser` and its use: noise on windows of several rigs, learning, correcting, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import read_metrics
from data_schemas.tpc import TpcReader
from stages.denoise.config import Config as DenoiseConfig
from stages.denoise.run import run as denoise
from stages.measure.denoise.config import Config as MeasureConfig
from stages.measure.denoise.methods import MEND, TRUE_CLOUDS, TRUE_LATENTS
from stages.measure.denoise.run import run as measure
from stages.shared.inference.kept_models import kept_denoiser
from stages.shared.inference.latent_denoiser import LatentDenoiser, load_denoiser
from stages.shared.inference.latent_denoising import (
    LatentOptions,
    TrueDifferences,
    corrections_by,
    denoised_by_latents,
    scene_of,
)
from stages.shared.inference.models import load_weights, overlapping_windows
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.solve.skeleton_pose import SkeletonPose
from stages.shared.training.stage import window_pools
from stages.shared.training.task import RowRandom, step_random
from stages.shared.training.windows import Windows
from stages.train.denoiser import drawing
from stages.train.denoiser.config import Config
from stages.train.denoiser.noisy_windows import noisy_windows
from stages.train.denoiser.run import run
from stages.train.denoiser.task import DenoiserTask
from tests.shared.inference.examples import humanoid, swinging, write_random_weights
from tests.train.finetune.rig_clouds import RIG, write_rig_clouds

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    """Clouds, weights that were never trained, and a denoiser of their latents after two steps."""
    made = tmp_path_factory.mktemp("denoiser")
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setattr(drawing, "_HELD_BACK", 2)  # windows to validate on
    request.addfinalizer(monkeypatch.undo)
    write_rig_clouds(made)
    write_random_weights(made / "weights")
    run(config(made))
    return made


def config(folder: Path, **others) -> Config:
    given = {
        "tpc": folder / "tpc", "from_": str(folder / "weights"), "output": folder / "denoiser", "steps": 2,
        "batch": 2, "window": 24, "points": 16, "warmup": 1, "validate_every": 2, "average": 0.0, "device": "cpu",
        "overwrite": True,
    }  # fmt: skip
    return Config(**(given | others))


def loaded(folder: Path) -> LatentDenoiser:
    return load_denoiser(folder / "denoiser", load_weights(folder / "weights", "cpu", confidence=False).autoencoder)


def two_rigs() -> Windows:
    """A window of the example's skeleton, and a shorter one of its trunk and left arm alone, padded."""
    skeleton, frames = humanoid(), 30
    poses = [SkeletonPose.of_motion(skeleton, swinging(skeleton, frames, seed=seed)) for seed in (0, 1)]
    heads, rotations = torch.stack([p.heads for p in poses]), torch.stack([p.rotations for p in poses])
    parents = torch.as_tensor(skeleton.parents).long().repeat(2, 1)
    few = 5
    parents[1, few:] = -1
    heads[1, :, few:] = 0
    rotations[1, :, few:] = torch.tensor([0.0, 0.0, 0.0, 1.0])
    valid = torch.ones(2, frames, dtype=torch.bool)
    valid[1, 20:] = False
    tails = torch.as_tensor(skeleton.tails, dtype=torch.float32).repeat(2, 1, 1)
    return Windows(heads, rotations, valid, parents, tails, torch.zeros(2, 12).long(), torch.ones(2, 12))


def rows(numbers: range) -> RowRandom:
    return step_random(5, 1, 0, numbers)


@pytest.mark.parametrize("mended", [False, True])
def test_noise_keeps_bones_and_padding_and_is_each_windows_own(mended: bool):
    windows = two_rigs()
    noises = ["paper", "capture"]
    heads, rotations = noisy_windows(windows, noises, rows(range(2)).rows, mended=mended)
    assert float((heads - windows.heads).abs().max()) > 1e-3
    assert (heads[1, 20:] == windows.heads[1, 20:]).all() and (heads[1, :, 5:] == windows.heads[1, :, 5:]).all()
    for row, bones in ((0, 12), (1, 5)):
        parents = windows.parents[row, :bones].clamp_min(0)
        lengths, truth = (
            (each[row, :20, :bones] - each[row, :20, parents]).norm(dim=-1) for each in (heads, windows.heads)
        )
        torch.testing.assert_close(lengths, truth, atol=1e-4, rtol=0)
    torch.testing.assert_close(rotations.norm(dim=-1), torch.ones(2, 30, 12), atol=1e-4, rtol=0)
    single = Windows(*(getattr(windows, name)[1:] for name in Windows.__dataclass_fields__))
    part, _ = noisy_windows(single, noises[1:], rows(range(1, 2)).rows, mended=mended)
    torch.testing.assert_close(part, heads[1:])


def test_without_noise_windows_stay():
    windows = two_rigs()
    heads, rotations = noisy_windows(windows, ["none", "none"], rows(range(2)).rows, mended=False)
    assert (heads == windows.heads).all() and (rotations == windows.rotations).all()


def test_one_batch_is_learnt(folder: Path):
    models = load_weights("small-free", "cpu", confidence=False)
    with TpcReader(folder / "tpc") as reader:
        given = config(folder, noises=("paper",), start="noisy")
        task = DenoiserTask(given, models, *window_pools(reader, given), CPU)
        batch = task.draw(step_random(3, 1, 0, range(2)))
    optimiser, losses = torch.optim.Adam(task.networks.parameters(), lr=1e-3), []
    for _ in range(20):
        loss, figures = task.loss(batch, torch.Generator())  # pyright: ignore[reportArgumentType]
        if not losses:
            assert float(figures["cloud_of_start"]) == pytest.approx(1.0, abs=1e-3), "it starts at what it is given"
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert min(losses) < 0.95 * losses[0]
    assert all(p.grad is None for p in task.frozen.encoder.parameters())


def test_a_killed_run_resumes_to_the_same_weights(folder: Path):
    run(config(folder, output=folder / "whole", checkpoint_every=1))
    part = run(config(folder, output=folder / "part", checkpoint_every=1, max_time=1e-9))
    assert not part.figures["finished"]
    while not part.figures["finished"]:
        part = run(config(folder, output=folder / "part", checkpoint_every=1))
    one, two = (read_checkpoint(folder / name).weights for name in ("whole", "part"))
    assert all((one[name] == two[name]).all() for name in one)


def test_windows_of_a_long_clip_are_blended_as_one_by_one(folder: Path):
    denoiser, frames = loaded(folder), 61
    generator = torch.Generator().manual_seed(0)
    latents = torch.randn(frames, denoiser.network.latent_width, generator=generator)
    centroids, times = torch.randn(frames, 3, generator=generator), torch.arange(float(frames))
    made = denoiser.corrected(latents, centroids, times, denoiser.spans(frames))
    total, weight = torch.zeros_like(latents), torch.zeros(frames, 1)
    for start, stop, fade in overlapping_windows(frames, denoiser.window):
        given = torch.ones(1, stop - start, dtype=torch.bool)
        rows = slice(start, stop)
        with torch.no_grad():
            one, _ = denoiser.network.refine(latents[None, rows], centroids[None, rows], given, times[None, rows])
        total[start:stop] += fade[:, None] * one[0]
        weight[start:stop] += fade[:, None]
    torch.testing.assert_close(made[0], total / weight, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("fps", [30.0, 75.0])
def test_a_denoiser_that_corrects_nothing_changes_nothing(folder: Path, fps: float):
    denoiser, skeleton = loaded(folder), humanoid()
    torch.nn.init.zeros_(denoiser.network.out.weight)
    torch.nn.init.zeros_(denoiser.network.out.bias)
    motion = swinging(skeleton, 70, fps)
    made = denoised_by_latents(denoiser, skeleton, motion, motion, LatentOptions(points=32, views=2))
    assert made.frames == motion.frames and made.fps == fps
    np.testing.assert_allclose(positions_of(skeleton, made), positions_of(skeleton, motion), atol=1e-5)


def test_true_clouds_bring_a_noisy_motion_to_the_truth():
    skeleton = humanoid()
    local = SkeletonPose.of_motion(skeleton, swinging(skeleton, 40))
    turns = 0.2 * torch.randn(40, 12, 3, generator=torch.Generator().manual_seed(0))
    noisy = local.corrected(turns, torch.zeros(40, 3))
    scene = scene_of(noisy, np.arange(40.0), 30.0)
    found = corrections_by(TrueDifferences(local), scene, LatentOptions())
    made = noisy.corrected(found.turns, found.shifts)

    def error(pose: SkeletonPose) -> float:
        return float((pose.heads - local.heads)[:, skeleton.sampled].norm(dim=-1).mean())

    assert error(made) < 0.1 * error(noisy)


def test_denoise_and_measure_use_it(folder: Path):
    common = {"fill": str(folder / "weights"), "device": "cpu", "overwrite": True}
    report = denoise(
        DenoiseConfig(
            input=Path(RIG), output=folder / "out.bvh", method="latent", weights=folder / "denoiser", **common
        )
    )
    assert report.figures["frames"] == 152 and (folder / "out.bvh").exists()
    settings = {"tpc": folder / "tpc", "skeleton": RIG, "window": 32, "max_windows": 1, "filters": (), **common}
    weights = (f"latent={folder / 'denoiser'}",)
    measure(MeasureConfig(**settings, weights=weights, breakdown=True, output=folder / "measured"))
    rows_of, page = read_metrics(folder / "measured")
    values = {row.method: row.value for row in rows_of if row.metric == "mpjpe_mm"}
    assert set(values) == {"noisy", MEND, "latent", TRUE_LATENTS, TRUE_CLOUDS} and "true latents" in page
    assert values[TRUE_CLOUDS] < 0.3 * values[MEND]


def test_a_denoiser_is_loaded_once_for_many_files(folder: Path):
    given = (folder / "denoiser", str(folder / "weights"), "cpu")
    assert kept_denoiser(*given) is kept_denoiser(*given)


def test_what_does_not_belong_together_is_refused(folder: Path):
    output = folder / "never.bvh"
    for error, words, options in (
        (UsageError, "needs a denoiser", {}),
        (InputError, "another autoencoder", {"weights": folder / "denoiser", "fill": "small-free"}),
        (InputError, "no denoiser", {"weights": folder / "weights" / "lms", "fill": str(folder / "weights")}),
    ):
        with pytest.raises(error, match=words):
            denoise(DenoiseConfig(input=Path(RIG), output=output, method="latent", device="cpu", **options))
    assert not output.exists()
