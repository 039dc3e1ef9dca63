"""The quality of an anchor (motion concepts 3.2.1): its log-likelihood under a mixture of two normal distributions.

The mixture is fitted by maximum likelihood to the features that the recogniser finds for the anchors of one action's
real motions, with full covariances and 1e-3 on their diagonals. Anchors that score lower than `share` of the real
ones are flawed; the paper does not say how low is low.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

COMPONENTS = 2  # appendix A
_PCA = 16  # directions that are kept: an action may have fewer anchors than a feature has numbers
_RIDGE = 1e-3


@dataclass(frozen=True)
class AnchorQuality:
    """A mixture on projected features: centre (D,), directions (D, P); weights (K,), means (K, P), precisions
    (K, P, P) and log_norms (K,) of its parts; `threshold`: anchors that score lower are flawed."""

    centre: np.ndarray
    directions: np.ndarray
    weights: np.ndarray
    means: np.ndarray
    precisions: np.ndarray
    log_norms: np.ndarray
    threshold: float

    def scores(self, features: np.ndarray) -> np.ndarray:
        """(N,) log-likelihoods of features (N, D)."""
        places = (np.asarray(features, np.float64) - self.centre) @ self.directions
        apart = places[:, None] - self.means
        distances = np.einsum("nkp,kpq,nkq->nk", apart, self.precisions, apart)
        logs = np.log(self.weights) + self.log_norms - distances / 2
        top = logs.max(axis=1)
        return top + np.log(np.exp(logs - top[:, None]).sum(axis=1))

    def arrays(self) -> dict[str, np.ndarray]:
        """Its numbers as float32 arrays for a checkpoint; the rounding hardly changes a score."""
        return {
            name: np.asarray(value, np.float32).reshape(np.shape(value) or (1,)) for name, value in vars(self).items()
        }

    @staticmethod
    def of_arrays(arrays: dict[str, np.ndarray]) -> AnchorQuality:
        values = {name: np.asarray(array, np.float64) for name, array in arrays.items()}
        threshold = float(values.pop("threshold")[0])
        return AnchorQuality(**values, threshold=threshold)


def fit_quality(features: np.ndarray, share: float, seed: int) -> AnchorQuality:
    """The mixture of features (N, D), by scikit-learn.

    Args:
        share: of these features that score below the threshold.
    """
    from sklearn.mixture import GaussianMixture

    features = np.asarray(features, np.float64)
    centre = features.mean(axis=0)
    _, sizes, across = np.linalg.svd(features - centre, full_matrices=False)
    kept = max(1, min(_PCA, int((sizes > 1e-6 * max(sizes[0], 1e-12)).sum()), len(features) // 4))
    directions = across[:kept].T / np.maximum(sizes[:kept] / np.sqrt(len(features)), 1e-9)
    places = (features - centre) @ directions
    parts = min(COMPONENTS, len(features))
    mixture = GaussianMixture(parts, reg_covar=_RIDGE, random_state=seed).fit(places)
    precisions = np.asarray(mixture.precisions_)
    log_norms = 0.5 * np.linalg.slogdet(precisions)[1] - 0.5 * kept * np.log(2 * np.pi)
    quality = AnchorQuality(
        centre, directions, np.asarray(mixture.weights_), np.asarray(mixture.means_), precisions, log_norms, 0.0
    )
    threshold = float(np.quantile(quality.scores(features), share))
    return AnchorQuality(**{**vars(quality), "threshold": threshold})
