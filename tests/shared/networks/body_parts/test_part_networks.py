"""The four networks: sizes beside the paper's, shapes, draws, the Gaussian divergence, batch independence."""

from __future__ import annotations

import pytest
import torch

from stages.shared.humanoid.body_parts import body_part
from stages.shared.humanoid.decompositions import DECOMPOSITIONS
from stages.shared.networks.body_parts.mlp_layers import cosine_transform, factors
from stages.shared.networks.body_parts.part_networks import NETWORKS, PartNetwork, gaussian_divergence
from tests.shared.humanoid.test_body_parts import CMU_GROUPS, CMU_PARENTS

PAPER = {1: 184_221, 2: 146_423, 3: 145_304, 5: 171_968}


def _network(kind: str, joints: int = 5, frames: int = 20, latent: int = 20) -> PartNetwork:
    torch.manual_seed(1)
    return NETWORKS[kind](joints, frames, latent, 2, 120.0)


def _windows(count: int = 3, joints: int = 5, frames: int = 20) -> torch.Tensor:
    return torch.randn(count, frames, joints, 6, generator=torch.Generator().manual_seed(4))


@pytest.mark.parametrize("kind", NETWORKS)
@pytest.mark.parametrize("parts", DECOMPOSITIONS)
def test_sizes_are_within_nine_percent_of_the_paper_s(kind: str, parts: int):
    """On CMU's 31 joints, 61 frames, a latent of 100. The paper states one mean over the kinds of networks."""
    count = 0
    for name in DECOMPOSITIONS[parts]:
        joints = len(body_part(name, CMU_PARENTS, CMU_GROUPS).joints)
        network = NETWORKS[kind](joints, 61, 100 // parts, 3, 120.0)
        count += sum(value.numel() for value in network.parameters())
    assert abs(count / PAPER[parts] - 1) < 0.09, count


@pytest.mark.parametrize("kind", NETWORKS)
def test_a_window_becomes_a_latent_and_a_window_again(kind: str):
    network = _network(kind)
    latent, divergence = network.encode(_windows())
    assert latent.shape == (3, network.width) and network.width <= 20 and divergence.shape == (3,)
    assert network.decode(latent).shape == (3, 20, 5, 6)


@pytest.mark.parametrize("kind", NETWORKS)
def test_windows_do_not_depend_on_each_other(kind: str):
    network, windows = _network(kind), _windows()
    whole = network.decode(network.encode(windows)[0])
    alone = network.decode(network.encode(windows[1:2])[0])
    torch.testing.assert_close(whole[1:2], alone, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("kind", NETWORKS)
def test_every_parameter_has_a_slope(kind: str):
    network = _network(kind)
    latent, divergence = network.encode(_windows(), torch.Generator().manual_seed(0), sampled=True)
    (network.decode(latent).square().mean() + divergence.mean()).backward()
    assert all(value.grad is not None and value.grad.abs().sum() > 0 for value in network.parameters())


@pytest.mark.parametrize(("kind", "draws"), [("ae", False), ("pae", False), ("vae", True), ("svae", True)])
def test_only_the_variational_networks_draw(kind: str, draws: bool):
    network, windows = _network(kind), _windows()
    made = [network.encode(windows, torch.Generator().manual_seed(seed), sampled=True)[0] for seed in (1, 1, 2)]
    assert torch.equal(made[0], made[1])
    assert torch.equal(made[0], made[2]) is not draws
    assert (network.encode(windows)[1] > 0).all().item() is draws


def test_hyperspherical_latents_lie_on_spheres():
    latent, _ = _network("svae").encode(_windows(), torch.Generator().manual_seed(1), sampled=True)
    torch.testing.assert_close(latent.unflatten(1, (-1, 3)).norm(dim=-1), torch.ones(3, 6))


def test_the_gaussian_divergence_agrees_with_torch_s():
    generator = torch.Generator().manual_seed(2)
    mean, log_variance = torch.randn(4, 7, generator=generator), torch.randn(4, 7, generator=generator)
    made = torch.distributions.Normal(mean, (log_variance / 2).exp())
    wanted = torch.distributions.kl_divergence(made, torch.distributions.Normal(0.0, 1.0)).sum(-1)
    torch.testing.assert_close(gaussian_divergence(mean, log_variance), wanted)


def test_the_cosine_transform_keeps_lengths_and_finds_a_cosine():
    matrix = cosine_transform(12).double()
    torch.testing.assert_close(matrix @ matrix.T, torch.eye(12).double(), atol=1e-6, rtol=0)
    signal = torch.cos((torch.arange(12) + 0.5) * torch.pi / 12 * 3).double()
    found = matrix @ signal
    assert int(found.abs().argmax()) == 3 and float(found.abs().sum() - found[3]) < 1e-5


@pytest.mark.parametrize(
    ("width", "wanted"), [(100, (10, 10)), (50, (10, 5)), (33, (11, 3)), (20, (5, 4)), (7, (7, 1))]
)
def test_factors(width: int, wanted: tuple[int, int]):
    assert factors(width) == wanted
