"""The quality score against SciPy's normal distributions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from stages.shared.concepts.quality import AnchorQuality, fit_quality


def mixture() -> AnchorQuality:
    rng = np.random.default_rng(0)
    shapes = [np.eye(3) + 0.3 * np.outer(v, v) for v in rng.normal(size=(2, 3))]
    precisions = np.stack([np.linalg.inv(shape) for shape in shapes])
    log_norms = 0.5 * np.linalg.slogdet(precisions)[1] - 1.5 * np.log(2 * np.pi)
    directions = np.linalg.qr(rng.normal(size=(5, 3)))[0]
    return AnchorQuality(
        rng.normal(size=5), directions, np.array([0.3, 0.7]), rng.normal(size=(2, 3)), precisions, log_norms, -9.0
    )


def test_scores_are_log_likelihoods_of_the_mixture():
    quality, features = mixture(), np.random.default_rng(1).normal(size=(20, 5))
    places = (features - quality.centre) @ quality.directions
    expected = np.log(
        sum(
            weight * multivariate_normal(mean, np.linalg.inv(precision)).pdf(places)
            for weight, mean, precision in zip(quality.weights, quality.means, quality.precisions, strict=True)
        )
    )
    np.testing.assert_allclose(quality.scores(features), expected, rtol=1e-9)
    stored = AnchorQuality.of_arrays(quality.arrays())
    np.testing.assert_allclose(stored.scores(features), quality.scores(features), rtol=1e-4, atol=1e-4)
    assert stored.threshold == -9.0


def test_a_share_of_real_anchors_and_all_strange_ones_are_flawed():
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(2)
    real = np.concatenate([rng.normal(size=(200, 12)), rng.normal(size=(200, 12)) + 4])
    quality = fit_quality(real, 0.05, 0)
    assert (quality.scores(real) < quality.threshold).mean() == pytest.approx(0.05, abs=0.005)
    assert (quality.scores(real + rng.normal(scale=30, size=real.shape)) < quality.threshold).mean() > 0.95
