"""Every term of eq. 1 against loops in NumPy and SciPy, and what each of them must not see."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from stages.shared.kinematics.matrix_poses import columns_of_matrices
from stages.shared.networks.body_parts.losses import reconstruction_terms, weighted_sum
from stages.shared.networks.body_parts.sizes import LossWeights

PARENTS = np.array([-1, 0, 1, 1])


def _plain_matrix(columns: np.ndarray) -> np.ndarray:
    first = columns[:3] / np.linalg.norm(columns[:3])
    second = columns[3:] - first * (first @ columns[3:])
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=1)


def _plain(made: np.ndarray, truth: np.ndarray, offsets: np.ndarray) -> dict[str, float]:
    """Eq. 1's terms, joint by joint and frame by frame, angles by the trace."""
    windows, frames, joints, _ = made.shape

    def posed(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        local = np.zeros((windows, frames, joints, 3, 3))
        whole, places = np.zeros_like(local), np.zeros((windows, frames, joints, 3))
        for w in range(windows):
            for t in range(frames):
                for j in range(joints):
                    local[w, t, j] = _plain_matrix(columns[w, t, j])
                    above = PARENTS[j]
                    whole[w, t, j] = local[w, t, j] if above < 0 else whole[w, t, above] @ local[w, t, j]
                    if above >= 0:
                        places[w, t, j] = places[w, t, above] + whole[w, t, above] @ offsets[j]
        return local, whole, places

    def angle(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        trace = np.einsum("...ij,...ij->...", one, other)
        return np.arccos(np.clip((trace - 1) / 2, -1, 1))

    (local, whole, places), (local_t, whole_t, places_t) = posed(made), posed(truth)
    angles = angle(whole, whole_t)
    changes = angles[:, 1:] - angles[:, :-1]
    velocities = np.array([changes[:, t : t + 10].mean(1) for t in range(changes.shape[1] - 9)])
    apart = places - places_t
    third = apart[:, 3:] - 3 * apart[:, 2:-1] + 3 * apart[:, 1:-2] - apart[:, :-3]
    return {
        "mse": float(np.mean((made - truth) ** 2)),
        "mpjae": float(angles.mean()),
        "mpjlae": float(angle(local, local_t).mean()),
        "av": float(np.abs(velocities).mean()),
        "aa": float(np.abs(velocities[1:] - velocities[:-1]).mean()),
        "mpjpe": float(np.linalg.norm(apart, axis=-1).mean()),
        "jerk": float(np.linalg.norm(third, axis=-1).mean()),
    }


@pytest.fixture
def windows() -> tuple[torch.Tensor, torch.Tensor, np.ndarray]:
    rng = np.random.default_rng(2)
    shape = (2, 14, len(PARENTS))
    truth = Rotation.random(int(np.prod(shape)), rng)
    made = truth * Rotation.from_rotvec(rng.normal(size=(len(truth), 3)) * 0.4)
    columns = [columns_of_matrices(torch.from_numpy(each.as_matrix())).reshape(*shape, 6) for each in (made, truth)]
    columns[0] = columns[0] * 1.3 + 0.05  # what a network makes is neither unit nor at right angles
    return columns[0], columns[1], rng.normal(size=(len(PARENTS), 3))


def test_every_term_agrees_with_plain_loops(windows):
    made, truth, offsets = windows
    found = reconstruction_terms(made, truth, torch.from_numpy(offsets), PARENTS)
    wanted = _plain(made.numpy(), truth.numpy(), offsets)
    assert found.keys() == wanted.keys() == LossWeights().model_dump().keys()
    for name, value in wanted.items():
        assert float(found[name]) == pytest.approx(value, rel=1e-4), name


def test_the_sum_has_the_paper_s_weights(windows):
    made, truth, offsets = windows
    terms = reconstruction_terms(made, truth, torch.from_numpy(offsets), PARENTS)
    t = {name: float(value) for name, value in terms.items()}
    wanted = t["mse"] + t["mpjae"] + 0.1 * t["mpjlae"] + 0.001 * t["av"] + 0.01 * t["aa"] + 0.1 * t["mpjpe"]
    assert float(weighted_sum(terms, LossWeights().model_dump())) == pytest.approx(
        wanted + 0.001 * t["jerk"], rel=1e-6
    )


def test_a_constant_error_has_no_change_over_time(windows):
    _, truth, offsets = windows
    truth = truth[:, :1].expand(-1, 14, -1, -1)
    made = truth.clone()
    made[:, :, 1] = truth[:, :, 2]
    terms = reconstruction_terms(made, truth, torch.from_numpy(offsets), PARENTS)
    assert terms["mpjae"] > 0.1
    for name in ("av", "aa", "jerk"):
        assert float(terms[name]) < 1e-5, name


def test_the_truth_has_no_error_and_finite_slopes(windows):
    _, truth, offsets = windows
    made = truth.clone().requires_grad_()
    terms = reconstruction_terms(made, truth, torch.from_numpy(offsets), PARENTS)
    value = weighted_sum(terms, LossWeights().model_dump())
    value.backward()
    assert float(value.detach()) < 1e-4
    assert made.grad is not None and torch.isfinite(made.grad).all()


def test_windows_shorter_than_the_differences_leave_their_terms_out(windows):
    made, truth, offsets = windows
    terms = reconstruction_terms(made[:, :3], truth[:, :3], torch.from_numpy(offsets), PARENTS)
    assert [float(terms[name]) for name in ("av", "aa", "jerk")] == [0, 0, 0]
