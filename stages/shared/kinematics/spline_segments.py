"""A motion as consecutive splines: the best junctions by dynamic programming (motion concepts, equations 1 and 2).

Every feature (one coordinate of one joint) of a segment is fitted with a cubic of time by least squares (or with a
polynomial of lower degree).
A segment from frame k to frame n holds both of them, so that neighbours share their junction. The cost of a
segmentation is the sum of the squared residuals of all segments, and a price for each segment.

`segment_errors` finds the residual of every segment of at most `longest` steps from running sums: each pair of frames
costs a number of operations that depends on neither the segment's length nor the number of features. With S(i, j) the
scalar product of two frames' features, and u = j / longest the time in a segment, it keeps

    G_pq(k, n) = sum over i, j in k..n of u_i^p u_j^q S(i, j)        p, q = 0 to 3

which grows by three products when n grows by one, and the residual is sum S(i, i) - trace(H^-1 G) with
H_pq = sum u^(p+q).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

CUBIC = 3  # the paper's degree
_BINOMIAL = np.array([[1, 0, 0, 0], [1, 1, 0, 0], [1, 2, 1, 0], [1, 3, 3, 1]], np.float64)
_BLOCK = 1024  # first frames at a time; each block is centred at its own mean, which keeps the sums small


@dataclass(frozen=True)
class Segmentation:
    """The best segmentation of a motion.

    junctions: (M,) int64, rising, the first and the last frame included; M - 1 segments.
    errors:    (M - 1,) float64, the sum of squared residuals of each segment, in the features' unit squared.
    cost:      of all segments, with the price of each.
    """

    junctions: np.ndarray
    errors: np.ndarray
    cost: float


def segment_errors(features: np.ndarray, longest: int, degree: int = CUBIC) -> np.ndarray:
    """Residuals of the polynomial fits of all segments of at most `longest` steps.

    Args:
        features: (T, F) finite numbers, T >= 2.
        longest: steps (frames minus one) of the longest segment, at least 1.
        degree: of the polynomials, 1 to 3.

    Returns: (longest + 1, T) float64. Row j, column k: sum over frames k to k + j and over features of the squared
        residuals of a least-squares polynomial; row 0 and segments that end after the last frame are infinite.
    """
    frames = len(features)
    longest = min(longest, frames - 1)
    out = np.full((longest + 1, frames), np.inf)
    inverses = _inverse_grams(longest, degree)
    for first in range(0, frames - 1, _BLOCK):
        starts = min(_BLOCK, frames - 1 - first)
        part = np.asarray(features[first : first + starts + longest], np.float64)
        part = part - part.mean(axis=0)
        _fill_block(out[:, first : first + starts], part, starts, longest, inverses)
    return out


def _fill_block(out: np.ndarray, part: np.ndarray, starts: int, longest: int, inverses: np.ndarray) -> None:
    """Residuals of the segments that start in the first `starts` frames of `part`, into `out` (longest + 1,
    starts).
    """
    count, terms = len(part), inverses.shape[-1]
    squares = np.einsum("tf,tf->t", part, part)
    energies = np.concatenate([[0.0], np.cumsum(squares)])
    sums = np.zeros((terms, count))  # U_r(n) = sum over e = 1..j of (e / longest)^r S(n - e, n)
    grams = np.zeros((terms, terms, starts))
    grams[0, 0] = squares[:starts]  # the first frame is at time 0
    powers = np.arange(terms)
    signs = (-1.0) ** powers
    for step in range(1, min(longest, count - 1) + 1):
        now = step / longest
        times = now**powers
        sums[:, step:] += times[:, None] * np.einsum("tf,tf->t", part[step:], part[:-step])
        here = min(starts, count - step)
        ends = slice(step, step + here)
        # <sum over i < n of u_i^p y_i, y_n> with u_i = now - e / longest, expanded by the binomial theorem.
        expand = (
            _BINOMIAL[:terms, :terms] * now ** np.clip(powers[:, None] - powers[None, :], 0, None) * signs[None, :]
        )
        crossed = expand @ sums[:, ends]
        grown = times[:, None, None] * crossed[None, :, :]
        grams[:, :, :here] += (
            grown + grown.transpose(1, 0, 2) + np.outer(times, times)[:, :, None] * squares[None, None, ends]
        )
        if step < terms:
            out[step, :here] = 0.0  # no more frames than coefficients
            continue
        # H is inverted in times from 0 to 1 over the segment, where it is well conditioned, and scaled to times u.
        scaled = inverses[step] / np.outer(times, times)
        explained = np.tensordot(scaled, grams[:, :, :here], axes=([0, 1], [0, 1]))
        energy = energies[step + 1 : step + 1 + here] - energies[:here]
        out[step, :here] = np.maximum(energy - explained, 0.0)


def _inverse_grams(longest: int, degree: int) -> np.ndarray:
    """(longest + 1, P, P) for P = degree + 1: inverses of H_pq = sum over i = 0..j of (i / j)^(p + q), for j from P
    on.
    """
    out = np.zeros((longest + 1, degree + 1, degree + 1))
    for step in range(degree + 1, longest + 1):
        basis = _powers(step, degree)
        out[step] = np.linalg.inv(basis.T @ basis)
    return out


def _powers(steps: int, degree: int = CUBIC) -> np.ndarray:
    """(steps + 1, degree + 1) powers of times 0 to 1."""
    return np.linspace(0.0, 1.0, steps + 1)[:, None] ** np.arange(degree + 1)


def best_segments(features: np.ndarray, price: float, longest: int, degree: int = CUBIC) -> Segmentation:
    """The segmentation of least cost (equation 2): Error_n = min over k < n of Error_k + fit(k..n) + price.

    Args:
        features: (T, F) finite numbers, T >= 1.
        price: of each segment (the paper's lambda), in the features' unit squared, at least 0.
        longest: steps of the longest segment, at least 1.
        degree: of the polynomials; 1 gives junctions that straight lines join best.

    Returns: the best segmentation; of equal ones, the one whose last segments are shortest.
    """
    frames = len(features)
    if frames < 2:
        return Segmentation(np.zeros(frames, np.int64), np.zeros(0), 0.0)
    errors = segment_errors(features, longest, degree)
    longest = len(errors) - 1
    costs = np.zeros(frames)
    before = np.zeros(frames, np.int64)
    by_end = np.full((frames, longest), np.inf)  # row n, column j - 1: the segment of j steps that ends at n
    for step in range(1, longest + 1):
        by_end[step:, step - 1] = errors[step, : frames - step]
    for last in range(1, frames):
        most = min(longest, last)
        totals = costs[last - most : last][::-1] + by_end[last, :most]
        steps = int(np.argmin(totals)) + 1
        costs[last] = totals[steps - 1] + price
        before[last] = last - steps
    junctions = [frames - 1]
    while junctions[-1] > 0:
        junctions.append(int(before[junctions[-1]]))
    found = np.array(junctions[::-1], np.int64)
    return Segmentation(found, errors[np.diff(found), found[:-1]], float(costs[-1]))


def fitted_splines(features: np.ndarray, junctions: np.ndarray) -> np.ndarray:
    """Least-squares cubics between junctions (equation 1).

    Args:
        features: (T, ...) numbers. junctions: (M,) rising frames.

    Returns: (M - 1, 4, ...) float64, coefficients of the powers 0 to 3 of the time in each segment, from 0 at its
        first frame to 1 at its last. A segment of fewer than four frames gets the coefficients of least norm.
    """
    flat = np.asarray(features, np.float64).reshape(len(features), -1)
    out = np.zeros((max(len(junctions) - 1, 0), CUBIC + 1, flat.shape[1]))
    for at, (first, last) in enumerate(pairwise(junctions)):
        out[at] = np.linalg.lstsq(_powers(int(last - first)), flat[first : last + 1], rcond=None)[0]
    return out.reshape(*out.shape[:2], *np.shape(features)[1:])


def spline_frames(splines: np.ndarray, junctions: np.ndarray) -> np.ndarray:
    """Frames that splines (M - 1, 4, ...) pass through: (T, ...), T the last junction + 1; at a junction the mean of
    both splines' values."""
    count = int(junctions[-1]) + 1 - int(junctions[0])
    out = np.zeros((count, *splines.shape[2:]))
    weights = np.zeros(count)
    for at, (first, last) in enumerate(pairwise(junctions)):
        part = slice(int(first - junctions[0]), int(last - junctions[0]) + 1)
        out[part] += np.tensordot(_powers(int(last - first)), splines[at], axes=(1, 0))
        weights[part] += 1.0
    return out / np.maximum(weights, 1.0).reshape(-1, *[1] * (out.ndim - 1))
