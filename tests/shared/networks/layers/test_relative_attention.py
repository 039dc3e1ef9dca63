"""Learned relative positions: nothing before training, then a function of the distance of times alone."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional as F

from stages.shared.networks.layers.relative_attention import RelativeAttention, RelativeLayer


def trained(width: int = 12, heads: int = 3, longest: int = 5, seed: int = 0) -> RelativeAttention:
    """An attention whose table is no longer zero, in float64."""
    torch.manual_seed(seed)
    layer = RelativeAttention(width, heads, longest).double()
    torch.nn.init.normal_(layer.distances)
    return layer


def frames_at(count: int, width: int = 12, seed: int = 1) -> torch.Tensor:
    return torch.randn(2, count, width, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def test_untrained_it_is_attention_without_positions():
    layer = RelativeAttention(12, 3).double()
    assert not layer.distances.any()
    frames, times = frames_at(7), torch.arange(7.0).unsqueeze(0)
    query = layer.query(frames).view(2, 7, 3, 4).transpose(1, 2)
    key, value = (part.view(2, 7, 3, 4).transpose(1, 2) for part in layer.key_value(frames).chunk(2, -1))
    plain = layer.out(F.scaled_dot_product_attention(query, key, value).transpose(1, 2).flatten(2))
    torch.testing.assert_close(layer(frames, times), plain)
    order = torch.randperm(7)
    torch.testing.assert_close(layer(frames[:, order], times), plain[:, order])


def test_agrees_with_the_formula_written_out():
    layer, frames = trained(), frames_at(9)
    times = torch.tensor([[0.0, 1.0, 2.5, 3.0, 7.0, 7.25, 9.0, 20.0, 21.0]])
    known = torch.tensor([[True, False, True, True, False, True, True, False, True]]).expand(2, -1)
    query, (key, value) = layer.query(frames), layer.key_value(frames).chunk(2, -1)
    out = torch.zeros_like(frames)
    for window in range(2):
        for head in range(3):
            part = slice(4 * head, 4 * head + 4)
            scores = torch.full((9, 9), float("-inf"), dtype=torch.float64)
            for i in range(9):
                for j in range(9):
                    if known[window, j]:
                        apart = float(times[0, j] - times[0, i])
                        place = min(max(apart, -5.0), 5.0) + 5
                        below, share = int(place), place - int(place)
                        vector = (1 - share) * layer.distances[below]
                        vector = vector + share * layer.distances[min(below + 1, 10)]
                        scores[i, j] = query[window, i, part] @ (key[window, j, part] + vector) / 2
            out[window, :, part] = scores.softmax(-1) @ value[window, :, part]
    torch.testing.assert_close(layer(frames, times, known=known), layer.out(out))


def test_shifting_all_times_changes_nothing_and_order_in_time_counts():
    layer, frames, times = trained(), frames_at(8), torch.arange(8.0).unsqueeze(0)
    torch.testing.assert_close(layer(frames, times + 137.0), layer(frames, times))
    assert (layer(frames, times.flip(1)) - layer(frames, times)).abs().max() > 1e-2


def test_beyond_the_longest_distance_all_count_alike():
    layer, frames = trained(longest=3), frames_at(4)
    near = layer(frames, torch.tensor([[0.0, 3.0, 6.0, 9.0]]))
    torch.testing.assert_close(layer(frames, torch.tensor([[0.0, 40.0, 95.0, 400.0]])), near)
    assert (layer(frames, torch.tensor([[0.0, 2.0, 6.0, 9.0]])) - near).abs().max() > 1e-4


def test_gradients_are_those_of_finite_differences():
    layer, frames = trained(8, 2, 3), frames_at(5, 8).requires_grad_()
    times = torch.tensor([[0.0, 1.0, 2.5, 6.0, 8.0]])
    known = torch.tensor([[True, True, False, True, True]]).expand(2, -1)

    def out(values: torch.Tensor, table: torch.Tensor) -> torch.Tensor:
        return torch.func.functional_call(layer, {"distances": table}, (values, times), {"known": known})

    table = layer.distances.detach().clone().requires_grad_()
    assert torch.autograd.gradcheck(out, (frames, table))


@pytest.mark.parametrize("asks_memory", [False, True])
def test_unknown_memory_changes_nothing(asks_memory: bool):
    torch.manual_seed(0)
    layer = RelativeLayer(12, 3, asks_memory=asks_memory).double().eval()
    torch.nn.init.normal_(layer.attention.distances)
    frames, times = frames_at(6), torch.arange(6.0).unsqueeze(0)
    memory = frames_at(6, seed=2) if asks_memory else None
    known = torch.tensor([[True, True, False, False, True, False]]).expand(2, -1)
    first = layer(frames, times, memory, known)
    if memory is None:
        frames = torch.where(known.unsqueeze(-1), frames, frames + 1e3 * torch.randn_like(frames))
        torch.testing.assert_close(layer(frames, times, None, known)[known], first[known])
    else:
        memory = torch.where(known.unsqueeze(-1), memory, 1e3 * torch.randn_like(memory))
        torch.testing.assert_close(layer(frames, times, memory, known), first)


def test_a_memory_is_given_where_it_is_asked_alone():
    with pytest.raises(ValueError):
        RelativeLayer(12, 3)(frames_at(3).float(), torch.arange(3.0)[None], frames_at(3).float())
