"""Anchor concepts: groups of an action's anchor poses (motion concepts 3.1.2), found by scikit-learn.

Poses are relative to the pelvis and turned to face +Z; their distance is the L2 norm over all joints. k-means and
Ward take the fewest clusters, from 2 to `MOST_CLUSTERS`, within which at most `_LEFT` of the poses' variance is
left (the paper states no rule; the largest silhouette gives two clusters for most actions, which tell little of a
pose). DBSCAN's radius is the 90th percentile of the distance to the fifth neighbour, and OPTICS needs clusters of
at least five poses; poses that these two leave out belong to the nearest concept. A concept is the mean of its
poses. Only training clips form concepts; the anchors of all clips get the nearest one.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.clips import ClipRow
from data_schemas.concepts import SegmentedClip, StoredBody
from data_schemas.errors import UsageError
from stages.shared.concepts.body_positions import relative_poses

MOST_CLUSTERS = 10
_MOST_POSES = 4000  # of one action, drawn at random: Ward and OPTICS compare all pairs
_NEIGHBOURS = 5
_LEFT = 0.25
_SCORED = 500  # poses of an action whose silhouette is taken


@dataclass(frozen=True)
class AnchorConcepts:
    """labels: clip -> (A,) int32 concept of each anchor. centres: action -> (n, J, 3) float32 metres.
    silhouettes: action -> mean silhouette of its concepts, where there are at least two."""

    labels: dict[str, np.ndarray]
    centres: dict[str, np.ndarray]
    silhouettes: dict[str, float]


def needs_sklearn() -> None:
    """Raise UsageError if scikit-learn is not installed."""
    try:
        import sklearn  # noqa: F401
    except ImportError:
        raise UsageError("Motion concepts need scikit-learn.", "Install it: pip install 'pumps[concepts]'.") from None


def cluster_actions(
    clips: Sequence[tuple[ClipRow, SegmentedClip]], body: StoredBody, method: str, number: int | None, seed: int
) -> AnchorConcepts:
    """Concepts of each action.

    Args:
        clips: with their splits; all on `body`. Clips without an action are left out.
        method: kmeans, dbscan, optics or ward. number: of clusters, for kmeans and ward; None for the rule above.

    Raises: UsageError without scikit-learn.
    """
    needs_sklearn()
    anchors = {row.clip: relative_poses(clip.positions[clip.anchors], body.groups) for row, clip in clips}
    by_action: dict[str, list[np.ndarray]] = defaultdict(list)
    for row, clip in clips:
        if clip.action and row.split == "train":
            by_action[clip.action].append(anchors[row.clip])
    centres: dict[str, np.ndarray] = {}
    silhouettes: dict[str, float] = {}
    for action in sorted(by_action):
        poses = np.concatenate(by_action[action])
        rng = np.random.default_rng(seed)
        if len(poses) > _MOST_POSES:
            poses = poses[np.sort(rng.choice(len(poses), _MOST_POSES, replace=False))]
        flat = poses.reshape(len(poses), -1).astype(np.float64)
        labels, score = cluster_poses(flat, method, number, seed)
        centres[action] = np.stack([poses[labels == label].mean(axis=0) for label in range(labels.max() + 1)]).astype(
            np.float32
        )
        if score is not None:
            silhouettes[action] = score
    labels = {
        row.clip: nearest_concept(anchors[row.clip], centres[clip.action])
        for row, clip in clips
        if clip.action in centres
    }
    return AnchorConcepts(labels, centres, silhouettes)


def nearest_concept(poses: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(A,) int32: for poses (A, J, 3) the nearest of the centres (n, J, 3)."""
    apart = poses.reshape(len(poses), 1, -1) - centres.reshape(1, len(centres), -1)
    return np.square(apart).sum(axis=-1).argmin(axis=1).astype(np.int32)


def cluster_poses(flat: np.ndarray, method: str, number: int | None, seed: int) -> tuple[np.ndarray, float | None]:
    """Labels (N,) from 0 on of poses (N, F), and their mean silhouette (None for fewer than two clusters)."""
    from sklearn.cluster import DBSCAN, OPTICS
    from sklearn.neighbors import NearestNeighbors

    if len(flat) < 4:
        return np.zeros(len(flat), np.int32), None
    if method in ("kmeans", "ward"):
        counts = [number] if number else list(range(2, MOST_CLUSTERS + 1))
        whole = np.square(flat - flat.mean(axis=0)).sum()
        labels = np.zeros(len(flat), np.int32)
        for count in counts:
            if count >= len(flat):
                break
            labels = _of_count(flat, method, count, seed)
            within = sum(np.square(flat[labels == k] - flat[labels == k].mean(axis=0)).sum() for k in range(count))
            if within <= _LEFT * whole:
                break
        return _from_zero(labels), _silhouette(flat, labels, seed)
    if method == "dbscan":
        near = NearestNeighbors(n_neighbors=min(_NEIGHBOURS, len(flat) - 1)).fit(flat)
        radius = float(np.percentile(near.kneighbors()[0][:, -1], 90))
        labels = DBSCAN(eps=max(radius, 1e-9), min_samples=_NEIGHBOURS).fit_predict(flat)
    else:
        labels = OPTICS(min_samples=min(_NEIGHBOURS, len(flat)), min_cluster_size=_NEIGHBOURS).fit_predict(flat)
    if labels.max() < 0:
        return np.zeros(len(flat), np.int32), None
    means = np.stack([flat[labels == label].mean(axis=0) for label in range(labels.max() + 1)])
    labels = np.where(labels < 0, nearest_concept(flat[:, :, None], means[:, :, None]), labels)
    return _from_zero(labels), _silhouette(flat, labels, seed)


def _silhouette(flat: np.ndarray, labels: np.ndarray, seed: int) -> float | None:
    """Mean silhouette of at most `_SCORED` poses, None where fewer than two clusters are among them."""
    from sklearn.metrics import silhouette_score

    chosen = np.random.default_rng(seed).permutation(len(flat))[:_SCORED]
    if not 1 < len(np.unique(labels[chosen])) < len(chosen):
        return None
    return float(silhouette_score(flat[chosen], labels[chosen]))


def _of_count(flat: np.ndarray, method: str, count: int, seed: int) -> np.ndarray:
    from sklearn.cluster import AgglomerativeClustering, KMeans

    if method == "ward":
        return AgglomerativeClustering(count, linkage="ward").fit_predict(flat)
    found = KMeans(count, n_init=4, random_state=seed)  # pyright: ignore[reportArgumentType]
    return found.fit_predict(flat)


def _from_zero(labels: np.ndarray) -> np.ndarray:
    """The labels renumbered from 0 on, without holes."""
    return np.unique(labels, return_inverse=True)[1].astype(np.int32)
