"""Intervals over clips."""

from __future__ import annotations

import numpy as np
import pytest

from stages.shared.statistics.bootstrap import mean_interval, ratio_interval


def test_interval_holds_the_mean_and_narrows_with_clips() -> None:
    rng = np.random.default_rng(0)
    few, many = rng.normal(1, 0.3, 20), rng.normal(1, 0.3, 500)
    a, b = (mean_interval(v, np.ones_like(v)) for v in (few, many))
    for estimate, values in ((a, few), (b, many)):
        assert estimate.value == pytest.approx(values.mean())
        assert estimate.low < estimate.value < estimate.high
    assert b.high - b.low < (a.high - a.low) / 3
    # The textbook half-width of a mean's 95% interval.
    assert (b.high - b.low) / 2 == pytest.approx(1.96 * many.std() / np.sqrt(500), rel=0.1)


def test_about_ninety_five_percent_of_intervals_hold_the_true_mean() -> None:
    rng = np.random.default_rng(1)
    hits = 0
    for trial in range(200):
        e = mean_interval(rng.normal(0.5, 0.1, 60), np.ones(60), seed=trial)
        hits += e.low <= 0.5 <= e.high
    assert 180 <= hits <= 199


def test_weights_count_windows() -> None:
    assert mean_interval(np.array([1.0, 3.0]), np.array([3.0, 1.0])).value == pytest.approx(1.5)


def test_a_ratio_is_paired() -> None:
    base = np.random.default_rng(2).uniform(0.1, 2, 50)
    e = ratio_interval(0.8 * base, np.ones(50), base, np.ones(50))
    assert (e.value, e.low, e.high) == (pytest.approx(0.8), pytest.approx(0.8), pytest.approx(0.8))


def test_one_clip_has_no_interval_and_seeds_repeat() -> None:
    e = mean_interval(np.array([0.4]), np.array([5.0]))
    assert (e.value, e.low, e.high) == (0.4, None, None)
    values = np.arange(9.0)
    assert mean_interval(values, np.ones(9), 3) == mean_interval(values, np.ones(9), 3)
