"""Sines of known amplitude, frequency, offset and phase are found, and made again."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.shared.networks.body_parts.phases import Phases

FRAMES, RATE = 61, 120.0
STEP = RATE / FRAMES  # Hz between bins


def _sines(parameters: torch.Tensor, frames: int = FRAMES, rate: float = RATE) -> torch.Tensor:
    """(B, M, T), written out anew: A sin(2 pi (F t + S)) + C with t = 0 in the middle of the window."""
    times = torch.tensor([(frame - (frames - 1) / 2) / rate for frame in range(frames)])
    a, f, c, s = (each.unsqueeze(-1) for each in parameters.unbind(-1))
    return a * torch.sin(2 * math.pi * f * times + 2 * math.pi * s) + c


@settings(max_examples=30, deadline=None)
@given(st.floats(0.1, 5), st.integers(1, 29), st.floats(-2, 2), st.floats(-0.5, 0.5))
def test_amplitude_frequency_and_offset_of_a_sine_with_whole_cycles(a: float, cycles: int, c: float, s: float):
    phases = Phases(1, FRAMES, RATE)
    signal = _sines(torch.tensor([[[a, cycles * STEP, c, s]]]))
    amplitude, frequency, offset = (float(each) for each in phases.spectrum(signal))
    assert amplitude == pytest.approx(a, rel=1e-3)
    assert frequency == pytest.approx(cycles * STEP, rel=1e-3)
    assert offset == pytest.approx(c, abs=1e-3)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.1, 5), st.integers(1, 29), st.floats(-2, 2), st.floats(-0.49, 0.49))
def test_the_phase_of_a_sine_is_what_the_layer_that_knows_its_frequency_says(
    a: float, cycles: int, c: float, s: float
):
    phases = Phases(1, FRAMES, RATE)
    turn = 2 * math.pi * cycles * STEP * phases.times
    with torch.no_grad():  # projections on cosine and sine: the sine's phase is their angle
        phases.weight[0, 0], phases.weight[0, 1] = turn.sin(), turn.cos()
    signal = _sines(torch.tensor([[[a, cycles * STEP, c, s]]]))
    assert float(phases.phase(signal).detach()) == pytest.approx(s, abs=2e-3)
    torch.testing.assert_close(phases.signals(phases(signal)), signal, atol=2e-2 * a, rtol=0)


def test_the_layer_learns_the_phase_from_the_reconstruction_alone():
    torch.manual_seed(0)
    phases = Phases(1, FRAMES, RATE)
    generator = torch.Generator().manual_seed(1)
    optimiser = torch.optim.Adam(phases.parameters(), 1e-2)

    def drawn(count: int) -> torch.Tensor:
        shares = torch.rand(count, 1, 2, generator=generator)
        constant = torch.ones(count, 1)
        return torch.stack([0.5 + shares[..., 0], constant * 3 * STEP, 0 * constant, shares[..., 1] - 0.5], dim=-1)

    for _ in range(300):
        signals = _sines(drawn(64))
        loss = (phases.signals(phases(signals)) - signals).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    truth = drawn(200)
    apart = phases.phase(_sines(truth)) - truth[..., 3]
    apart = (apart + 0.5) % 1 - 0.5
    assert float(apart.abs().max()) < 0.02


def test_what_is_decoded_of_parameters_is_their_sine():
    phases = Phases(3, 16, 30.0)
    parameters = torch.tensor([[[1.0, 2.0, 0.5, 0.1], [0.0, 1.0, -1.0, 0.3], [2.0, 5.0, 0.0, -0.4]]])
    torch.testing.assert_close(phases.signals(parameters), _sines(parameters, 16, 30.0))


def test_a_constant_signal_has_finite_slopes():
    phases = Phases(2, FRAMES, RATE)
    signals = torch.zeros(1, 2, FRAMES, requires_grad=True)
    phases.signals(phases(signals)).square().sum().backward()
    assert signals.grad is not None and torch.isfinite(signals.grad).all()
