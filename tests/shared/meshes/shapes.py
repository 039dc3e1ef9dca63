"""Small meshes for tests: a flat grid, a sphere, and a body of two bones."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from data_schemas.skinned_body import Body, JointRegressor, Skin, Topology


def grid(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (N, 3) of a flat sheet of unit squares, each cut into two triangles, and the triangles (F, 3)."""
    y, x = np.mgrid[:rows, :columns]
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float32)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([a, a + 1, a + columns], axis=1)
    upper = np.stack([a + 1, a + columns + 1, a + columns], axis=1)
    return vertices, np.concatenate([lower, upper]).astype(np.int32)


def ball(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) on the unit sphere and the triangles of their hull: irregular, so that no eigenvalue repeats."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points.astype(np.float32), ConvexHull(points).simplices.astype(np.int32)


def arm(around: int = 8, along: int = 12) -> tuple[Topology, Body]:
    """A tube of 1 m along Y on two bones that meet at its middle, with a regressor of the middle."""
    turn = np.arange(around) / around * 2 * np.pi
    height = np.linspace(0, 1, along)
    vertices = np.stack(
        [0.1 * np.cos(turn)[None] + 0 * height[:, None], height[:, None] + 0 * turn[None],
         0.08 * np.sin(turn)[None] + 0 * height[:, None]], axis=-1,
    ).reshape(-1, 3)  # fmt: skip
    faces = []
    for ring in range(along - 1):
        for at in range(around):
            a, b = ring * around + at, ring * around + (at + 1) % around
            faces += [(a, b, a + around), (b, b + around, a + around)]
    share = np.clip((vertices[:, 1] - 0.3) / 0.4, 0, 1)
    weights = np.stack([1 - share, share], axis=1).astype(np.float32)
    skin = Skin(
        ("lower", "upper"), np.array([-1, 0], np.int32), np.tile(np.array([0, 1], np.int16), (len(vertices), 1)),
        weights,
    )  # fmt: skip
    ring = np.flatnonzero(np.abs(vertices[:, 1] - height[along // 2]) < 1e-6)
    regressor = JointRegressor(
        ("elbow",),
        np.zeros(len(ring), np.int32),
        ring.astype(np.int32),
        np.full(len(ring), 1 / len(ring), np.float32),
    )
    topology = Topology(np.array(faces, np.int32), len(vertices), regressor, skin)
    return topology, Body(vertices.astype(np.float32), np.array([[0, 0, 0], [0, 0.5, 0]], np.float64))


def arm_poses(frames: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (T, 2, 4) global xyzw and heads (T, 2, 3) metres of the arm: it bends and turns."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    times = np.arange(frames) / 25
    lower = Rotation.from_rotvec(np.outer(np.sin(2 * times + rng.uniform(0, 6)), rng.normal(size=3) * 0.4))
    upper = lower * Rotation.from_rotvec(np.outer(np.sin(3 * times + rng.uniform(0, 6)), (1.2, 0.1, 0.2)))
    heads = np.zeros((frames, 2, 3))
    heads[:, 1] = lower.apply((0.0, 0.5, 0.0))
    rotations = np.stack([lower.as_quat(), upper.as_quat()], axis=1)
    rotations[rotations[..., 3] < 0] *= -1
    return rotations.astype(np.float32), heads.astype(np.float32)
