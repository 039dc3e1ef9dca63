"""Which of the candidates is kept: one that is better than the start on the held-out windows by more than chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import norm, t

_LEAST_M = 1e-6  # of slerp's error, so that windows without motion count as equal


@dataclass(frozen=True)
class Errors:
    """L2P of each window, metres, beside slerp's; spans and tasks (n,) name the windows' spans and tasks."""

    spans: np.ndarray
    tasks: np.ndarray
    slerp: np.ndarray

    def ratios(self, errors: np.ndarray) -> dict[int, float]:
        """Each task's error as a share of slerp's."""
        return {
            int(task): float(errors[self.tasks == task].sum() / max(self.slerp[self.tasks == task].sum(), _LEAST_M))
            for task in np.unique(self.tasks)
        }

    def score(self, errors: np.ndarray) -> float:
        """The mean over tasks of their ratios."""
        return float(np.mean(list(self.ratios(errors).values())))

    def gains(self, start: np.ndarray, errors: np.ndarray) -> np.ndarray:
        """(spans,) how much less each span's error is than at the start, as a share of slerp's mean error in the same
        tasks; the mean over the span's tasks."""
        scale = np.zeros(len(self.tasks))
        for task in np.unique(self.tasks):
            scale[self.tasks == task] = max(self.slerp[self.tasks == task].mean(), _LEAST_M)
        gains = (start - errors) / scale
        return np.array([gains[self.spans == span].mean() for span in np.unique(self.spans)])


class Candidate(NamedTuple):
    """Weights that may be kept, by name, and whether their confidence was fitted anew."""

    weights: str
    fitted: bool = False


@dataclass(frozen=True)
class Choice:
    """The candidate that is kept, and its mean gain over the start with the standard error of that, shares of slerp's
    error; `better` is the share of the spans in which it is better."""

    kept: Candidate
    gain: float = 0.0
    standard_error: float = 0.0
    better: float = 0.0


def choose(measured: Errors, start: Candidate, errors: Mapping[Candidate, Sequence[float] | np.ndarray]) -> Choice:
    """The best of the candidates whose mean gain over `start` is more than its standard error, and that are better in
    more than half of the spans and by the score; else `start`.

    Args:
        errors: candidate -> L2P of each window, metres; `start` is one of them.
    """
    before = np.asarray(errors[start])
    best = Choice(start)
    for candidate, values in errors.items():
        after = np.asarray(values)
        if candidate == start or not np.isfinite(after).all() or measured.score(after) >= measured.score(before):
            continue
        gains = measured.gains(before, after)
        found = Choice(candidate, float(gains.mean()), _standard_error(gains), float((gains > 0).mean()))
        if found.gain > max(found.standard_error, best.gain) and found.better > 0.5:
            best = found
    return best


def _standard_error(gains: np.ndarray) -> float:
    """Of the mean, widened for few values: a larger gain is as unlikely by chance as one of a standard error of many
    values (Student's t)."""
    if len(gains) < 2:
        return float("inf")
    return float(t.ppf(norm.cdf(1), len(gains) - 1) * gains.std(ddof=1) / np.sqrt(len(gains)))
