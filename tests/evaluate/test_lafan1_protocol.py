"""The LaFAN1 benchmark's definitions beside a slow implementation of them, window by window and joint by joint."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stages.shared.statistics.baselines import Poses, slerp, zero_velocity
from stages.shared.statistics.measurements import (
    Truth,
    hip_joints,
    is_lafan1,
    measure_lafan1,
    position_deviation,
)
from stages.shared.statistics.tasks import TRANSITION
from stages.shared.statistics.windows import LAFAN1_CONTEXT, LAFAN1_STRIDE, Task, clip_windows
from tests.evaluate.swaying import skeleton, swaying

ROOT = 1


def facing(pelvis: np.ndarray) -> Rotation:
    """The turn about Y after which the pelvis' Y axis has no X."""
    forward = Rotation.from_quat(pelvis).apply([0, 1, 0]) * [1, 0, 1]
    forward /= np.linalg.norm(forward)
    return Rotation.from_rotvec([0, -np.arctan2(forward[0], forward[2]), 0])


def slow_deviation(windows: np.ndarray, roots: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Deviations of joints and axes over all frames of all centred and turned windows."""
    values = []
    for window, root in zip(windows, roots, strict=True):
        middle = window[:, ROOT].mean(0) * [1, 0, 1]
        turn = facing(root[9])
        values += [[turn.apply(frame[j] - middle) for j in joints] for frame in window]
    return np.std(np.array(values), axis=0)


def slow_figures(made, true, known, joints, deviation) -> tuple[float, float, float]:
    """L2P, L2Q and NPSS over all windows, as that benchmark's text has them."""
    l2p, l2q, distances, powers = [], [], [], []
    gap = np.flatnonzero(~known)
    for p, q, p_true, q_true in zip(*made, *true, strict=True):
        turn = facing(q_true[gap[0] - 1, ROOT])
        series = []
        for rotations in (q, q_true):
            kept = np.array([[(turn * Rotation.from_quat(f[j])).as_quat() for j in joints] for f in rotations])
            for frame in range(1, len(kept)):  # signs go on from frame to frame
                for j in range(len(joints)):
                    if kept[frame, j] @ kept[frame - 1, j] < 0:
                        kept[frame, j] *= -1
            series.append(kept)
        for j in range(len(joints)):  # both begin at the same known frame
            if series[0][0, j] @ series[1][0, j] < 0:
                series[0][:, j] *= -1
        for frame in gap:
            error = [turn.apply(p[frame, j] - p_true[frame, j]) for j in joints] / deviation
            l2p.append(np.sqrt((error**2).sum()))
            l2q.append(np.sqrt(((series[0][frame] - series[1][frame]) ** 2).sum()))
        for j in range(len(joints)):
            for axis in range(4):
                one, two = (np.real(np.fft.fft(s[gap, j, axis])) ** 2 for s in series)
                distances.append(np.abs(np.cumsum(one / one.sum()) - np.cumsum(two / two.sum())).sum())
                powers.append(two.sum())
    return float(np.mean(l2p)), float(np.mean(l2q)), float(np.average(distances, weights=powers))


@pytest.mark.parametrize("fill", [slerp, zero_velocity])
def test_figures_are_those_of_the_slow_implementation(fill) -> None:
    rig = skeleton()
    motions = [swaying(seed, 26) for seed in range(3)]
    poses = Poses.of(rig, motions)
    joints, across = np.arange(1, 8), hip_joints(rig)
    known = Task(TRANSITION, 15, 65, LAFAN1_CONTEXT).known(26)
    assert list(np.flatnonzero(~known)) == list(range(10, 25))
    training = Poses.of(rig, [swaying(seed, 50) for seed in range(5, 9)])
    windows, roots = training.positions.numpy(), training.rotations.numpy()[:, :, ROOT]
    deviation = position_deviation(windows, joints, across, ROOT, roots)
    np.testing.assert_allclose(deviation, slow_deviation(windows, roots, joints), rtol=1e-5)
    truth = Truth(poses.positions.numpy(), poses.rotations.numpy(), known, ROOT)
    made = fill(poses, known)
    found = measure_lafan1(*made, truth, joints, across, deviation, by_root=True)
    slow = slow_figures(made, (truth.positions, truth.rotations), known, joints, deviation)
    averages = [
        float(np.average(found[name][0], weights=found[name][1]))
        if name == "npss_lafan1"
        else float(found[name][0].mean())
        for name in found
    ]
    assert averages == pytest.approx(slow, rel=1e-5)


@pytest.mark.parametrize("gap", [5, 15, 30, 45])
def test_windows_begin_every_forty_frames_where_sixty_five_fit(gap: int) -> None:
    task = Task(TRANSITION, gap, 65, LAFAN1_CONTEXT, LAFAN1_STRIDE)
    starts, first = [], 0
    while first + 65 < 300:
        starts.append(first)
        first += 40
    found = clip_windows("a", 300, task)
    assert [window.start for window in found] == starts and {window.frames for window in found} == {gap + 11}
    assert clip_windows("a", 65, task) == []


def test_the_rig_is_known_by_its_joints() -> None:
    assert not is_lafan1(skeleton())
