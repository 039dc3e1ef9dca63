"""The smoother against its own objective, solved densely."""

from __future__ import annotations

import numpy as np
import roma
import torch

from stages.shared.solve.smoothing import bends_of_positions, bends_of_rotations, smooth_corrections


def test_is_the_minimum_of_its_objective():
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.5, 1.5, 30))
    values, bends = rng.normal(size=(30, 2)), rng.normal(size=(30, 2)) * 0.1
    pinned = np.zeros(30, bool)
    pinned[[0, 12, 29]] = True
    span = 2.0
    found = smooth_corrections(values, bends, times, pinned, span)
    assert (found[pinned] == 0).all()
    h = np.diff(times)
    width = (h[1:] + h[:-1]) / 2
    own = np.concatenate([h[:1] / 2, width, h[-1:] / 2])

    def cost(c: np.ndarray) -> float:
        curve = np.diff(np.diff(c, axis=0) / h[:, None], axis=0) / width[:, None] + bends[1:-1]
        return float((own[:, None] * (c - values) ** 2)[~pinned].sum() + span**4 * (width[:, None] * curve**2).sum())

    best = cost(found)
    for _ in range(20):
        step = rng.normal(size=found.shape) * 1e-3 * ~pinned[:, None]
        assert cost(found + step) > best and cost(found - step) > best


def test_span_zero_gives_the_values_back_and_pins_them():
    values = np.ones((5, 1))
    found = smooth_corrections(values, 0 * values, np.arange(5.0), np.array([True, False, False, False, True]), 0.0)
    assert found.ravel().tolist() == [0, 1, 1, 1, 0]


def test_bends():
    times = np.array([0.0, 1.0, 2.5, 3.0])
    np.testing.assert_allclose(bends_of_positions(times[:, None] ** 2, times)[1:-1], 2.0)
    turning = roma.rotvec_to_unitquat(torch.tensor([[0.0, 0, 0], [0.1, 0, 0], [0.25, 0, 0], [0.3, 0, 0]]))
    assert np.abs(bends_of_rotations(turning[:, None], times)).max() < 1e-5
