"""What a summary says: which frames and bones fell back, and how much velocities jump."""

from __future__ import annotations

import numpy as np

from stages.infill.summary import EVERY_BONE, ROWS_SHOWN, fallbacks_of, lines_of_fallbacks, lines_of_jumps
from tests.shared.inference.examples import humanoid

MISSING = np.array([1, 2, 3, 5, 6, 7])


def test_nothing_fell_back():
    rows = fallbacks_of(humanoid(), np.zeros((9, 12), bool), 0, MISSING)
    assert rows == [] and lines_of_fallbacks(rows) == ["No bone fell back to plain interpolation."]


def test_bones_never_seen_and_gaps_given_up_are_told_apart():
    plain = np.zeros((9, 12), bool)
    plain[MISSING, 5] = True
    plain[5:8, :] = True
    plain[1:4, 7] = True
    rows = fallbacks_of(humanoid(), plain, 100, MISSING)
    assert [(row["frames"], row["bones"]) for row in rows] == [
        ((101, 107), ["left_finger", "right_hand"]),
        ((105, 107), [EVERY_BONE]),
    ]
    assert "  105-107  every bone" in lines_of_fallbacks(rows)[2]


def test_all_plain():
    plain = np.zeros((9, 12), bool)
    plain[MISSING] = True
    rows = fallbacks_of(humanoid(), plain, 0, MISSING)
    assert [(row["frames"], row["bones"]) for row in rows] == [((1, 7), [EVERY_BONE])]


def test_long_tables_are_cut():
    plain = np.zeros((101, 12), bool)
    plain[1:101:2, 3] = True
    rows = fallbacks_of(humanoid(), plain, 0, np.arange(1, 100))
    assert len(rows) == 50
    lines = lines_of_fallbacks(rows)
    assert len(lines) == ROWS_SHOWN + 2 and "30 stretches more" in lines[-1]


def test_jumps_show_the_worst_first():
    lines = lines_of_jumps(np.array([15, 30]), np.array([0.1, 0.4]), np.array([0.2, 0.3]))
    assert "2 keys" in lines[0] and lines[1].split() == ["30", "0.400", "0.300"]
    assert "no velocity jump" in lines_of_jumps(np.zeros(0), np.zeros(0), np.zeros(0))[0]
