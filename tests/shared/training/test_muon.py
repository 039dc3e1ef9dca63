"""Muon: beside PyTorch's own in bfloat16, and its iteration beside a plain one in float64."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from stages.shared.training import muon
from stages.shared.training.muon import Muon, equal_singular_values


def plain_iteration(matrix: torch.Tensor) -> torch.Tensor:
    """The quintic iteration as Jordan et al. write it, in float64."""
    x = matrix.double()
    x = x / x.norm().clamp(min=1e-7)
    for _ in range(5):
        x = 3.4445 * x - 4.7750 * (x @ x.T) @ x + 2.0315 * (x @ x.T) @ (x @ x.T) @ x
    return x


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 24), st.integers(1, 24), st.floats(0, 4), st.floats(-20, 20), st.integers(0, 1000))
def test_the_fast_iteration_is_the_plain_one(rows, columns, decades, exponent, seed):
    """Wide, square and upright matrices, singular values over some decades, of any size."""
    generator = torch.Generator().manual_seed(seed)
    matrix = torch.randn(rows, columns, generator=generator) * torch.logspace(0, -decades, columns) * 2.0**exponent
    plain = plain_iteration(matrix)
    found = equal_singular_values(matrix, torch.float32)
    assert found.shape == matrix.shape
    # bfloat16, in which Muon is usually computed, differs by hundredths.
    assert float((found.double() - plain).norm()) < 2e-3 * float(plain.norm()) + 1e-6


def test_a_matrix_of_zeros_stays_zero():
    for shape in ((3, 3), (3, 12)):
        assert torch.equal(equal_singular_values(torch.zeros(shape), torch.float32), torch.zeros(shape))


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize("shape", [(16, 16), (32, 16), (16, 64)])
def test_steps_are_those_of_torch(monkeypatch, dtype, shape):
    """In bfloat16 the same numbers; in float32 as near as bfloat16 allows."""
    monkeypatch.setattr(muon, "computes_bfloat16", lambda device: dtype == torch.bfloat16)
    generator = torch.Generator().manual_seed(3)
    start = torch.randn(shape, generator=generator)
    ours, theirs = nn.Parameter(start.clone()), nn.Parameter(start.clone())
    own = Muon([ours], lr=0.02, weight_decay=0.1)
    torchs = torch.optim.Muon([theirs], lr=0.02, weight_decay=0.1, adjust_lr_fn="match_rms_adamw")
    for _ in range(4):
        gradient = torch.randn(shape, generator=generator)
        for parameter, optimiser in ((ours, own), (theirs, torchs)):
            parameter.grad = gradient.clone()
            optimiser.step()
    moved, expected = (ours - start).detach(), (theirs - start).detach()
    assert torch.equal(own.state[ours]["momentum_buffer"], torchs.state[theirs]["momentum_buffer"])
    if dtype == torch.bfloat16:
        assert torch.equal(moved, expected)
    else:
        assert float((moved - expected).norm() / expected.norm()) < 0.03
