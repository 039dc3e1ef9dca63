"""Feel against plain loops, motions made by hand, and the truth's own figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data_schemas.metrics import MetricRow
from data_schemas.skeleton import Skeleton
from stages.shared.kinematics.foot_contacts import detect_contacts, find_feet, foot_skate_mps
from stages.shared.statistics import feel as feeling
from stages.shared.statistics.feel import feel, true_feet
from stages.shared.statistics.feel_tables import feel_lines, feel_markdown
from stages.shared.statistics.measurements import Truth
from stages.shared.statistics.tables import cells, task_tables

FRAMES, FPS = 40, 30
# Pelvis, and two legs of hip, knee, ankle and toes.
PARENTS = np.array([-1, 0, 1, 2, 3, 0, 5, 6, 7], np.int32)
LEG = [[0.1, 0, 0], [0, -0.45, 0], [0, -0.45, 0], [0, -0.05, 0.15]]
OFFSETS = np.array([[0, 0.95, 0], *LEG, *(np.array(LEG) * [-1, 1, 1])])
TOES = (4, 8)


def skeleton() -> Skeleton:
    tails = np.zeros((9, 3))
    for joint in range(9):
        below = np.flatnonzero(joint == PARENTS)
        tails[joint] = OFFSETS[below[0]] if len(below) else [0, 0, 0.05]
    groups = np.array([0, 3, 3, 3, 3, 4, 4, 4, 4], np.int8)
    names = ("hips", *(f"{bone}.{side}" for side in "LR" for bone in ("thigh", "shin", "foot", "toe")))
    return Skeleton(names, PARENTS, OFFSETS, tails, groups, np.ones(9, bool), 0)


def standing() -> np.ndarray:
    """(1, T, 9, 3): a body that stands still, on a floor at 0."""
    places = np.zeros((9, 3))
    for joint in range(9):
        places[joint] = OFFSETS[joint] + (places[PARENTS[joint]] if PARENTS[joint] >= 0 else 0)
    return np.repeat(places[None, None], FRAMES, axis=1)


def truth_of(positions: np.ndarray, known: np.ndarray) -> Truth:
    return Truth(positions, unturned(positions), known, 0)


def unturned(positions: np.ndarray) -> np.ndarray:
    return np.broadcast_to([0.0, 0, 0, 1], (*positions.shape[:-1], 4))


def every(step: int) -> np.ndarray:
    known = np.arange(FRAMES) % step == 0
    known[-1] = True
    return known


def test_key_jumps_and_jerk_are_those_of_plain_loops() -> None:
    rng = np.random.default_rng(0)
    positions, known = rng.normal(size=(2, FRAMES, 9, 3)), every(7)
    joints = np.array([0, 3, 8])
    found = feel(positions, unturned(positions), truth_of(positions, known), joints, None)
    for window in range(2):
        jumps, jerks = [], []
        for t in range(1, FRAMES - 1):
            if known[t] and not (known[t - 1] and known[t + 1]):
                for j in joints:
                    before = (positions[window, t, j] - positions[window, t - 1, j]) * FPS
                    after = (positions[window, t + 1, j] - positions[window, t, j]) * FPS
                    jumps.append(np.sqrt(((after - before) ** 2).sum()))
        for t in range(FRAMES - 3):
            if not known[t : t + 4].all():
                for j in joints:
                    a, b, c, d = positions[window, t : t + 4, j]
                    jerks.append(np.sqrt((((d - c) - 2 * (c - b) + (b - a)) ** 2).sum()) * FPS**3)
        assert found["key_jump_mps"][0][window] == pytest.approx(np.mean(jumps))
        assert found["jerk_mps3"][0][window] == pytest.approx(np.mean(jerks))
    pops = {"largest_turn_deg", "largest_acceleration_mps2", "twist_share", "jolt_share"}
    assert set(found) == {"key_jump_mps", "jerk_mps3", *pops}  # no feet, no model


def test_a_pop_where_windows_meet_stands_out() -> None:
    """A figure on an even path, and the same with a step in it between two windows."""
    times = np.linspace(0, 2, FRAMES)
    path = standing() + np.stack([np.sin(3 * times), times * 0, times], -1)[None, :, None]
    known, joints, seams = every(39), np.arange(9), np.array([19, 20])
    smooth = feel(path, unturned(path), truth_of(path, known), joints, None, seams=seams)["seam_share"][0]
    popped = path.copy()
    popped[:, 20:] += 0.03
    found = feel(popped, unturned(popped), truth_of(path, known), joints, None, seams=seams)["seam_share"][0]
    bends = np.linalg.norm(np.diff(path[0, :, 0], n=2, axis=0), axis=-1)  # of frames 1 to 38
    assert smooth[0] == pytest.approx(bends[[18, 19]].mean() / np.delete(bends, [18, 19]).mean())
    assert found[0] > 5 * smooth[0]
    none = feel(path, unturned(path), truth_of(path, np.ones(FRAMES, bool)), joints, None, seams=seams)["seam_share"][
        0
    ]
    assert np.isnan(none).all()


def test_known_runs_do_not_count_as_jerk_or_skate() -> None:
    truth = standing()
    known = np.ones(FRAMES, bool)
    known[20:25] = False
    made = truth.copy()
    made[:, :10, :, 0] += np.random.default_rng(1).normal(size=(10, 1))  # shaken where it was given
    found = feel(made, unturned(made), truth_of(truth, known), np.arange(9), true_feet(skeleton(), truth))
    assert found["jerk_mps3"][0][0] == pytest.approx(0) and found["foot_skate_mps"][0][0] == pytest.approx(0)


def test_feet_that_slide_and_sink_by_hand() -> None:
    truth, known = standing(), every(5)
    feet = true_feet(skeleton(), truth)
    assert feet is not None and feet.contacts.all()
    made = truth.copy()
    made[..., 0] += 0.3 * np.arange(FRAMES)[:, None] / FPS  # 0.3 m/s sideways
    made[:, ~known, TOES[1], 1] -= 0.02
    made[:, ~known, TOES[0], 1] -= 0.01
    found = feel(made, unturned(made), truth_of(truth, known), np.arange(9), feet)
    assert found["foot_skate_mps"][0][0] == pytest.approx(0.3)
    assert found["floor_penetration_mm"][0][0] == pytest.approx(20)  # the deeper foot, mean over missing frames
    own = feel(truth, unturned(truth), truth_of(truth, known), np.arange(9), feet)
    assert all(values[0] == pytest.approx(0) for values, _ in own.values())


def test_skate_is_that_of_the_contacts_module_where_all_is_missing() -> None:
    rng = np.random.default_rng(2)
    truth, body = standing(), skeleton()
    truth[:, 15:30, 1:5, 1] += 0.2  # one leg lifted
    made = truth + rng.normal(scale=0.01, size=truth.shape)
    feet, own = true_feet(body, truth), find_feet(body)
    assert feet is not None
    known = np.zeros(FRAMES, bool)
    expected = foot_skate_mps(made[0], detect_contacts(truth[0], own, FPS), own, FPS)
    found = feeling.foot_skate_mps(made[:, :, feet.joints], feet.contacts, ~known)
    assert found[0] == pytest.approx(expected)


def test_the_floor_is_the_lowest_of_true_toes_and_ankles_each() -> None:
    truth = standing()
    truth[:, :, 3:5, 1] += 0.03  # the left foot a step higher
    feet = true_feet(skeleton(), truth)
    assert feet is not None
    by_joint = dict(zip(feet.joints.tolist(), feet.floors[0], strict=True))
    assert by_joint[4] == by_joint[8] == pytest.approx(truth[0, 0, 8, 1])
    assert by_joint[3] == by_joint[7] == pytest.approx(truth[0, 0, 7, 1])


def test_a_window_in_the_air_tells_no_floor_and_no_skate() -> None:
    truth, known = standing(), every(5)
    feet = replace(true_feet(skeleton(), truth), contacts=np.zeros((1, FRAMES, 4), bool))
    found = feel(truth - 1, unturned(truth - 1), truth_of(truth, known), np.arange(9), feet)
    assert np.isnan(found["floor_penetration_mm"][0]).all() and np.isnan(found["foot_skate_mps"][0]).all()


def test_what_fell_back_is_counted_in_missing_frames_and_measured_joints_alone() -> None:
    truth, known = standing(), every(2)
    fell_back = np.zeros((1, FRAMES, 9), bool)
    fell_back[:, known] = True  # means nothing
    fell_back[:, ~known, 8] = True  # does not count
    fell_back[:, ~known, 2] = True
    found = feel(truth, unturned(truth), truth_of(truth, known), np.arange(4), None, fell_back)
    assert found["fell_back_share"][0][0] == pytest.approx(1 / 4)


def test_a_skeleton_without_legs_has_no_feet() -> None:
    legless = replace(skeleton(), groups=np.zeros(9, np.int8))
    assert true_feet(legless, standing()) is None


ROW = MetricRow("c", "s", "set", "slerp", "interpolation", 15, "l2p_m", 0.5)


def test_the_table_has_a_row_for_the_truth_and_jerk_as_a_share_of_it() -> None:
    rows = [ROW]
    for clip, scale in (("a", 1.0), ("b", 3.0)):
        for method, jerk, jump in (("truth", 10, 0.1), ("lerp", 6, 0.7), ("slerp", 5, 0.6), ("ours", 8, 0.2)):
            row = replace(ROW, clip=clip, method=method, metric="jerk_mps3", value=jerk * scale)
            rows += [row, replace(row, metric="key_jump_mps", value=jump)]
    rows.append(replace(ROW, clip="a", method="ours", metric="fell_back_share", value=0.25))
    rows.append(replace(ROW, clip="z", method="other clips", metric="jerk_mps3", value=7.0))
    found = cells(rows)
    text = feel_markdown(found, "set")
    assert "| interpolation 15 | truth | 0.100 [0.100, 0.100] |  |  |  | 1.00 |  |" in text
    assert "|  | ours | 0.200 [0.200, 0.200] |  |  |  | 0.80 [0.80, 0.80] | 0.25 |" in text
    assert "|  | other clips |  |  |  |  |  |  |" in text  # no truth of its clips, so no share
    jump = found["set", "interpolation", 15, "key_jump_mps", "ours"]
    assert jump.ratio is None  # smaller is not better
    assert "lerp" in text and not any(" lerp " in line for line in feel_lines(found))
    assert any("ours" in line and "0.80" in line for line in feel_lines(found))
    assert "Jerk" not in task_tables(found) and "truth" not in task_tables(found)


def test_metrics_without_feel_have_no_such_table() -> None:
    assert feel_markdown(cells([ROW]), "set") == "" and feel_lines(cells([ROW])) == []
