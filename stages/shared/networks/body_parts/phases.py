"""The parameters of a sine for every channel of a latent signal, as in DeepPhase (Starke et al. 2022, eq. 3 to 7).

Amplitude, frequency and offset come from the Fourier transform of a channel over the window; the phase is learnt by
a layer on the channel. The window is centred at time 0.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

_LEAST = 1e-8
PARAMETERS = 4  # of one channel: amplitude, frequency, offset, phase


class Phases(nn.Module):
    """The sine of each of M channels.

    Args:
        channels: M. frames: T of a window. rate_hz: frames a second.
    """

    times: Tensor
    frequencies: Tensor

    def __init__(self, channels: int, frames: int, rate_hz: float):
        super().__init__()
        self.frames = frames
        self.register_buffer("times", (torch.arange(frames) - (frames - 1) / 2) / rate_hz, persistent=False)
        self.register_buffer("frequencies", torch.fft.rfftfreq(frames, 1 / rate_hz), persistent=False)
        bound = 1 / math.sqrt(frames)
        self.weight = nn.Parameter(torch.empty(channels, 2, frames).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.zeros(channels, 2))

    def spectrum(self, signals: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Amplitude, frequency in Hz and offset, (B, M) each, of signals (B, M, T)."""
        coefficients = torch.fft.rfft(signals, dim=-1)
        power = coefficients[..., 1:].abs().square()
        total = power.sum(-1)
        frequency = (power * self.frequencies[1:]).sum(-1) / (total + _LEAST)
        amplitude = 2 / self.frames * (total + _LEAST).sqrt()
        return amplitude, frequency, coefficients[..., 0].real / self.frames

    def phase(self, signals: Tensor) -> Tensor:
        """The phase (B, M) at time 0, in turns, -0.5 to 0.5, of signals (B, M, T)."""
        plane = torch.einsum("bmt,mct->bmc", signals, self.weight) + self.bias
        return torch.atan2(plane[..., 1], plane[..., 0] + _LEAST) / (2 * math.pi)

    def forward(self, signals: Tensor) -> Tensor:
        """The parameters (B, M, 4) of signals (B, M, T): amplitude, frequency, offset, phase."""
        return torch.stack([*self.spectrum(signals), self.phase(signals)], dim=-1)

    def signals(self, parameters: Tensor) -> Tensor:
        """The sines (B, M, T) of parameters (B, M, 4): A sin(2 pi (F t + S)) + C."""
        amplitude, frequency, offset, phase = (each.unsqueeze(-1) for each in parameters.unbind(-1))
        return amplitude * torch.sin(2 * math.pi * (frequency * self.times + phase)) + offset
