"""What is kept of an adaptation: nothing that is worse on the held-out windows, nothing better by chance alone."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stages.weights.adapt.choosing import Candidate, Errors, choose

START = Candidate("start")
FITTED = Candidate("start", fitted=True)
TRAINED = Candidate("trained")


def _errors(spans: int, tasks: int = 3) -> Errors:
    span, task = np.divmod(np.arange(spans * tasks), tasks)
    return Errors(span, task, np.ones(spans * tasks))


@given(st.integers(0, 10_000), st.integers(2, 8), st.sampled_from([-0.3, -0.05, 0.0, 0.1]))
def test_what_is_kept_is_never_worse(seed: int, spans: int, shift: float):
    measured, rng = _errors(spans), np.random.default_rng(seed)
    start = rng.uniform(0.5, 1, 3 * spans)
    others = [FITTED, TRAINED, Candidate("trained", fitted=True), Candidate("mean")]
    candidates = {START: start} | {each: start + shift + rng.normal(0, 0.2, 3 * spans) for each in others}
    found = choose(measured, START, candidates)
    assert measured.score(np.asarray(candidates[found.kept])) <= measured.score(start)
    if found.kept != START:
        assert found.gain > found.standard_error and found.better > 0.5


def test_the_best_of_those_that_are_better_everywhere_is_kept():
    start = np.linspace(0.6, 0.9, 12)
    found = choose(_errors(4), START, {START: start, TRAINED: start - 0.05, FITTED: start - 0.1})
    assert found.kept == FITTED and abs(found.gain - 0.1) < 1e-9 and found.better == 1


def test_a_gain_from_one_span_alone_is_chance():
    start = np.full(12, 0.8)
    lucky = start.copy()
    lucky[:3] -= 0.5
    assert choose(_errors(4), START, {START: start, TRAINED: lucky}).kept == START


def test_fills_that_are_no_numbers_are_not_kept():
    start = np.full(12, 0.8)
    assert choose(_errors(4), START, {START: start, TRAINED: np.full(12, np.nan)}).kept == START


def test_two_spans_must_agree_more_closely_than_many():
    def kept(spans: int) -> Candidate:
        gains = np.where(np.arange(3 * spans) // 3 % 2, 0.01, 0.1)
        start = np.full(3 * spans, 0.8)
        return choose(_errors(spans), START, {START: start, TRAINED: start - gains}).kept

    assert kept(2) == START and kept(8) == TRAINED
