"""Deepened networks start from weights of fewer layers and at first have the same output."""

from __future__ import annotations

import torch

from stages.shared.networks.layers.sizes import SynthesiserSizes
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser
from stages.shared.training.unfinished import set_weights


def _synthesiser(frame_layers: int) -> LatentSynthesiser:
    torch.manual_seed(frame_layers)
    sizes = SynthesiserSizes(width=16, heads=2, key_layers=1, fill_layers=1, frame_layers=frame_layers)
    network = LatentSynthesiser(8, sizes)
    torch.nn.init.normal_(network.out.weight, std=0.1)
    return network


def _filled(network: LatentSynthesiser) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    latents, centroids = (torch.randn(2, 6, width, generator=generator) for width in (8, 3))
    known = torch.tensor([[True, False, False, True, False, True], [False, True, False, False, False, False]])
    return network(latents, centroids, known, torch.arange(6.0).unsqueeze(0))[0]


def test_added_layers_change_nothing_at_first_and_learn(tmp_path):
    small, grown = _synthesiser(1), _synthesiser(3)
    weights = {name: value.numpy() for name, value in small.state_dict().items()}
    fresh = set_weights(grown, weights, source=tmp_path)
    assert {name.split(".")[1] for name in fresh} == {"1", "2"}
    torch.testing.assert_close(_filled(grown), _filled(small), atol=0, rtol=0)
    _filled(grown).square().sum().backward()
    for layer in list(grown.frame_layers)[1:]:
        assert float(layer.feed[-1].weight.grad.abs().sum()) > 0
        assert float(layer.attention.out.weight.grad.abs().sum()) > 0


def test_layers_that_were_trained_stay_as_they_were(tmp_path):
    trained, other = _synthesiser(2), _synthesiser(2)
    torch.nn.init.normal_(other.out.weight, std=0.3)
    assert (
        set_weights(other, {name: value.numpy() for name, value in trained.state_dict().items()}, source=tmp_path)
        == []
    )
    torch.testing.assert_close(_filled(other), _filled(trained), atol=0, rtol=0)
