"""Gradients of every network part by finite differences, in double precision at tiny sizes."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn
from torch.autograd import gradcheck

from stages.shared.networks.layers.attention import TimeAttention, TimeLayer
from stages.shared.networks.layers.sizes import DecoderSizes, EncoderSizes, SynthesiserSizes
from stages.shared.networks.pumps.cloud_decoder import CloudDecoder, PointHead, SkinningHead
from stages.shared.networks.pumps.frame_encoder import FrameEncoder, within_group
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser
from stages.shared.pointcloud.assignment import chamfer_squared, paired_difference

DECODER = DecoderSizes(width=4, layers=1, heads=1, noise=3, codes=2, point_width=4, point_hidden=3)
GROUPS = torch.tensor([[0, 3, 3]])
TIMES = torch.tensor([[0.0, 1.25, 4.0]])
KNOWN = torch.tensor([[True, False, True]])


def values(*shape: int) -> Tensor:
    return torch.randn(*shape, dtype=torch.double, generator=torch.Generator().manual_seed(sum(shape)))


def attention(kind: type[nn.Module], **more: bool) -> tuple[nn.Module, Callable[..., Tensor], list[Tensor]]:
    layer = kind(4, 2, **more)
    asked = {"known": KNOWN} if not more else {"memory": values(1, 3, 4), "memory_times": TIMES, "known": KNOWN}
    return layer, lambda frames: layer(frames, TIMES, **asked), [values(1, 3, 4)]


def head(kind: type[nn.Module]) -> tuple[nn.Module, Callable[..., Tensor], list[Tensor]]:
    layer = kind(DECODER)
    return layer, lambda frames, noise: layer(frames, GROUPS, noise), [values(1, 2, 4), values(1, 3, 3)]


def decoder() -> tuple[nn.Module, Callable[..., Tensor], list[Tensor]]:
    network = CloudDecoder(4, DECODER).eval()
    return (
        network,
        lambda latents, centroids, noise: network(latents, centroids, TIMES, GROUPS, noise),
        [values(1, 3, 4), values(1, 3, 3), values(1, 3, 3)],
    )


def encoder() -> tuple[nn.Module, Callable[..., Tensor], list[Tensor]]:
    network = FrameEncoder(EncoderSizes(width=2, blocks=2, neighbours=3, heads=1))
    return network, lambda points: torch.cat(network(points, torch.tensor([[0, 0, 1, 1, 1]])), -1), [values(1, 5, 3)]


def synthesiser() -> tuple[nn.Module, Callable[..., Tensor], list[Tensor]]:
    sizes = SynthesiserSizes(width=4, heads=1, key_layers=1, fill_layers=1, frame_layers=1)
    network = LatentSynthesiser(3, sizes)
    nn.init.normal_(network.out.weight)
    return (
        network,
        lambda latents, centroids: torch.cat(network(latents, centroids, KNOWN, TIMES), -1),
        [values(1, 3, 3), values(1, 3, 3) + 1],
    )


PARTS = {
    "attention": lambda: attention(TimeAttention),
    "layer": lambda: attention(TimeLayer),
    "layer with a memory": lambda: attention(TimeLayer, asks_memory=True),
    "point-wise MLP": lambda: head(PointHead),
    "skinning": lambda: head(SkinningHead),
    "decoder": decoder,
    "encoder": encoder,
    "synthesiser": synthesiser,
}


@pytest.mark.parametrize("part", PARTS)
def test_a_networks_gradients(part):
    torch.manual_seed(0)
    network, run, given = PARTS[part]()
    network.double()
    given = [each.requires_grad_() for each in given]
    assert gradcheck(lambda *all_: run(*all_[: len(given)]), (*given, *network.parameters()), fast_mode=True)
    assert gradcheck(run, tuple(given))


def test_gradients_of_losses_and_of_places_within_groups():
    one, two = values(1, 2, 3, 3).requires_grad_(), (values(1, 2, 3, 3) * 0.7 + 0.1).requires_grad_()
    assert gradcheck(lambda a, b: paired_difference(a, b, GROUPS), (one, two))
    assert gradcheck(lambda a, b: chamfer_squared(a, b, GROUPS), (one, two))
    one_hot = torch.eye(5, dtype=torch.double)[GROUPS]
    assert gradcheck(lambda places: within_group(places, one_hot), (values(1, 3, 3).requires_grad_(),))


def test_no_gradient_reaches_what_is_unknown():
    torch.manual_seed(0)
    layer = TimeLayer(4, 2, asks_memory=True)
    memory = values(1, 3, 4).float().requires_grad_()
    layer(values(1, 3, 4).float(), TIMES, memory, TIMES, KNOWN).square().sum().backward()
    assert memory.grad is not None
    assert (memory.grad[~KNOWN] == 0).all() and (memory.grad[KNOWN] != 0).any(-1).all()
