"""The synthesiser: reads keys alone, gives keys back, starts as the plain interpolation."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.shared.networks.layers.sizes import SynthesiserSizes
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser, interpolate_known, neighbouring_keys

KNOWN = torch.tensor([[True, False, False, True, False, True], [False, True, False, False, False, False]])


@pytest.fixture
def synthesiser() -> LatentSynthesiser:
    torch.manual_seed(0)
    network = LatentSynthesiser(8, SynthesiserSizes(width=16, heads=2, key_layers=1, fill_layers=1, frame_layers=1))
    torch.nn.init.normal_(network.out.weight, std=0.1)
    return network.eval()


def inputs() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    return (
        torch.randn(2, 6, 8, generator=generator),
        torch.randn(2, 6, 3, generator=generator),
        torch.arange(6.0).unsqueeze(0),
    )


def test_neighbouring_keys():
    first, last = neighbouring_keys(KNOWN)
    assert first.tolist() == [[0, 0, 0, 3, 3, 5], [1, 1, 1, 1, 1, 1]]
    assert last.tolist() == [[0, 3, 3, 3, 5, 5], [1, 1, 1, 1, 1, 1]]


def test_interpolation_of_known_frames_in_real_time():
    values = torch.tensor([[[0.0], [9.0], [9.0], [6.0], [9.0], [8.0]]])
    times = torch.tensor([[0.0, 1.0, 1.5, 3.0, 3.5, 4.0]])
    assert interpolate_known(values, KNOWN[:1], times).flatten().tolist() == [0, 2, 3, 6, 7, 8]


def test_before_training_it_is_the_plain_interpolation():
    network = LatentSynthesiser(
        8, SynthesiserSizes(width=16, heads=2, key_layers=1, fill_layers=1, frame_layers=1)
    ).eval()
    latents, centroids, times = inputs()
    filled, placed = network(latents, centroids, KNOWN, times)
    torch.testing.assert_close(filled, interpolate_known(latents, KNOWN, times))
    torch.testing.assert_close(placed, interpolate_known(centroids, KNOWN, times))


def test_what_is_missing_is_never_read_and_keys_come_back(synthesiser):
    latents, centroids, times = inputs()
    filled, placed = synthesiser(latents, centroids, KNOWN, times)
    junk = ~KNOWN.unsqueeze(-1)
    for value in (1e6, float("nan")):
        again = synthesiser(latents.masked_fill(junk, value), centroids.masked_fill(junk, value), KNOWN, times)
        torch.testing.assert_close(again[0], filled, atol=0, rtol=0)
        torch.testing.assert_close(again[1], placed, atol=0, rtol=0)
    assert (filled[KNOWN] == latents[KNOWN]).all()
    assert (placed[KNOWN] == centroids[KNOWN]).all()


def test_keys_reach_every_missing_frame(synthesiser):
    latents, centroids, times = inputs()
    latents.requires_grad_()
    filled, _ = synthesiser(latents, centroids, KNOWN, times)
    base = interpolate_known(latents, KNOWN, times)
    (filled - base)[0, 1].square().sum().backward()
    reached = latents.grad[0].abs().sum(-1) > 0
    assert reached.tolist() == KNOWN[0].tolist()


def test_moving_the_world_moves_the_centroids_alone(synthesiser):
    latents, centroids, times = inputs()
    filled, placed = synthesiser(latents, centroids, KNOWN, times)
    moved = synthesiser(latents, centroids + 4.0, KNOWN, times + 100.0)
    torch.testing.assert_close(moved[0], filled, atol=1e-3, rtol=1e-3)
    torch.testing.assert_close(moved[1], placed + 4.0, atol=1e-3, rtol=1e-3)


def test_padding_changes_nothing(synthesiser):
    latents, centroids, times = inputs()
    valid = torch.ones(2, 6, dtype=torch.bool)
    short = synthesiser(latents[:1, :4], centroids[:1, :4], KNOWN[:1, :4], times[:, :4])
    valid[:, 4:] = False
    known = KNOWN & valid
    padded = synthesiser(latents[:1], centroids[:1], known[:1], times, valid[:1])
    torch.testing.assert_close(padded[0][:, :4], short[0], atol=1e-5, rtol=1e-5)


def test_the_base_given_is_what_the_residual_is_added_to():
    network = LatentSynthesiser(
        8, SynthesiserSizes(width=16, heads=2, key_layers=1, fill_layers=1, frame_layers=1)
    ).eval()
    latents, centroids, times = inputs()
    base = torch.randn(2, 6, 8), torch.randn(2, 6, 3)
    filled, placed = network(latents, centroids, KNOWN, times, base=base)
    assert (filled[~KNOWN] == base[0][~KNOWN]).all()
    assert (placed[~KNOWN] == base[1][~KNOWN]).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 4), st.integers(2, 12), st.integers(0, 1000))
def test_computing_only_the_frames_that_are_read_changes_nothing(batch, frames, seed):
    """Values and gradients, for any known frames, from one to all of them."""
    torch.manual_seed(seed)
    network = LatentSynthesiser(4, SynthesiserSizes(width=8, heads=2, key_layers=2, fill_layers=2, frame_layers=1))
    known = torch.rand(batch, frames) < torch.rand(())
    known[torch.arange(batch), torch.randint(frames, (batch,))] = True
    times = torch.arange(float(frames)).expand(batch, -1)
    keys = torch.randn(batch, frames, 7, requires_grad=True)
    missing = torch.randn(batch, frames, 15, requires_grad=True)
    wanted = [keys, missing, *network.key_layers.parameters(), *network.fill_layers.parameters()]
    found = []
    for alone in (False, True):
        made = network._filled(keys, missing, known, times, alone=alone)
        gradients = torch.autograd.grad(made.square().sum(), wanted, allow_unused=True, materialize_grads=True)
        found.append([made, *gradients])
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-4)
