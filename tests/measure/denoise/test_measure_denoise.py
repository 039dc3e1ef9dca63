"""Table 4 from end to end at toy size: a rig's motions, every kind of network trained for two steps, all measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import read_metrics
from pumps_cli.app import main
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.measure.denoise.config import Config
from stages.measure.denoise.methods import MEND, NOISY, best_widths, filtered
from stages.measure.denoise.run import run
from stages.measure.denoise.summary import METRICS
from stages.sample_tpc.config import Config as SampleConfig
from stages.sample_tpc.run import run as sample
from stages.shared.formats.rig_file import rig_of_file
from stages.shared.kinematics.motion_filters import FILTERS, laplacian
from stages.shared.networks.denoisers.denoisers import DENOISERS, SIZES, denoiser
from stages.shared.networks.layers.sizes import MethodSizes
from stages.shared.pose_tasks.body_pose import BodyPose
from stages.train.baseline.config import Config as BaselineConfig
from stages.train.baseline.run import run as train_baseline
from stages.train.finetune.config import Config as TrainConfig
from stages.train.finetune.run import run as finetune
from tests.docs.pages import ROOT

CLIPS = ROOT / "stages" / "shared" / "clips"
RIG = str(CLIPS / "walk.bvh")
SMALL: dict[str, Any] = {
    "steps": 2,
    "batch": 2,
    "window": 16,
    "warmup": 1,
    "validate_every": 2,
    "checkpoint_every": 2,
}


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("table4")
    sources = tuple(str(CLIPS / f"{name}.bvh") for name in ("walk", "run", "kick"))
    (folder / "splits.json").write_text('{"clips": {"test": ["walk.bvh"], "val": ["kick.bvh"], "train": "the rest"}}')
    ingest(
        IngestConfig(
            sources=sources, output=folder / "ingest", licence="CC0", workers=1, splits=folder / "splits.json"
        )
    )
    sample(SampleConfig(motion=folder / "ingest", output=folder / "tpc"))
    return folder


def _network(motions: Path, name: str, **settings) -> Path:
    output = motions / name
    given = {"task": "denoise", "skeleton": RIG, "from_": "scratch", "device": "cpu", **SMALL, **settings}
    finetune(TrainConfig(tpc=motions / "tpc", output=output, **given))
    return output


def _baseline(motions: Path, method: str) -> Path:
    output, sizes = motions / method, MethodSizes(width=16, layers=2, heads=2)
    train_baseline(
        BaselineConfig(tpc=motions / "tpc", output=output, method=method, network=sizes, device="cpu", **SMALL)
    )
    return output


def _measured(motions: Path, name: str, *weights: str, **settings) -> Path:
    given = {"skeleton": RIG, "window": 24, "tune_windows": 2, "max_windows": 2, "device": "cpu", **settings}
    run(Config(tpc=motions / "tpc", weights=weights, output=motions / name, **given))
    return motions / name


@pytest.fixture(scope="module")
def measured(motions: Path) -> Path:
    trained = {kind: _network(motions, kind, network=kind) for kind in DENOISERS}
    trained |= {"pumps": _network(motions, "pumps", from_="small-free")}
    trained |= {"pose-ndf": _baseline(motions, "pose-ndf"), "motion-vae": _baseline(motions, "motion-vae")}
    return _measured(motions, "measured", *(f"{name}={path}" for name, path in trained.items()))


def test_every_method_is_measured_on_the_same_windows(measured: Path):
    rows, summary = read_metrics(measured)
    methods = {NOISY, MEND, "pumps", "pose-ndf", "motion-vae", *FILTERS, *DENOISERS}
    assert {row.method for row in rows} == methods and {row.metric for row in rows} == set(METRICS)
    assert {row.archive for row in rows} == {"walk"} and all(row.windows == 2 for row in rows)
    assert all(np.isfinite(row.value) and row.value > 0 for row in rows)
    for text in ("MPJPE, mm", "Acceleration error", *methods):
        assert text in summary
    values = {row.method: row.value for row in rows if row.metric == METRICS[0]}
    assert values[MEND] < min(values[name] for name in FILTERS) < values[NOISY]
    # Networks that begin at the noisy pose are near it after two steps.
    assert all(abs(values[kind] - values[NOISY]) < 0.2 * values[NOISY] for kind in DENOISERS)


def test_results_shows_the_page(measured: Path, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as leaving:
        main(["results", str(measured)])
    assert leaving.value.code in (None, 0) and "PUMPS Table 4" in capsys.readouterr().out


def test_clean_clips_show_what_cleaning_does_to_them(motions: Path):
    rows, _ = read_metrics(_measured(motions, "clean", noise="none", widths=(1.0,)))
    values = {(row.method, row.metric): row.value for row in rows}
    assert values[NOISY, "mpjpe_mm"] == 0 and values["laplacian", "mpjpe_mm"] > 0


def test_the_noise_depends_on_the_seed_alone(motions: Path):
    first, again, other = (
        read_metrics(_measured(motions, name, filters=(), seed=seed))[0]
        for name, seed in (("one", 1), ("again", 1), ("other", 2))
    )
    assert [row.value for row in first] == [row.value for row in again] != [row.value for row in other]


def test_what_cannot_be_measured_is_refused(motions: Path, measured: Path):
    weights = f"a={motions / 'transformer'}"
    for error, words, given, settings in (
        (UsageError, "no filter 'median'", (), {"filters": ("median",)}),
        (UsageError, "called 'a'", (weights, weights), {}),
        (UsageError, "Nothing says which rig", (), {"skeleton": None}),
        (InputError, "900 frames", (), {"window": 900}),
    ):
        with pytest.raises(error, match=words):
            _measured(motions, "no", *given, **settings)
    with pytest.raises(InputError, match="fills gaps and cannot clean"):
        _measured(motions, "no", f"a={_baseline(motions, 'delta')}")
    with pytest.raises(UsageError, match="reads keypoints"):
        _network(motions, "wrong", network="mixste")
    assert not (motions / "no").exists()


def test_the_width_is_the_one_with_the_least_error():
    rig = rig_of_file(RIG)
    generator = torch.Generator().manual_seed(0)
    roots = torch.cumsum(0.01 * torch.randn(1, 40, 3, generator=generator), dim=1)
    clean = BodyPose(roots, rig.body.rest_world.expand(1, 40, -1, 4))
    made = filtered(rig, clean, laplacian, 3.0)
    # What the filter of width 3 makes of a motion is the truth for that motion with noise.
    assert best_widths(rig, ("laplacian",), (1.0, 3.0, 6.0), clean, made) == {"laplacian": 3.0}


@pytest.mark.parametrize("kind", DENOISERS)
def test_networks_begin_at_the_base_ignore_padding_and_learn(kind: str):
    torch.manual_seed(0)
    frames, inputs, outputs = 7, 12, 9
    network = denoiser(kind, inputs, outputs, SIZES[kind])
    features, times = torch.randn(2, frames, inputs), torch.arange(float(frames)).unsqueeze(0)
    given = torch.ones(2, frames, dtype=torch.bool)
    assert (network(features, given, times) == 0).all()
    optimiser = torch.optim.Adam(network.parameters(), lr=2e-3)
    target, losses = torch.randn(2, frames, outputs), []
    for _ in range(8):
        loss = (network(features, given, times) - target).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert min(losses) < 0.95 * losses[0]
    assert all(parameter.grad is not None for parameter in network.parameters())
    valid = given.clone()
    valid[:, 5:] = False
    changed = features.clone()
    changed[:, 5:] += 10
    with torch.no_grad():
        one, other = (network(each, valid, times, valid)[:, :5] for each in (features, changed))
    torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-4)
