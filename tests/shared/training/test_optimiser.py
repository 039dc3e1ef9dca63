"""Muon for the matrices of layers, AdamW for the rest: against a plain reference, and what is kept of them."""

import pytest
import torch
from torch import nn

from stages.shared.networks.layers.sizes import SynthesiserSizes
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser
from stages.shared.training.config import TrainingConfig
from stages.shared.training.optimiser import Optimiser, inner_matrices


class TwoParts(nn.Module):
    """One matrix inside a list of layers, one outside of it."""

    def __init__(self):
        super().__init__()
        self.layers = nn.ModuleList([nn.Linear(12, 6)])
        self.out = nn.Linear(6, 3)


def config(tmp_path, **changes) -> TrainingConfig:
    settings = {"optimiser": "muon", "learning_rate": 0.02, "weight_decay": 0.0}
    return TrainingConfig(output=tmp_path / "out", **{**settings, **changes})


def descend(networks: nn.Module, optimiser: Optimiser, steps: int, seed: int = 0) -> None:
    generator = torch.Generator().manual_seed(seed)
    for _ in range(steps):
        for value in networks.parameters():
            value.grad = torch.randn(value.shape, generator=generator)
        optimiser.step(0.02)


def test_muon_updates_only_matrices_of_repeated_layers():
    sizes = SynthesiserSizes(width=12, heads=2, key_layers=1, fill_layers=1, frame_layers=1)
    network = LatentSynthesiser(8, sizes)
    inner = inner_matrices(network)
    assert all("layers." in name and network.get_parameter(name).ndim == 2 for name in inner)
    left = {name for name, value in network.named_parameters() if value.ndim == 2} - set(inner)
    assert left == {"embed_key.weight", "embed_missing.weight", "out.weight"}


def test_muon_makes_all_singular_values_of_a_step_equal(tmp_path):
    """The first step goes along U V^T of the gradient's decomposition, as long as AdamW's step would be."""
    networks = TwoParts()
    optimiser = Optimiser(networks, config(tmp_path))
    before = networks.layers[0].weight.detach().clone()
    gradient = torch.randn(6, 12, generator=torch.Generator().manual_seed(1))
    for value in networks.parameters():
        value.grad = torch.zeros_like(value)
    networks.layers[0].weight.grad = gradient.clone()
    optimiser.step(0.02)
    step = (before - networks.layers[0].weight).detach()
    u, _, vt = torch.linalg.svd(gradient, full_matrices=False)
    exact = u @ vt * (0.02 * 0.2 * 12**0.5)
    # Five Newton-Schulz turns bring the singular values to between 0.7 and 1.2 of one another.
    assert torch.nn.functional.cosine_similarity(step.flatten(), exact.flatten(), dim=0) > 0.97
    found = torch.linalg.svdvals(step) / (0.02 * 0.2 * 12**0.5)
    assert found.min() > 0.6 and found.max() < 1.3
    assert float(torch.linalg.svdvals(gradient).max() / torch.linalg.svdvals(gradient).min()) > 3


def test_adamw_is_torchs_own(tmp_path):
    ours, theirs = TwoParts(), TwoParts()
    theirs.load_state_dict(ours.state_dict())
    descend(ours, Optimiser(ours, config(tmp_path, optimiser="adamw", weight_decay=0.1)), 3)
    reference = torch.optim.AdamW(theirs.parameters(), lr=0.02, betas=(0.9, 0.98), weight_decay=0.1)
    generator = torch.Generator().manual_seed(0)
    for _ in range(3):
        for value in theirs.parameters():
            value.grad = torch.randn(value.shape, generator=generator)
        reference.step()
    for one, other in zip(ours.parameters(), theirs.parameters(), strict=True):
        torch.testing.assert_close(one, other)


@pytest.mark.parametrize("kind", ["adamw", "muon"])
def test_moments_are_restored(tmp_path, kind):
    whole, parted = TwoParts(), TwoParts()
    parted.load_state_dict(whole.state_dict())
    settings = config(tmp_path, optimiser=kind)
    first = Optimiser(whole, settings)
    descend(whole, first, 2)
    before = Optimiser(parted, settings)
    descend(parted, before, 2)
    kept = {name: value.numpy().copy() for name, value in before.moments().items()}
    again = Optimiser(parted, settings)
    again.set_moments(kept)
    descend(whole, first, 2, seed=1)
    descend(parted, again, 2, seed=1)
    assert all(torch.equal(one, other) for one, other in zip(whole.parameters(), parted.parameters(), strict=True))


def test_moments_of_another_optimiser_are_left_alone(tmp_path):
    networks = TwoParts()
    adamw = Optimiser(networks, config(tmp_path, optimiser="adamw"))
    descend(networks, adamw, 2)
    muon = Optimiser(networks, config(tmp_path))
    muon.set_moments({name: value.numpy() for name, value in adamw.moments().items()})
    assert {name for name in muon.moments() if "layers" in name and "weight" in name} == set()
    descend(networks, muon, 1)
    assert "momentum_buffer/layers.0.weight" in muon.moments()
