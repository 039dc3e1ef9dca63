"""Attention over time: rotary positions are true rotations, masks leak nothing."""

import torch

from stages.networks.attention import TimeAttention, TimeLayer, rotary_angles, rotate, sinusoids


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
