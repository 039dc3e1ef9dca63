"""The von Mises-Fisher distribution: moments of samples, the divergence by integration, gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.integrate import quad
from scipy.stats import kstest, vonmises_fisher

from stages.shared.networks.body_parts.hyperspheres import divergence_from_uniform, mean_resultant, sample

CONCENTRATIONS = [0.001, 0.02, 0.5, 1.0, 4.0, 30.0, 300.0]


@pytest.mark.parametrize("concentration", CONCENTRATIONS)
def test_samples_have_the_moments_of_the_closed_form(concentration: float):
    count = 40_000
    mean = torch.nn.functional.normalize(torch.tensor([0.3, -0.5, 0.8], dtype=torch.float64), dim=0)
    kappa = torch.full((count,), concentration, dtype=torch.float64)
    drawn = sample(mean.expand(count, 3), kappa, torch.Generator().manual_seed(3))
    torch.testing.assert_close(drawn.norm(dim=-1), torch.ones(count, dtype=torch.float64))
    k = concentration
    resultant = 1 / np.tanh(k) - 1 / k if k > 0.01 else k / 3
    assert abs(float(mean_resultant(kappa[0])) - resultant) < 1e-6
    cosine = drawn @ mean
    variance = 1 - 2 * resultant / k - resultant**2 if k > 0.01 else 1 / 3
    error = 5 * np.sqrt(max(variance, 1e-9) / count)
    assert abs(float(cosine.mean()) - resultant) < error
    assert abs(float(cosine.var()) - variance) < 0.05 * variance
    # Across the mean nothing is preferred: the mean vector is resultant x mean.
    np.testing.assert_allclose(drawn.mean(0).numpy(), resultant * mean.numpy(), atol=5 / np.sqrt(count))


@pytest.mark.parametrize("concentration", [0.5, 4.0, 30.0])
def test_samples_have_the_distribution_of_the_cosine(concentration: float):
    count, k = 5000, concentration
    mean = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand(count, 3)
    drawn = sample(mean, torch.full((count,), k, dtype=torch.float64), torch.Generator().manual_seed(5))
    cumulative = lambda w: (np.exp(k * (w - 1)) - np.exp(-2 * k)) / (1 - np.exp(-2 * k))  # noqa: E731
    assert kstest(drawn[:, 2].numpy(), cumulative).pvalue > 1e-3
    turn = torch.atan2(drawn[:, 1], drawn[:, 0]).numpy() / (2 * np.pi) + 0.5
    assert kstest(turn, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("concentration", CONCENTRATIONS)
def test_the_divergence_is_the_integral(concentration: float):
    k = concentration
    log_scale = np.log(k / (2 * np.pi)) - np.log1p(-np.exp(-2 * k)) - k  # of the density exp(k w) on the sphere

    def integrand(w: float) -> float:
        density = np.exp(log_scale + k * w)
        return 2 * np.pi * density * (log_scale + k * w + np.log(4 * np.pi))

    wanted = quad(integrand, -1, 1, points=[1 - 1 / k] if k > 2 else None)[0]
    found = float(divergence_from_uniform(torch.tensor(k, dtype=torch.float64)))
    assert found == pytest.approx(wanted, rel=1e-3, abs=1e-9)
    if k >= 0.5:  # SciPy's entropy is of the same density
        entropy = vonmises_fisher(np.array([0.0, 0.0, 1.0]), k).entropy()
        assert found == pytest.approx(np.log(4 * np.pi) - entropy, rel=1e-5)


def test_samples_and_divergence_have_finite_slopes():
    mean = torch.nn.functional.normalize(torch.randn(6, 3, generator=torch.Generator().manual_seed(0)), dim=-1)
    mean.requires_grad_()
    kappa = torch.tensor([1e-6, 0.005, 0.011, 1.0, 50.0, 2000.0], requires_grad=True)
    value = sample(mean, kappa, torch.Generator().manual_seed(1)).sum() + divergence_from_uniform(kappa).sum()
    value.backward()
    assert mean.grad is not None and torch.isfinite(mean.grad).all()
    assert kappa.grad is not None and torch.isfinite(kappa.grad).all()
