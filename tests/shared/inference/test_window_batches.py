"""Windows in batches: the same latents and points as a window at a time, for clips of any length."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from stages.shared.inference import models
from stages.shared.inference.models import Models, Span, batches_of, load_weights

LENGTHS = st.lists(st.integers(1, 3), max_size=30)


@given(LENGTHS, st.integers(1, 12))
def test_batches_hold_all_windows_of_one_length_in_order(lengths: list[int], frames: int) -> None:
    spans = [Span(at, at + length, at, at + length, torch.ones(length)) for at, length in enumerate(lengths)]
    batches = list(batches_of(spans, frames))
    for length in range(1, 4):
        own = [batch for batch in batches if batch[0].last - batch[0].first == length]
        wanted = [at for at, one in enumerate(lengths) if one == length]
        assert [span.first for batch in own for span in batch] == wanted
        most = max(1, frames // length)
        assert all(len(batch) == most for batch in own[:-1]) and all(1 <= len(batch) <= most for batch in own)
    assert sum(len(batch) for batch in batches) == len(lengths)


@pytest.fixture(scope="module")
def weights() -> Models:
    return load_weights("small-free", "cpu")


@pytest.mark.parametrize("frames", [1, 40, 64, 65, 300])
def test_a_batch_gives_what_each_window_gives_alone(weights: Models, frames: int, monkeypatch) -> None:
    coder = weights.autoencoder
    drawn = torch.Generator().manual_seed(frames)
    latents = torch.randn(frames, coder.encoder.latent_width, generator=drawn)
    centroids = torch.randn(frames, 3, generator=drawn)
    times = torch.arange(frames).double()
    known = torch.zeros(frames, dtype=torch.bool)
    known[:: max(1, frames // 7)] = True
    groups, noise = torch.arange(20) % 5, coder.draw_noise(20, 0)

    def made() -> list[torch.Tensor]:
        filled = weights.synthesise(latents, centroids, known, times, (latents, centroids))
        return [coder.decode(latents, centroids, times, groups, noise), *filled]

    together = made()
    monkeypatch.setattr(models, "batches_of", lambda spans: ([span] for span in spans))
    for one, other in zip(together, made(), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-5)
