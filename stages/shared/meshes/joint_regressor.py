"""A linear regressor of joints from vertices, from skinning weights and a few identities.

A joint's head is the point about which its bone turns, so vertices that follow both the bone and its parent move with
it in every pose. The regressor is the affine combination of such vertices nearest to their plain weighted mean that
gives the head's true place on every identity.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data_schemas.skinned_body import Body, JointRegressor, Skin

_SUPPORT = 120  # vertices of a joint, at most
_LEAST_WEIGHT = 1e-4
_RIDGE = 1e-6


def fit_joint_regressor(skin: Skin, bodies: Sequence[Body], bones: Sequence[int]) -> JointRegressor:
    """The regressor of the heads of `bones`, named as the bones are; exact on the given identities at rest.

    Args:
        bodies: identities; more of them leave less freedom, at most (support - 1) / 3 of them can be met.
        bones: K indices.
    """
    dense = skin.dense
    rows, vertices, weights = [], [], []
    for row, bone in enumerate(bones):
        chosen, first = _support(dense, skin.parents, bone)
        solved = _solved(first, [body.vertices[chosen] for body in bodies], [body.heads[bone] for body in bodies])
        rows.append(np.full(len(chosen), row))
        vertices.append(chosen)
        weights.append(solved)
    return JointRegressor(
        tuple(skin.names[bone] for bone in bones),
        np.concatenate(rows).astype(np.int32),
        np.concatenate(vertices).astype(np.int32),
        np.concatenate(weights).astype(np.float32),
    )


def _support(dense: np.ndarray, parents: np.ndarray, bone: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices about a bone's head and their first weights, which sum to 1."""
    parent = parents[bone]
    shared = dense[:, bone] * dense[:, parent] if parent >= 0 else dense[:, bone]
    if (shared > _LEAST_WEIGHT).sum() < 8:  # a bone whose skin does not blend into its parent's
        shared = dense[:, bone]
    if shared.max() <= 0 and parent >= 0:  # a bone without skin
        shared = dense[:, parent]
    if shared.max() <= 0:
        shared = np.ones(len(dense), np.float32)
    chosen = np.argsort(-shared, kind="stable")[:_SUPPORT]
    chosen = np.sort(chosen[shared[chosen] > 0])
    return chosen, shared[chosen].astype(np.float64) / shared[chosen].sum()


def _solved(first: np.ndarray, places: Sequence[np.ndarray], heads: Sequence[np.ndarray]) -> np.ndarray:
    """The weights nearest to `first` that sum to 1 and give every head from its places (S, 3)."""
    constraints = np.concatenate([np.ones((1, len(first))), *(each.T.astype(np.float64) for each in places)])
    wanted = np.concatenate([[1.0], *heads])
    # With fewer vertices than constraints this is a least-squares fit instead of an exact one.
    gram = constraints @ constraints.T + _RIDGE * np.eye(len(constraints)) * np.trace(
        constraints @ constraints.T
    ) / len(constraints)
    solved = first
    for _ in range(5):  # each pass removes what the ridge left over
        solved = solved + constraints.T @ np.linalg.solve(gram, wanted - constraints @ solved)
    return solved
