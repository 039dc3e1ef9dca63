"""Pops: a twist, a jolt, crossed shins and floating feet are found in the window that has them, and named."""

from __future__ import annotations

import numpy as np
import pytest

from data_schemas.metrics import MetricRow
from stages.shared.statistics.feel_pops import (
    crossing_frames,
    floating_mm,
    jolts,
    largest_acceleration_mps2,
    largest_turn_deg,
    segment_distances,
    twists,
)
from stages.shared.statistics.measurements import first_frame_of
from stages.shared.statistics.pop_tables import pop_lines, pop_markdown, pop_table

FRAMES = 20


def about_x(degrees: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4)."""
    half = np.radians(degrees) / 2
    return np.stack([np.sin(half), 0 * half, 0 * half, np.cos(half)], -1)


def missing() -> np.ndarray:
    known = np.zeros(FRAMES, bool)
    known[[0, 1, 2, -1]] = True
    return ~known


def test_the_largest_turn_is_of_one_joint_between_frames_that_were_filled() -> None:
    angles = np.zeros((2, FRAMES, 3))
    angles[0, 10:, 1] = 40.0
    angles[0, 1, 2] = 90.0  # between two known frames: counts for nothing
    angles[1] = np.arange(FRAMES)[:, None] * 5.0
    rotations = about_x(angles)
    rotations[0, 12] *= -1  # the same rotations
    turns = largest_turn_deg(rotations, missing())
    np.testing.assert_allclose(turns, [40.0, 5.0], atol=1e-5)
    np.testing.assert_array_equal(twists(turns, np.array([20.0, 20.0])), [1, 0])
    np.testing.assert_array_equal(twists(turns, np.array([30.0, 1.0])), [0, 0])


def test_the_largest_acceleration_is_that_of_a_step() -> None:
    places = np.zeros((2, FRAMES, 3, 3))
    places[0, 8, 1, 0] = 0.02
    places[1, :, :, 1] = 0.5 * 9.81 * (np.arange(FRAMES) / 30)[:, None] ** 2
    found = largest_acceleration_mps2(places, missing())
    np.testing.assert_allclose(found, [2 * 0.02 * 900, 9.81], rtol=1e-6)
    np.testing.assert_array_equal(jolts(found, np.array([15.0, 5.0])), [1, 0])


def test_segments_against_a_dense_search() -> None:
    rng = np.random.default_rng(0)
    a, b, c, d = rng.normal(size=(4, 50, 3))
    d[:5] = c[:5] + 2 * (b[:5] - a[:5])  # parallel
    steps = np.linspace(0, 1, 201)
    first = a[:, None] + steps[:, None] * (b - a)[:, None]
    second = c[:, None] + steps[:, None] * (d - c)[:, None]
    dense = np.linalg.norm(first[:, :, None] - second[:, None], axis=-1).min((1, 2))
    found = segment_distances(a, b, c, d)
    assert (found <= dense + 1e-9).all()
    np.testing.assert_allclose(found, dense, atol=0.02)


def test_shins_that_pass_through_each_other_are_counted_in_missing_frames() -> None:
    shins = np.zeros((1, FRAMES, 2, 2, 3))
    shins[..., 0, 1] = 0.5
    shins[:, :, 0, :, 0], shins[:, :, 1, :, 0] = 0.1, -0.1
    assert crossing_frames(shins, missing(), 0.045)[0] == 0
    shins[0, [1, 7, 8], 0, 1, 0] = -0.3  # the left ankle beyond the right leg; frame 1 is known
    assert crossing_frames(shins, missing(), 0.045)[0] == 2


def test_feet_float_while_true_ones_stand() -> None:
    contacts = np.zeros((1, FRAMES, 2), bool)
    contacts[0, 5:10, 0] = True
    heights = np.full((1, FRAMES, 2), 0.3)
    heights[0, :, 1] = 0.08
    found = floating_mm(heights, np.array([[0.02, 0.02]]), contacts, missing())
    assert found[0] == pytest.approx(60.0)
    assert np.isnan(floating_mm(heights, np.zeros((1, 2)), np.zeros_like(contacts), missing())[0])


def rows() -> list[MetricRow]:
    """Two clips of two archives; the second has the larger turn."""
    made = []
    for clip, turn, start, twist in (("a.one", 12.0, 30, 0.0), ("b.two", 98.4, 240, 0.5)):
        common = {"skeleton": "s", "archive": clip[0], "method": "small", "task": "transition", "interval": 30}
        for metric, value in (
            ("largest_turn_deg", turn),
            (first_frame_of("largest_turn_deg"), float(start)),
            ("twist_share", twist),
        ):
            made.append(MetricRow(clip=clip, metric=metric, value=value, windows=2, **common))
    return made


def test_the_worst_window_is_named_by_clip_and_first_frame() -> None:
    table = pop_table(rows(), "all archives")
    assert table is not None and len(table.rows) == 1
    row = table.rows[0]
    assert row.labels == ("transition 30", "small")
    shown = dict(zip(table.columns, (entry.text for entry in row.entries), strict=True))
    assert shown["largest turn (degrees a frame)"] == "98.4 b.two 240"
    assert shown["windows that twist"] == "25.0%"
    assert "12.0 a.one 30" in pop_markdown(rows(), "a") and "b.two" not in pop_markdown(rows(), "a")
    assert any("98.4 b.two 240" in line for line in pop_lines(rows()))
    assert pop_table([], "all archives") is None and pop_lines([]) == []
