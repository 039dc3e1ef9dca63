"""Table 3 from end to end at toy size: a rig's motions, every kind of network trained for two steps, all measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import read_metrics
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.measure.estimate.config import Config
from stages.measure.estimate.run import run
from stages.measure.estimate.summary import METRICS, REST
from stages.sample_tpc.config import Config as SampleConfig
from stages.sample_tpc.run import run as sample
from stages.shared.networks.lifters.lifters import CAMERA_FEATURES, LIFTERS, SIZES, lifter
from stages.shared.statistics.category_tables import word_or_category
from stages.train.finetune.config import Config as TrainConfig
from stages.train.finetune.run import run as finetune
from tests.docs.pages import ROOT

CLIPS = ROOT / "stages" / "shared" / "clips"


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("table3")
    names = ("walk", "run", "kick")
    sources = tuple(str(CLIPS / f"{name}.bvh") for name in names)
    (folder / "splits.json").write_text('{"clips": {"test": ["walk.bvh"], "val": ["kick.bvh"], "train": "the rest"}}')
    ingest(
        IngestConfig(
            sources=sources, output=folder / "ingest", licence="CC0", workers=1, splits=folder / "splits.json"
        )
    )
    sample(SampleConfig(motion=folder / "ingest", output=folder / "tpc"))
    return folder


def _trained(motions: Path, name: str, **settings) -> Path:
    output = motions / name
    small = {"steps": 2, "batch": 2, "window": 16, "warmup": 1, "validate_every": 2, "checkpoint_every": 2}
    finetune(
        TrainConfig(
            task="estimate",
            skeleton=str(CLIPS / "walk.bvh"),
            tpc=motions / "tpc",
            output=output,
            device="cpu",
            **{"from_": "scratch", **small, **settings},
        )
    )
    return output


@pytest.fixture(scope="module")
def measured(motions: Path) -> Path:
    trained = {kind: _trained(motions, kind, network=kind) for kind in LIFTERS}
    trained["pumps"] = _trained(motions, "pumps", from_="small-free")
    output = motions / "measured"
    weights = tuple(f"{name}={path}" for name, path in trained.items())
    run(Config(tpc=motions / "tpc", weights=weights, output=output, window=24, max_windows=2, device="cpu"))
    return output


def test_every_network_and_the_rest_pose_are_measured_on_the_same_windows(measured: Path):
    rows, summary = read_metrics(measured)
    assert {row.method for row in rows} == {REST, *LIFTERS, "pumps"} and {row.metric for row in rows} == set(METRICS)
    assert {row.archive for row in rows} == {"walk"} and all(row.windows == 2 for row in rows)
    assert all(np.isfinite(row.value) and row.value > 0 for row in rows)
    for title in ("MPJPE, mm", "MPJVE", *LIFTERS):
        assert title in summary


def test_networks_of_other_keypoints_are_not_compared(motions: Path, measured: Path):
    other = _trained(motions, "detector", network="poseformer", corruption="detector")
    weights = (f"a={motions / 'poseformer'}", f"b={other}")
    with pytest.raises(InputError, match="see different keypoints"):
        run(Config(tpc=motions / "tpc", weights=weights, output=motions / "no", window=24))
    with pytest.raises(UsageError, match="called 'a'"):
        run(Config(tpc=motions / "tpc", weights=(weights[0], weights[0]), output=motions / "no", window=24))
    with pytest.raises(InputError, match="900 frames"):
        run(Config(tpc=motions / "tpc", weights=weights[:1], output=motions / "no", window=900))


@pytest.mark.parametrize("kind", LIFTERS)
def test_lifters_begin_at_the_base_ignore_padding_and_learn(kind: str):
    torch.manual_seed(0)
    points, frames, outputs = 5, 7, 9
    network = lifter(kind, 3 * points + CAMERA_FEATURES, outputs, SIZES[kind])
    features = torch.randn(2, frames, 3 * points + CAMERA_FEATURES)
    given, times = torch.ones(2, frames, dtype=torch.bool), torch.arange(float(frames)).unsqueeze(0)
    made = network(features, given, times)
    assert made.shape == (2, frames, outputs) and (made == 0).all()
    optimiser = torch.optim.Adam(network.parameters(), lr=2e-3)
    target = torch.randn(2, frames, outputs)
    losses = []
    for _ in range(8):
        loss = (network(features, given, times) - target).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert min(losses) < 0.95 * losses[0]
    valid = given.clone()
    valid[:, 5:] = False
    changed = features.clone()
    changed[:, 5:] += 10
    with torch.no_grad():
        one, other = (network(each, valid, times, valid)[:, :5] for each in (features, changed))
    torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize(
    ("source", "category"),
    [("a.zip!a/walk3_subject4.bvh", "walk"), ("fallAndGetUp1_subject1.bvh", "fallAndGetUp"), ("01_02.amc", "other")],
)
def test_categories_come_from_file_names(source: str, category: str):
    class Row:
        pass

    row = Row()
    row.source = source  # pyright: ignore[reportAttributeAccessIssue]
    assert word_or_category(row, {}) == category  # pyright: ignore[reportArgumentType]
    assert word_or_category(row, {"W": "*walk*"}) == ("W" if "walk" in source else None)  # pyright: ignore[reportArgumentType]
