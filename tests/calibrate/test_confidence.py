"""The learned confidence: right where corrections are right, none where they are noise, careful about families."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.motion import MotionWriter
from stages.calibrate.config import Config
from stages.calibrate.fit import Sums, careful_fit, fit, gain
from stages.calibrate.run import run
from stages.inference.confidence import (
    GAP_EDGES,
    PARTS,
    SHAPE,
    Confidence,
    gap_sizes,
    read_confidence,
    trust_of,
    write_confidence,
)
from stages.inference.filling import fill_motion
from stages.inference.models import load_weights
from stages.inference.solving import Corrections
from stages.inference.token_times import choose_tokens
from tests.inference.examples import humanoid, swinging, write_random_weights

DEPTH = np.linspace(0.1, 1, 10)


def _sums(edge: float, middle: float, noise: float, seed: int = 0, gaps: int = 200) -> Sums:
    """Gaps in one bin whose true corrections are known shares of those made, and noise."""
    rng = np.random.default_rng(seed)
    sums = Sums()
    for _ in range(gaps):
        made = rng.normal(size=(10, 4, 3))
        share = (1 - DEPTH) * edge + DEPTH * middle
        sums.add((1, 2, 3), DEPTH, made, share[:, None, None] * made + noise * rng.normal(size=made.shape))
    return sums


def test_the_fit_finds_the_share_that_is_true() -> None:
    trust = fit([_sums(0.3, 0.8, 0.2)], prior=1.0)
    np.testing.assert_allclose(trust[1, 2, 3], [0.3, 0.8], atol=0.03)
    assert trust.shape == SHAPE and trust.min() >= 0 and trust.max() <= 1


def test_corrections_that_mean_nothing_get_no_trust_and_wrong_ones_none_at_all() -> None:
    noise = _sums(0.0, 0.0, 1.0)
    assert fit([noise], prior=1.0)[1, 2, 3].max() < 0.05
    assert fit([_sums(-1.0, -1.0, 0.1)], prior=1.0).max() == 0
    assert gain(noise, np.ones(SHAPE)) < -0.5 and abs(gain(noise, fit([noise], prior=1.0))) < 0.01


def test_bins_that_heard_little_follow_the_wider_bin() -> None:
    sums = _sums(0.8, 0.8, 0.1)
    one = np.ones((10, 4, 3))
    sums.add((1, 2, 4), DEPTH, one, 0 * one)  # a single gap that says no
    trust = fit([sums], prior=4.0)
    assert trust[1, 2, 4].mean() > 0.4 and abs(trust[0, 0, 0].mean() - trust[1, 2, 3].mean()) < 0.2


def test_what_one_family_alone_says_is_not_believed() -> None:
    archives = {
        "a": _sums(0.9, 0.9, 0.1, gaps=400),
        "b": _sums(0.1, 0.1, 0.1, 1, 20),
        "c": _sums(0.2, 0.2, 0.1, 2, 20),
    }
    careful = careful_fit(archives, 1.0)[1, 2, 3]
    assert careful.max() < 0.2 < fit(list(archives.values()), 1.0)[1, 2, 3].min()
    assert gain(archives["b"], careful_fit(archives, 1.0)) > 0


def _corrections(tokens: int, joints: int, size: float) -> Corrections:
    generator = torch.Generator().manual_seed(0)
    turns = size * torch.randn(tokens, joints, 3, generator=generator)
    seen = torch.ones(joints, dtype=torch.bool)
    return Corrections(turns, 0.1 * turns[:, 0], seen, torch.zeros(tokens))


def test_trust_runs_from_the_keys_to_the_middle_by_gap_part_and_size() -> None:
    skeleton = humanoid()
    tokens = choose_tokens(np.array([0, 10, 40]), 61, 30.0)
    table = np.zeros(SHAPE)
    table[..., 1] = 1
    for gap, edges in zip(tokens.gaps(), ((0, 10), (10, 40), (40, 100)), strict=True):
        sizes = gap_sizes(tokens, gap, skeleton, _corrections(61, skeleton.joints, 0.1))
        assert sizes.length_bin == np.digitize(edges[1] - edges[0], GAP_EDGES) or edges[0] == 40
        turns, shifts = trust_of(Confidence(table), tokens, gap, skeleton, _corrections(61, skeleton.joints, 0.1))
        assert turns.shape == (len(gap), skeleton.joints) and shifts.shape == (len(gap),)
        assert torch.allclose(shifts, torch.as_tensor(sizes.depth, dtype=torch.float32))
        assert float(shifts.min()) > 0 and float(shifts.max()) <= 1
    small, large = (
        gap_sizes(tokens, tokens.gaps()[0], skeleton, _corrections(61, skeleton.joints, size)).size_bins
        for size in (0.001, 1.0)
    )
    assert len(small) == len(PARTS) and (small < large).all()


def test_no_trust_gives_the_plain_interpolation_and_the_table_is_read_back(tmp_path: Path) -> None:
    weights = write_random_weights(tmp_path / "weights")
    skeleton = humanoid()
    motion = swinging(skeleton, 31)
    known = np.arange(31) % 15 == 0
    models = load_weights(weights, "cpu")
    assert models.confidence is None
    write_confidence(weights / "confidence.json", Confidence(np.zeros(SHAPE)), {})
    wary = load_weights(weights, "cpu")
    assert wary.confidence is not None and wary.confidence.trust.max() == 0
    filled = fill_motion(skeleton, motion, known, wary, points=48)
    assert filled.plain[~known].all()
    sure = replace(wary, confidence=Confidence(np.ones(SHAPE)))
    assert not fill_motion(skeleton, motion, known, sure, points=48).plain[~known][:, skeleton.sampled].all()
    content = json.loads((weights / "confidence.json").read_text())
    for change in ({"trust": [[2.0]]}, {"version": 99}, {"gap_edges": [1]}):
        (weights / "confidence.json").write_text(json.dumps(content | change))
        with pytest.raises(InputError, match=r"confidence\.json"):
            read_confidence(weights)


def test_calibrating_writes_a_confidence_beside_the_weights(tmp_path: Path) -> None:
    weights = write_random_weights(tmp_path / "weights")
    with (
        write_artefact(tmp_path / "motion", "motion", stage="ingest", config={}) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        skeleton = writer.add_skeleton(humanoid())
        for number in range(2):
            motion = swinging(humanoid(), 70, seed=number)
            row = ClipRow(f"c{number}", f"{number}.zip!c", "0" * 64, skeleton, 70, 30.0, 70 / 30, "val", "CC0")
            writer.add_clip(row, motion)
    report = run(
        Config(
            weights=str(weights), motion=tmp_path / "motion", intervals=(15,), transitions=(15,), predictions=(),
            window=61, max_windows=1, points=48, device="cpu",
        )
    )  # fmt: skip
    assert report.figures["windows"] == 4 and set(report.figures["gains"]) == {"0", "1"}
    found = read_confidence(weights)
    assert found is not None and found.trust.shape == SHAPE
    for each in report.figures["gains"].values():  # weights that were never trained are not trusted to do harm
        assert each["trusted"] >= each["as they are"] - 1e-6
