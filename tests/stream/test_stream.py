"""Streaming: the channel's statistics, quantised numbers, what is held, the experiment from end to end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from data_schemas.errors import UsageError
from data_schemas.manifest import open_artefact
from data_schemas.metrics import read_metrics
from stages.shared.inference.part_models import load_part_body
from stages.shared.kinematics.rotations import angles_between
from stages.stream.channel import arrived, held, quantised, quantised_rotations
from stages.stream.config import Config
from stages.stream.run import run
from stages.stream.summary import BYTES, ERROR, SEEN, UNSEEN, loss_task, mean_of
from stages.stream.ways import bytes_of_parts, bytes_of_rotations, range_of, streamed_parts, streamed_rotations
from stages.train.body_parts.run import run as train
from tests.train.body_parts.small_parts import ingested, settings


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stream")
    motion = ingested(folder)
    for parts in (1, 5):
        train(settings(motion, folder / str(parts), parts=parts))
    return folder


@pytest.mark.parametrize(("loss", "burst"), [(0.05, 1.0), (0.1, 3.0), (0.3, 3.0), (0.3, 8.0)])
def test_the_channel_loses_its_share_in_runs_of_its_length(loss: float, burst: float):
    there = arrived(400_000, loss, burst, np.random.default_rng(1))
    assert 1 - there.mean() == pytest.approx(loss, rel=0.06)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], there, [True]]).astype(int)))
    runs = edges[1::2] - edges[::2]
    assert runs.mean() == pytest.approx(burst, rel=0.06)
    # Runs of a chain of two states have geometric lengths.
    assert (runs == 1).mean() == pytest.approx(1 / burst, rel=0.06)


def test_nothing_is_lost_without_loss():
    assert arrived(100, 0.0, 3.0, np.random.default_rng(0)).all()


def test_quantised_numbers_are_within_half_a_level_and_cut_at_the_ends():
    rng = np.random.default_rng(0)
    low, high = np.array([-1.0, 0.0]), np.array([1.0, 10.0])
    values = low + (high - low) * rng.random((500, 2))
    for bits in (4, 8):
        apart = np.abs(quantised(values, low, high, bits) - values) / (high - low)
        assert apart.max() <= 0.5 / (2**bits - 1) + 1e-12
        assert len(np.unique(quantised(values, low, high, bits)[:, 0])) <= 2**bits
    np.testing.assert_allclose(quantised(np.array([[-9.0, 99.0]]), low, high, 8), [[-1.0, 10.0]])


def test_rotations_of_32_bits_are_within_a_fifth_of_a_degree():
    rotations = Rotation.random(5000, np.random.default_rng(2)).as_quat()
    apart = np.degrees(angles_between(quantised_rotations(rotations), rotations))
    assert 0.02 < apart.max() < 0.3


def test_the_last_row_that_arrived_is_held():
    values, there = np.arange(6.0), np.array([False, True, False, False, True, False])
    np.testing.assert_array_equal(held(values, there, np.array(-1.0)), [-1, 1, 1, 1, 4, 4])


def test_held_rotations_between_packets():
    local = Rotation.random(14, np.random.default_rng(0)).as_quat().reshape(7, 2, 4)
    made, packets = streamed_rotations(local, 3, lambda count: np.array([True, False, True])[:count])
    assert packets == 3
    sent = quantised_rotations(local)
    np.testing.assert_array_equal(made, sent[[0, 0, 0, 0, 0, 0, 6]])


def test_a_lost_packet_changes_its_part_s_window_alone(trained: Path):
    body = load_part_body(str(trained / "5"), "cpu")
    generator = torch.Generator().manual_seed(0)
    columns = torch.randn(4, body.window, len(body.body.joints), 6, generator=generator)
    known = range_of(body, columns)
    whole, packets = streamed_parts(body, columns, known, 8, lambda count: np.ones(count, bool))
    assert packets == 20
    there = np.ones((4, 5), bool)
    there[2, 1] = False  # the left arm in the third window
    made, _ = streamed_parts(body, columns, known, 8, lambda count: there.ravel())
    own = body.parts[1].part.own
    changed = (made != whole).any(-1).any(1)
    assert set(torch.nonzero(changed)[:, 0].tolist()) == {2}
    assert set(torch.nonzero(changed)[:, 1].tolist()) == set(own.tolist())
    assert torch.equal(made[2, :, own], whole[1, -1:, own].expand(body.window, -1, -1))


def test_bytes_a_second():
    assert bytes_of_parts([20] * 5, 8, 32, 0.5) == 2 * 5 * 52
    assert bytes_of_parts([100], 4, 32, 0.5) == 2 * 82
    assert bytes_of_rotations(31, 1, 120.0, 32) == 120 * (32 + 124)
    assert bytes_of_rotations(31, 8, 120.0, 32) == 15 * (32 + 124)


def test_the_experiment_from_end_to_end(trained: Path, tmp_path: Path):
    weights = tuple(f"BPs{parts}={trained / str(parts)}" for parts in (1, 5))
    config = Config(
        motion=trained / "ingest", weights=weights, output=tmp_path / "out", seeds=2, loss=(0.0, 0.3), device="cpu"
    )
    report = run(config)
    rows, page = read_metrics(tmp_path / "out")
    methods = {row.method for row in rows if row.metric == BYTES}
    assert methods == {"BPs1", "BPs5", "rotations", "rotations, every 8 frames"}
    assert mean_of(rows, "rotations", loss_task(0.0), ERROR) < 0.2
    assert mean_of(rows, "rotations", loss_task(0.3), ERROR) > mean_of(rows, "rotations", loss_task(0.0), ERROR)
    # Without legs the spine and the arms of five parts are what they were; those of one network are not.
    apart = {name: mean_of(rows, name, UNSEEN, ERROR) - mean_of(rows, name, SEEN, ERROR) for name in ("BPs1", "BPs5")}
    assert abs(apart["BPs5"]) < 1e-6 < abs(apart["BPs1"])
    assert "## Advice" in page and report.lines[-1] in page
    assert (open_artefact(tmp_path / "out", "metrics").folder / "streaming.svg").read_text().startswith("<svg")


def test_a_loss_that_no_such_channel_has_is_refused(trained: Path, tmp_path: Path):
    with pytest.raises(UsageError, match=r"A loss of 0\.9 cannot be in runs of 3"):
        run(Config(motion=trained / "ingest", weights=(str(trained / "5"),), output=tmp_path / "out", loss=(0.9,)))
