"""Attention over time: rotary positions are true rotations, masks leak nothing."""

from collections.abc import Callable

import pytest
import torch
from torch.nn import functional as F

from stages.shared.networks.layers.attention import TimeAttention, TimeLayer, attend, rotary_angles, rotate, sinusoids


def test_rotary_step_keeps_lengths_and_scores_depend_on_the_gap_alone():
    query, key = torch.randn(1, 1, 1, 16), torch.randn(1, 1, 1, 16)

    def score(first: float, second: float) -> torch.Tensor:
        turned = [
            rotate(part, *rotary_angles(torch.tensor([[time]]), 16)) for part, time in ((query, first), (key, second))
        ]
        torch.testing.assert_close(turned[0].norm(), query.norm())
        return (turned[0] * turned[1]).sum()

    expected = score(0.0, 3.25)
    for start in (10.0, 50.5, 100.0):
        torch.testing.assert_close(score(start, start + 3.25), expected, atol=1e-3, rtol=1e-4)


def test_attention_agrees_with_the_formula_written_out():
    layer = TimeAttention(8, 2).eval()
    frames, times = torch.randn(1, 5, 8), torch.tensor([[0.0, 1.0, 2.5, 3.0, 7.0]])
    known = torch.tensor([[True, False, True, True, False]])
    query, (key, value) = layer.query(frames), layer.key_value(frames).chunk(2, -1)
    out = torch.zeros(1, 5, 8)
    for head in range(2):
        part = slice(4 * head, 4 * head + 4)
        angles = rotary_angles(times, 4)
        q, k = (rotate(each[:, None, :, part], *angles)[0, 0] for each in (query, key))
        scores = (q @ k.T / 2).masked_fill(~known, float("-inf")).softmax(-1)
        out[0, :, part] = scores @ value[0, :, part]
    torch.testing.assert_close(layer(frames, times, known=known), layer.out(out))


def test_unknown_memory_changes_nothing():
    layer = TimeLayer(16, 4, asks_memory=True).eval()
    frames, memory, times = torch.randn(2, 6, 16), torch.randn(2, 6, 16), torch.arange(6.0).unsqueeze(0)
    known = torch.tensor([[True, True, False, False, True, False]]).expand(2, -1)
    changed = torch.where(known.unsqueeze(-1), memory, 100 * torch.randn(2, 6, 16))
    first = layer(frames, times, memory, times, known)
    torch.testing.assert_close(layer(frames, times, changed, times, known), first)


def test_shifting_all_times_changes_nothing():
    layer = TimeLayer(16, 4).eval()
    frames, times = torch.randn(1, 9, 16), torch.arange(9.0).unsqueeze(0)
    torch.testing.assert_close(layer(frames, times + 37.5), layer(frames, times), atol=1e-4, rtol=1e-4)


def test_sinusoids_are_the_formula_written_out():
    times = torch.tensor([[0.0, 2.5]])
    for step in range(4):
        angle = times / 10000 ** (2 * step / 8)
        torch.testing.assert_close(sinusoids(times, 8)[..., step], angle.sin())
        torch.testing.assert_close(sinusoids(times, 8)[..., 4 + step], angle.cos())


def queries_keys_values(dtype: torch.dtype) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(4)
    return [torch.randn(2, 3, frames, 16, generator=generator).to(dtype).requires_grad_() for frames in (24, 31, 31)]


def masks(kind: str, dtype: torch.dtype) -> torch.Tensor | None:
    generator = torch.Generator().manual_seed(5)
    known = torch.rand(2, 1, 1, 31, generator=generator) > 0.4
    bias = torch.randn(2, 3, 24, 31, generator=generator).masked_fill(~known, float("-inf")).to(dtype)
    return {"none": None, "mask": known, "bias": bias}[kind]


@pytest.mark.parametrize("kind", ["none", "mask", "bias"])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_attention_and_its_gradients_are_as_near_to_the_exact_as_the_fused_kernel(kind: str, dtype: torch.dtype):
    """Against float64 on the same rounded inputs: bfloat16's error is no more than twice the fused kernel's."""

    def values_and_gradients(
        run: Callable[..., torch.Tensor], inputs: list[torch.Tensor], mask: torch.Tensor | None
    ) -> list[torch.Tensor]:
        made = run(*inputs, mask)
        weights = torch.linspace(-1, 1, made.numel(), dtype=made.dtype).view(made.shape)
        return [each.double() for each in (made, *torch.autograd.grad((made * weights).sum(), inputs))]

    inputs, mask = queries_keys_values(dtype), masks(kind, dtype)
    exactly = [each.detach().double().requires_grad_() for each in inputs]
    exact_mask = mask if mask is None or mask.dtype == torch.bool else mask.double()
    exact = values_and_gradients(F.scaled_dot_product_attention, exactly, exact_mask)
    fused = values_and_gradients(F.scaled_dot_product_attention, inputs, mask)
    ours = values_and_gradients(attend, inputs, mask)
    rounding = {torch.float32: 1e-6, torch.bfloat16: 8e-3}[dtype]
    for true, one, two in zip(exact, fused, ours, strict=True):
        assert (two - true).norm() < max(2 * (one - true).norm(), rounding * true.norm())
    query, key, value = inputs
    with torch.no_grad():
        torch.testing.assert_close(
            attend(query, key, value, mask).double(), exact[0], atol=2 * rounding, rtol=2 * rounding
        )


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_what_is_masked_leaks_nothing_and_learns_nothing(dtype: torch.dtype):
    query, key, value = queries_keys_values(dtype)
    known = masks("mask", dtype)
    assert known is not None
    hidden = ~known[:, :, 0, :, None]  # (2, 1, 31, 1)
    other_key, other_value = (
        torch.where(hidden, 100 * torch.randn_like(each), each).detach().requires_grad_() for each in (key, value)
    )
    made = attend(query, key, value, known)
    changed = attend(query, other_key, other_value, known)
    assert torch.equal(changed, made)
    for gradient in torch.autograd.grad(changed.float().square().sum(), [other_key, other_value]):
        assert not (gradient * hidden).any() and gradient.any()
