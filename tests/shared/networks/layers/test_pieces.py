"""Work in pieces is the same work: results, gradients of parts and of parameters, whatever the precision."""

import pytest
import torch
from torch import nn
from torch.nn import functional as F

from stages.shared.networks.layers import pieces
from stages.shared.networks.layers.attention import ExactNorm
from stages.shared.networks.layers.pieces import in_pieces
from stages.shared.networks.layers.sizes import DecoderSizes, EncoderSizes
from stages.shared.networks.pumps.cloud_decoder import CloudDecoder
from stages.shared.networks.pumps.frame_encoder import FrameEncoder


def test_results_and_gradients_are_those_of_the_whole():
    torch.manual_seed(0)
    layer, scale = nn.Linear(4, 3).double(), torch.randn(3, dtype=torch.double, requires_grad=True)
    rows = torch.randn(7, 4, dtype=torch.double, requires_grad=True)
    fixed = torch.arange(7)

    def run(rows: torch.Tensor, fixed: torch.Tensor) -> torch.Tensor:
        return layer(rows).tanh() * scale * fixed.unsqueeze(1)

    learnt = [*layer.parameters(), scale]
    whole, cut = run(rows, fixed), in_pieces(run, 3, [rows, fixed], learnt)
    torch.testing.assert_close(cut, whole)
    expected, found = (torch.autograd.grad(each.square().sum(), [rows, *learnt]) for each in (whole, cut))
    torch.testing.assert_close(found, expected)
    assert torch.autograd.gradcheck(lambda rows, *_: in_pieces(run, 2, [rows, fixed], learnt), (rows, *learnt))


def test_what_is_frozen_gets_no_gradient_and_what_was_forgotten_is_noticed():
    layer, rows = nn.Linear(2, 2), torch.randn(5, 2)
    layer.bias.requires_grad_(False)
    in_pieces(layer, 2, [rows], list(layer.parameters())).sum().backward()
    assert layer.weight.grad is not None and layer.bias.grad is None
    with pytest.raises(RuntimeError):  # a view made again is not what `run` reads
        in_pieces(layer, 2, [rows], [layer.weight[:]]).sum().backward()


def test_casts_of_weights_do_not_leak_between_passes():
    """The same layer within and outside of pieces, in one autocast region, still learns from both."""
    layer, rows = nn.Linear(8, 8), torch.randn(6, 8)
    expected = torch.autograd.grad(2 * layer(rows).sum(), layer.weight)[0]
    with torch.autocast("cpu", torch.bfloat16):
        total = in_pieces(layer, 2, [rows], list(layer.parameters())).float().sum() + layer(rows).float().sum()
        total.backward()
    assert layer.weight.grad is not None
    torch.testing.assert_close(layer.weight.grad, expected, atol=0.1, rtol=0.02)


@pytest.mark.parametrize("head", ["mlp", "skinning"])
def test_the_autoencoder_does_not_depend_on_the_size_of_the_pieces(monkeypatch, head):
    torch.manual_seed(1)
    encoder = FrameEncoder(EncoderSizes(width=8, blocks=3, neighbours=4, heads=2))
    sizes = DecoderSizes(width=16, layers=1, heads=2, noise=6, head=head, codes=8, point_width=12, point_hidden=8)
    decoder = CloudDecoder(64, sizes).eval()
    points, groups, noise = torch.randn(2, 5, 40, 3), torch.randint(0, 5, (2, 40)), torch.randn(2, 40, 6)
    named = [*encoder.named_parameters(), *decoder.named_parameters()]
    parameters = [value for name, value in named if not name.endswith("score.bias")]  # which learns nothing
    found = []
    for values in (2**40, 1):
        monkeypatch.setattr(pieces, "_CPU_VALUES", values)
        latents, centroids = encoder(points.flatten(0, 1), groups.repeat_interleave(5, 0))
        latents, centroids = latents.unflatten(0, (2, 5)), centroids.unflatten(0, (2, 5))
        made = decoder(latents, centroids, torch.arange(5.0).unsqueeze(0), groups, noise)
        found.append([made.detach(), *torch.autograd.grad(made.square().mean(), parameters)])
    torch.testing.assert_close(found[1], found[0], atol=1e-5, rtol=1e-3)


def test_gradients_of_a_norm_survive_bfloat16():
    """Summed over many rows in bfloat16, they would stop growing after a few hundred rows."""
    norm, linear = ExactNorm(16), nn.Linear(16, 16)
    rows = torch.randn(20000, 16) + 1
    found = []
    for enabled in (False, True):
        with torch.autocast("cpu", torch.bfloat16, enabled=enabled):
            made = F.gelu(linear(norm(linear(rows))))
        found.append(torch.autograd.grad(made.float().sum(), [norm.weight, norm.bias]))
    for exact, mixed in zip(*found, strict=True):
        assert (mixed - exact).norm() < 0.02 * exact.norm()


def test_a_norm_without_gradients_gives_the_same_rounded_numbers():
    norm, rows = ExactNorm(16), (3 * torch.randn(50, 16) + 1).bfloat16()
    nn.init.normal_(norm.weight)
    with torch.no_grad():
        found = norm(rows)
    torch.testing.assert_close(found, norm(rows).to(found.dtype), atol=0, rtol=2**-8)
