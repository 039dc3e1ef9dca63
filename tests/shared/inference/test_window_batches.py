"""Windows in batches: the same latents and points as a window at a time, for clips of any length."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from stages.shared.inference import models
from stages.shared.inference.models import Models, Span, batches_of, load_weights

LENGTHS = st.lists(st.integers(1, 3), max_size=30)


@given(LENGTHS, st.integers(1, 5))
def test_batches_keep_the_order_and_hold_equal_lengths(lengths: list[int], most: int) -> None:
    spans = [Span(at, at + length, at, at + length, torch.ones(length)) for at, length in enumerate(lengths)]
    batches = list(batches_of(spans, most))
    assert [span.first for batch in batches for span in batch] == list(range(len(lengths)))
    for batch in batches:
        assert 1 <= len(batch) <= most and len({span.last - span.first for span in batch}) == 1


@pytest.fixture(scope="module")
def weights() -> Models:
    return load_weights("tiny", "cpu")


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
