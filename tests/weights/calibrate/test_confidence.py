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
from stages.shared.inference.cloud_interfaces import Scene
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.confidence import (
    GAP_EDGES,
    PARTS,
    SHAPE,
    Confidence,
    gap_sizes,
    read_confidence,
    trust_of,
    write_confidence,
)
from stages.shared.inference.filling import fill_motion
from stages.shared.inference.models import load_weights
from stages.shared.inference.token_times import choose_tokens
from stages.shared.inference.trust_fit import Sums, careful_fit, fit, gain, trust_fit
from stages.shared.inference.trust_gaps import ANGLE_M, change_of, changes_by_part
from stages.shared.solve.skeleton_pose import pose_of_motion
from stages.shared.solve.solving import Corrections
from stages.weights.calibrate.config import Config
from stages.weights.calibrate.run import run
from tests.shared.inference.examples import humanoid, swinging, write_random_weights

DEPTH = np.linspace(0.1, 1, 10)


def _sums(edge: float, middle: float, noise: float, seed: int = 0, gaps: int = 200) -> Sums:
    """Gaps of one length and size, in which one part alone is corrected: what it should change is a known share of
    what it does, and noise."""
    rng = np.random.default_rng(seed)
    sums = Sums()
    for _ in range(gaps):
        made = np.zeros((len(PARTS), 10, 12))
        made[2] = rng.normal(size=(10, 12))
        share = (1 - DEPTH) * edge + DEPTH * middle
        sums.add(1, (0, 0, 3, 0), DEPTH, made, share[:, None] * made[2] + noise * rng.normal(size=(10, 12)))
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
    made = np.zeros((len(PARTS), 10, 12))
    made[2] = 1
    sums.add(1, (0, 0, 4, 0), DEPTH, made, 0 * made[2])  # a single gap that says no
    trust = fit([sums], prior=4.0)
    assert trust[1, 2, 4].mean() > 0.4 and trust[1, 2, 3].mean() > 0.7  # another size
    assert abs(trust[0, 2, 0].mean() - trust[1, 2, 0].mean()) < 0.3  # another length


def test_what_one_part_makes_up_for_in_another_is_not_held_against_it() -> None:
    """The spine leans and the arms lean back: only together do they leave the hands where they should be."""
    rng = np.random.default_rng(0)
    sums = Sums()
    for _ in range(300):
        lean, own = rng.normal(size=(2, 10, 12))
        made = np.zeros((len(PARTS), 10, 12))
        made[0], made[1] = lean, own - lean
        sums.add(1, (1, 1, 0, 0), DEPTH, made, own)
    trust = fit([sums], prior=1.0)
    assert trust[1, 0, 1].min() > 0.95 and trust[1, 1, 1].min() > 0.95
    assert gain(sums, trust) > 0.95


def test_the_fit_is_least_squares_of_all_gaps() -> None:
    """Without a prior, and where no bound is met, no small change of trust does better."""
    rng = np.random.default_rng(1)
    sums = Sums()
    for _ in range(60):
        made = rng.normal(size=(len(PARTS), 10, 12))
        bins = rng.integers(0, SHAPE[2], len(PARTS)).tolist()
        true = 0.5 * made.sum(0) + 0.1 * rng.normal(size=(10, 12))
        sums.add(int(rng.integers(0, SHAPE[0])), bins, DEPTH, made, true)
    trust = fit([sums], prior=1e-6)
    best = gain(sums, trust)
    for _ in range(20):
        assert gain(sums, trust + 0.02 * rng.normal(size=SHAPE)) < best


def test_what_one_family_alone_says_is_not_believed() -> None:
    archives = {
        "a": _sums(0.9, 0.9, 0.1, gaps=400),
        "b": _sums(0.1, 0.1, 0.1, 1, 20),
        "c": _sums(0.2, 0.2, 0.1, 2, 20),
    }
    careful = careful_fit(archives, 1.0)[1, 2, 3]
    assert careful.max() < fit(list(archives.values()), 1.0)[1, 2, 3].min()
    assert gain(archives["b"], careful_fit(archives, 1.0)) > gain(archives["b"], fit(list(archives.values()), 1.0))


def _families(*shares: float) -> dict[str, Sums]:
    return {f"family {seed}": _sums(share, share, 0.3, seed, 40) for seed, share in enumerate(shares)}


def test_care_is_for_weights_that_do_not_know_all_families_alike() -> None:
    alike = _families(0.5, 0.9, 0.9, 1.0)
    assert trust_fit(alike, 1.0)[1, 2, 3].min() > careful_fit(alike, 1.0)[1, 2, 3].max()
    np.testing.assert_array_equal(trust_fit(alike, 1.0), fit(list(alike.values()), 1.0))
    strangers = _families(-0.5, 0.0, 0.0, 1.0)
    np.testing.assert_array_equal(trust_fit(strangers, 1.0), careful_fit(strangers, 1.0))
    alone = _families(0.5)
    np.testing.assert_array_equal(trust_fit(alone, 1.0), fit(list(alone.values()), 1.0))


def test_the_gain_is_the_share_of_squares_that_trusted_corrections_are_right_about() -> None:
    rng = np.random.default_rng(2)
    sums, trust = Sums(), rng.random(SHAPE)
    squares, whole = 0.0, 0.0
    for _ in range(30):
        made, length = rng.normal(size=(len(PARTS), 10, 12)), int(rng.integers(0, SHAPE[0]))
        wanted = made.sum(0) + rng.normal(size=(10, 12))
        sums.add(length, (0, 1, 2, 3), DEPTH, made, wanted)
        shares = [
            (1 - DEPTH) * trust[length, part, size, 0] + DEPTH * trust[length, part, size, 1]
            for part, size in enumerate((0, 1, 2, 3))
        ]
        done = sum(share[:, None] * each for share, each in zip(shares, made, strict=True))
        squares += float(((wanted - done) ** 2).sum())
        whole += float((wanted**2).sum())
    assert gain(sums, trust) == pytest.approx(1 - squares / whole)


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
    filled = fill_motion(skeleton, motion, known, SynthesisedClouds(wary), points=48)
    assert filled.plain[~known].all()
    sure = replace(wary, confidence=Confidence(np.ones(SHAPE)))
    assert (
        not fill_motion(skeleton, motion, known, SynthesisedClouds(sure), points=48)
        .plain[~known][:, skeleton.sampled]
        .all()
    )
    content = json.loads((weights / "confidence.json").read_text())
    for change in ({"trust": [[2.0]]}, {"version": 99}, {"gap_edges": [1]}):
        (weights / "confidence.json").write_text(json.dumps(content | change))
        with pytest.raises(InputError, match=r"confidence\.json"):
            read_confidence(weights)


def test_calibrating_writes_a_confidence_beside_the_weights(tmp_path: Path) -> None:
    weights = write_random_weights(tmp_path / "weights")
    for number in range(2):  # in an artefact of its own each
        with (
            write_artefact(tmp_path / f"motion{number}", "motion", stage="ingest", config={}) as draft,
            MotionWriter(draft.folder) as writer,
        ):
            skeleton = writer.add_skeleton(humanoid())
            motion = swinging(humanoid(), 70, seed=number)
            row = ClipRow(f"c{number}", f"{number}.zip!c", "0" * 64, skeleton, 70, 30.0, 70 / 30, "val", "CC0")
            writer.add_clip(row, motion)
    motions = (tmp_path / "motion0", tmp_path / "motion1")
    report = run(
        Config(
            weights=str(weights), motion=motions, intervals=(15,), transitions=(15,), predictions=(),
            window=61, max_windows=1, points=48, device="cpu",
        )
    )  # fmt: skip
    assert report.figures["windows"] == 4 and set(report.figures["gains"]) == {"0", "1"}
    found = read_confidence(weights)
    assert found is not None and found.trust.shape == SHAPE
    for each in report.figures["gains"].values():  # weights that were never trained do harm, and are hardly trusted
        assert each["trusted"] >= 0.5 * min(each["as they are"], 0) - 0.01


def test_parts_changes_add_up_to_what_all_corrections_change() -> None:
    skeleton = humanoid()
    motion = swinging(skeleton, 31)
    made = _corrections(31, skeleton.joints, 1e-3)
    pose = pose_of_motion(skeleton, motion)
    scene = Scene(choose_tokens(np.array([0, 30]), 31, 30.0), pose)
    whole = change_of(scene, pose.corrected(made.turns, made.shifts))
    parts = changes_by_part(scene, made)
    assert parts.shape == (len(PARTS), 31, whole.shape[1])
    np.testing.assert_allclose(parts.sum(0), whole, atol=3e-5)  # small turns: what they do adds up
    angles = whole[:, -3 * int((skeleton.groups >= 0).sum()) :].reshape(31, -1, 3)
    np.testing.assert_allclose(angles, ANGLE_M * made.turns[:, skeleton.groups >= 0].numpy(), atol=1e-6)
