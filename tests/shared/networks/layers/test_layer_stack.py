"""Activation checkpointing: the same results and gradients, and less kept for the backward pass."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from stages.shared.networks.layers.layer_stack import LayerStack, set_checkpointing
from stages.shared.networks.layers.sizes import DecoderSizes, EncoderSizes, SynthesiserSizes
from stages.shared.networks.pumps.cloud_decoder import CloudDecoder
from stages.shared.networks.pumps.frame_encoder import FrameEncoder
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser

FRAMES = 12


def encoder() -> tuple[nn.Module, Callable[[], Tensor]]:
    network = FrameEncoder(EncoderSizes(width=8, blocks=3, neighbours=4, heads=2))
    points, groups = torch.randn(6, 40, 3), torch.arange(40).expand(6, -1) % 5
    return network, lambda: network(points, groups)[0]


def decoder() -> tuple[nn.Module, Callable[[], Tensor]]:
    sizes = DecoderSizes(width=32, layers=4, heads=2, noise=4, point_width=8, point_hidden=8)
    network = CloudDecoder(16, sizes).eval()
    latents, centroids, noise = torch.randn(2, FRAMES, 16), torch.randn(2, FRAMES, 3), torch.randn(2, 10, 4)
    times, groups = torch.arange(FRAMES).unsqueeze(0), torch.arange(10).expand(2, -1) % 5
    return network, lambda: network(latents, centroids, times, groups, noise)


def synthesiser() -> tuple[nn.Module, Callable[[], Tensor]]:
    network = LatentSynthesiser(8, SynthesiserSizes(width=32, heads=2, key_layers=2, fill_layers=2, frame_layers=2))
    nn.init.normal_(network.out.weight)
    latents, centroids = torch.randn(2, FRAMES, 8), torch.randn(2, FRAMES, 3)
    known = (torch.arange(FRAMES) % 4 == 0).expand(2, -1)
    return network, lambda: network(latents, centroids, known, torch.arange(float(FRAMES)).unsqueeze(0))[0]


@pytest.mark.parametrize("build", [encoder, decoder, synthesiser])
def test_computing_again_gives_the_same_gradients_and_keeps_less(build):
    torch.manual_seed(0)
    network, result = build()
    found = []
    for again in (False, True):
        set_checkpointing(network, again)
        kept: dict[int, int] = {}

        def keep(value: Tensor, kept: dict[int, int] = kept) -> Tensor:
            kept[value.untyped_storage().data_ptr()] = value.untyped_storage().nbytes()
            return value

        network.zero_grad()
        with torch.autograd.graph.saved_tensors_hooks(keep, lambda value: value):
            made = result()
        held = sum(kept.values())
        made.square().sum().backward()
        found.append((made.detach(), [each.grad for each in network.parameters()], held))
    (plain, gradients, bytes_plain), (again, gradients_again, bytes_again) = found
    torch.testing.assert_close(plain, again)
    torch.testing.assert_close(gradients, gradients_again)
    assert bytes_again < 0.7 * bytes_plain


def test_every_loop_over_time_layers_can_be_computed_again():
    stacks = [module for build in (decoder, synthesiser) for module in build()[0].modules()]
    assert sum(isinstance(module, LayerStack) for module in stacks) == 4
