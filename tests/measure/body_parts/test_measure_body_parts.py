"""Measuring body parts at toy size: rows, tables, locality, noise, parts put together, bad input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import open_artefact
from data_schemas.metrics import read_metrics
from data_schemas.skeleton import BODY_GROUPS
from stages.measure.body_parts.config import Config
from stages.measure.body_parts.noise import tampered_slices, with_input_noise, with_tampering, with_zeros
from stages.measure.body_parts.run import run
from stages.measure.body_parts.summary import METRICS, SCENARIOS, harms_of
from stages.shared.inference.part_models import load_part_body
from stages.train.body_parts.run import run as train
from tests.train.body_parts.small_parts import ingested, settings


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("measured")
    motion = ingested(folder)
    for parts, network in ((1, "ae"), (2, "vae"), (5, "ae"), (5, "svae")):
        train(settings(motion, folder / f"{parts}-{network}", parts=parts, network=network))
    return folder


def _config(trained: Path, output: Path, *weights: str, **changed) -> Config:
    named = tuple(f"{name}={trained / name}" for name in weights)
    values = {
        "motion": f"clips={trained / 'ingest'}",
        "weights": named,
        "output": output,
        "seeds": 2,
        "device": "cpu",
    }
    return Config.model_validate({**values, **changed})


def test_rows_and_tables_of_seen_and_unseen_data(trained: Path, tmp_path: Path):
    weights = ("1-ae", "2-vae", "5-ae", "5-svae")
    unseen = (f"again={trained / 'ingest'}",)
    report = run(_config(trained, tmp_path / "out", *weights, unseen=unseen, unseen_splits=("train",)))
    rows, page = read_metrics(tmp_path / "out")
    for metric in METRICS:
        for scenario in SCENARIOS:
            found = [row for row in rows if row.metric == metric and row.task == scenario]
            assert {(row.method, row.archive) for row in found} == {
                (w, s) for w in weights for s in ("clips", "again")
            }
            assert all(row.value > 0 for row in found)
    plain = {row.method: row.value for row in rows if row.metric == "mpjpe_180_cm_over_seeds" and row.task == "plain"}
    assert plain["1-ae"] == plain["5-ae"] == 0 and plain["2-vae"] > 0 and plain["5-svae"] > 0
    for words in ("## Table 1: clips", "## Table 1: again", "## Table 2", "### latent noise", "| paper, MHAD |"):
        assert words in page
    assert "## Locality" in page and any("is best with" in line for line in report.lines)
    assert (open_artefact(tmp_path / "out", "metrics").folder / "locality.svg").read_text().startswith("<svg")


def test_an_error_stays_in_its_part_and_reaches_the_whole_body_of_one_part(trained: Path, tmp_path: Path):
    run(_config(trained, tmp_path / "out", "1-ae", "5-ae"))
    rows, _ = read_metrics(tmp_path / "out")
    far = harms_of(rows, "5-ae", BODY_GROUPS)
    turned = harms_of(rows, "5-ae", BODY_GROUPS, "local_deg")
    off = ~np.eye(5, dtype=bool)
    assert (np.diag(turned) > 0.05).all() and turned[off].max() < 1e-3
    assert far[1:][off[1:]].max() < 1e-3  # a limb moves nothing else; the spine carries the others
    assert (far[0] > 0.02).all()
    whole = harms_of(rows, "1-ae", [f"fifth {n}" for n in range(1, 6)], "local_deg")
    assert (whole > 0.003).all()


def test_the_same_seed_gives_the_same_rows(trained: Path, tmp_path: Path):
    for name in ("a", "b"):
        run(_config(trained, tmp_path / name, "5-svae"))
    assert read_metrics(tmp_path / "a")[0] == read_metrics(tmp_path / "b")[0]


def test_parts_of_two_networks_are_measured_as_one_body(trained: Path, tmp_path: Path):
    mixed = "+".join(f"{trained / '5-svae'}:{g}" for g in ("left_arm", "right_arm"))
    mixed += "+" + "+".join(f"{trained / '5-ae'}:{g}" for g in ("left_leg", "right_leg", "spine"))
    body = load_part_body(mixed, "cpu")
    assert body.parts[0].part.name == "spine" and body.kinds == "ae+svae"
    run(_config(trained, tmp_path / "out", weights=(f"mixed={mixed}",)))
    assert {row.method for row in read_metrics(tmp_path / "out")[0]} == {"mixed"}


def test_bad_input_is_refused_before_anything_is_written(trained: Path, tmp_path: Path):
    with pytest.raises(UsageError, match="twice"):
        run(_config(trained, tmp_path / "out", "1-ae", "1-ae"))
    with pytest.raises(InputError, match="checkpoint"):
        run(_config(trained, tmp_path / "out", weights=(f"x={trained / 'ingest'}",)))
    with pytest.raises(UsageError, match="has no part 'tail'"):
        run(_config(trained, tmp_path / "out", weights=(f"x={trained / '1-ae'}:tail",)))
    assert not (tmp_path / "out").exists()


def test_input_noise_turns_by_its_deviation():
    local = torch.from_numpy(Rotation.random(6000, np.random.default_rng(0)).as_quat()).float().reshape(10, 20, 30, 4)
    noisy = with_input_noise(local, 5.0, torch.Generator().manual_seed(1))
    turns = (Rotation.from_quat(local.reshape(-1, 4)).inv() * Rotation.from_quat(noisy.reshape(-1, 4))).as_rotvec()
    assert np.degrees(turns.std(axis=0)) == pytest.approx([5, 5, 5], rel=0.05)
    assert np.abs(np.degrees(turns.mean(axis=0))).max() < 0.3


def test_a_tenth_of_each_window_s_latent_is_zero():
    latents = [torch.ones(50, 30), torch.ones(50, 20)]
    made = with_zeros(latents, 0.1, torch.Generator().manual_seed(1))
    zeros = torch.cat(made, dim=1) == 0
    assert (zeros.sum(1) == 5).all() and (zeros.sum(0) > 0).sum() > 45
    assert [each.shape for each in made] == [(50, 30), (50, 20)] and (latents[0] == 1).all()


def test_tampering_changes_one_piece_by_its_deviation():
    assert tampered_slices([10], 5) == [(0, slice(start, start + 2)) for start in range(0, 10, 2)]
    assert tampered_slices([4, 3], 5) == [(0, slice(0, 4)), (1, slice(0, 3))]
    latents = [torch.randn(4000, 4, generator=torch.Generator().manual_seed(0)) * 3, torch.zeros(4000, 2)]
    made = with_tampering(latents, 0, slice(1, 3), 0.5, torch.Generator().manual_seed(1))
    change = made[0] - latents[0]
    assert (change[:, [0, 3]] == 0).all() and (made[1] == 0).all()
    assert change[:, 1:3].std(0).tolist() == pytest.approx([1.5, 1.5], rel=0.1)
