"""A limb of two hinges: its end follows a path, the hinges stay hinges, a place out of reach straightens nothing."""

from __future__ import annotations

import numpy as np
import pytest

from stages.shared.solve.limb_solve import REACH, Limb, solve_limb, within_reach

FRAMES, LENGTH = 60, 0.9
X = np.array([1.0, 0.0, 0.0])


def leg(knee_rad: float) -> Limb:
    """A leg that hangs from a hip at 1 m, its knee bent about X, the same in all frames."""
    turned = [[-np.sin(knee_rad / 4), 0, 0, np.cos(knee_rad / 4)], [np.sin(knee_rad / 2), 0, 0, np.cos(knee_rad / 2)]]
    local = np.repeat(np.array([turned]), FRAMES, axis=0)
    above, top = np.tile([0.0, 0, 0, 1], (FRAMES, 1)), np.tile([0.0, 1, 0], (FRAMES, 1))
    return Limb(local, above, top, np.tile([0.0, -LENGTH / 2, 0], (FRAMES, 2, 1)))


def hinges() -> np.ndarray:
    """A hip that turns about all axes, and a knee that has turned about X alone."""
    stiff = np.diag([4.0, 4e6, 4e6])
    return np.stack([4.0 * np.eye(3), stiff])


def path(height_m: float) -> np.ndarray:
    """(T, 3) a shift upwards that comes and goes within the clip."""
    return height_m * np.sin(np.linspace(0, np.pi, FRAMES))[:, None] ** 2 * [0.0, 1, 0]


def pins() -> np.ndarray:
    pinned = np.zeros(FRAMES, bool)
    pinned[[0, -1]] = True
    return pinned


def test_the_end_follows_and_the_knee_stays_a_hinge() -> None:
    limb, wanted = leg(0.5), path(0.1)
    turns = solve_limb(limb, wanted, hinges(), pins(), noise_m=0.001, span=1.8)
    before, after = limb.turned(np.zeros_like(turns))[2], limb.turned(turns)[2]
    np.testing.assert_allclose(after - before, wanted, atol=2e-3)
    assert (turns[pins()] == 0).all()
    assert np.abs(turns[:, 1] - turns[:, 1, :1] * X).max() < 1e-3 < np.abs(turns[:, 1, 0]).max()


@pytest.mark.parametrize("knee_rad", [0.5, 0.1])
def test_a_place_out_of_reach_neither_straightens_the_leg_nor_makes_it_snap(knee_rad: float) -> None:
    limb, wanted = leg(knee_rad), path(-0.3)
    turns = solve_limb(limb, wanted, hinges(), pins(), noise_m=0.001, span=1.8)
    ends = limb.turned(turns)[2]
    own = np.linalg.norm(limb.turned(np.zeros_like(turns))[2] - limb.top, axis=-1)
    reached = np.linalg.norm(ends - limb.top, axis=-1)
    assert (reached <= np.maximum(REACH * LENGTH, own) + 1e-3).all()
    assert 30.0 * np.degrees(np.abs(np.diff(turns, axis=0))).max() < 300.0
    knee = turns[:, 1, 0] + knee_rad
    assert knee.min() > 0  # it never bends the other way


def test_places_within_reach_stay_and_others_come_to_it_without_a_step() -> None:
    limb = leg(1.2)
    down = np.linspace(0.3, 1.5, FRAMES)
    drawn = limb.top[:, 1] - within_reach(limb, limb.top - down[:, None] * [0, 1.0, 0])[:, 1]
    near = down < 0.9 * REACH * LENGTH
    np.testing.assert_allclose(drawn[near], down[near])
    assert (np.diff(drawn) >= -1e-9).all() and drawn.max() <= REACH * LENGTH + 1e-9
    own = limb.turned(np.zeros((FRAMES, 2, 3)))[2]
    np.testing.assert_allclose(within_reach(limb, own), own)
    straight = leg(0.01)
    ends = straight.turned(np.zeros((FRAMES, 2, 3)))[2]
    np.testing.assert_allclose(within_reach(straight, ends), ends)  # straight already, and left so
