"""What tells points apart: noise, the cells of a grid, or draws from the frame's own Gaussian (PUMPS Table 2)."""

import pytest
import torch
from pydantic import ValidationError
from torch.distributions import Normal, kl_divergence

from stages.shared.networks.layers.sizes import DecoderSizes
from stages.shared.networks.pumps.cloud_decoder import CloudDecoder, VariationalHead, grid_cells

SMALL = {"width": 16, "layers": 1, "heads": 2, "noise": 6, "codes": 8, "point_width": 12, "point_hidden": 8}


def decoder(**choice: str) -> CloudDecoder:
    torch.manual_seed(0)
    return CloudDecoder(10, DecoderSizes(**{**SMALL, **choice})).eval()


def made(network: CloudDecoder, noise: torch.Tensor, groups: torch.Tensor) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    latents, centroids = torch.randn(2, 7, 10, generator=generator), torch.randn(2, 7, 3, generator=generator)
    return network(latents, centroids, torch.arange(7.0).unsqueeze(0), groups, noise)


@pytest.mark.parametrize("points", [1, 9, 48, 256])
def test_the_grid_is_the_same_for_every_cloud_and_fills_a_square(points: int):
    network = decoder(identities="grid")
    first, second = network.draw_noise(2, points), network.draw_noise(2, points, torch.Generator().manual_seed(5))
    assert torch.equal(first, second) and first.shape == (2, points, 2)
    assert len(first[0].unique(dim=0)) == points
    if points == 256:
        assert len(first[0, :, 0].unique()) == 16
        torch.testing.assert_close(first[0].std(0, unbiased=False), torch.ones(2))
        assert float(first[0].mean(0).abs().max()) < 1e-5


def test_any_run_of_the_grids_cells_covers_the_square():
    run = grid_cells(256)[100:150]
    quarters = (run > 0).long() @ torch.tensor([1, 2])
    assert int(torch.bincount(quarters, minlength=4).min()) >= 5


@pytest.mark.parametrize("choice", [{"identities": "grid"}, {"identities": "grid", "head": "skinning"}])
def test_points_with_a_cell_of_their_own_are_placed_apart(choice):
    network = decoder(**choice)
    groups = torch.zeros(2, 9, dtype=torch.long)
    points = made(network, network.draw_noise(2, 9), groups)
    assert float(torch.pdist(points[0, 0].detach()).min()) > 1e-4


def test_a_vaes_points_are_told_apart_by_their_draws_alone():
    network = decoder(identities="vae")
    groups = torch.zeros(2, 9, dtype=torch.long)
    noise = network.draw_noise(2, 9, torch.Generator().manual_seed(2))
    noise[:, 3] = noise[:, 4]
    points = made(network, noise, groups)
    torch.testing.assert_close(points[:, :, 3], points[:, :, 4])
    assert float((points[:, :, 0] - points[:, :, 1]).abs().max()) > 1e-4


def test_a_vaes_points_are_independent():
    network = decoder(identities="vae")
    groups = torch.randint(0, 5, (2, 9), generator=torch.Generator().manual_seed(3))
    noise = network.draw_noise(2, 9, torch.Generator().manual_seed(2))
    order = torch.tensor([8, 0, 3])
    part = made(network, noise[:, order], groups[:, order])
    torch.testing.assert_close(part, made(network, noise, groups)[:, :, order], atol=1e-5, rtol=1e-4)


def test_the_divergence_is_that_of_the_points_gaussians_from_the_standard_one():
    network = decoder(identities="vae")
    assert isinstance(network.head, VariationalHead)
    frames, groups = torch.randn(1, 3, 16), torch.tensor([[0, 4, 2]])
    found = network.divergence(frames, groups)
    by_group = network.head.posterior(frames).view(1, 3, 5, 12)
    for point, group in enumerate([0, 4, 2]):
        mean, log_variance = by_group[:, :, group].chunk(2, dim=-1)
        expected = kl_divergence(Normal(mean, (0.5 * log_variance).exp()), Normal(0.0, 1.0)).sum(-1)
        torch.testing.assert_close(found[:, :, point], expected, atol=1e-5, rtol=1e-4)
    torch.nn.init.zeros_(network.head.posterior.weight)
    torch.nn.init.zeros_(network.head.posterior.bias)
    assert float(network.divergence(frames, groups).abs().max()) == 0


def test_other_identities_have_no_divergence():
    assert float(decoder().divergence(torch.randn(1, 3, 16), torch.tensor([[0, 4]])).abs().max()) == 0


@pytest.mark.parametrize(
    "wrong",
    [{"identities": "cube"}, {"head": "convolution"}, {"positions": "none"}, {"dropout_kind": "row"},
     {"identities": "vae", "head": "skinning"}],
)  # fmt: skip
def test_what_is_not_there_is_refused(wrong):
    with pytest.raises(ValidationError):
        DecoderSizes(**wrong)
