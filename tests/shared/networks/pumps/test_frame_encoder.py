"""What the frame encoder must not depend on: order, batch mates, place in the world."""

import pytest
import torch
from torch import nn
from torch.nn import functional as F

from stages.shared.networks.layers.sizes import EncoderSizes
from stages.shared.networks.pumps.frame_encoder import FrameEncoder, NeighbourAttention, within_group

SIZES = EncoderSizes(width=8, blocks=3, neighbours=4, heads=2)


@pytest.fixture(scope="module")
def encoder() -> FrameEncoder:
    torch.manual_seed(0)
    return FrameEncoder(SIZES).eval()


def cloud(points: int = 40, count: int = 3) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(points)
    return torch.randn(count, points, 3, generator=generator) * 0.4, torch.randint(
        0, 5, (count, points), generator=generator
    )


def test_order_of_points_means_nothing(encoder):
    points, groups = cloud()
    order = torch.randperm(40, generator=torch.Generator().manual_seed(9))
    torch.testing.assert_close(
        encoder(points[:, order], groups[:, order])[0], encoder(points, groups)[0], atol=1e-4, rtol=1e-4
    )


def test_a_frame_is_encoded_alone(encoder):
    points, groups = cloud()
    together = encoder(points, groups)
    for index in range(3):
        alone = encoder(points[index : index + 1], groups[index : index + 1])
        torch.testing.assert_close(alone[0][0], together[0][index], atol=1e-5, rtol=1e-5)


def test_moving_the_cloud_moves_the_centroid_alone(encoder):
    points, groups = cloud()
    shift = torch.tensor([3.0, -1.0, 8.0])
    latents, centroids = encoder(points, groups)
    moved, moved_centroids = encoder(points + shift, groups)
    torch.testing.assert_close(moved, latents, atol=1e-3, rtol=1e-3)
    torch.testing.assert_close(moved_centroids, centroids + shift)


@pytest.mark.parametrize("points", [1, 7, 63, 200])
def test_any_number_of_points(encoder, points):
    latents, _ = encoder(*cloud(points))
    assert latents.shape == (3, 64)
    torch.testing.assert_close(latents.mean(-1), torch.zeros(3), atol=1e-5, rtol=0)
    torch.testing.assert_close(latents.var(-1, unbiased=False), torch.ones(3), atol=1e-2, rtol=0)


def test_a_group_without_points_is_no_trouble(encoder):
    points, _ = cloud()
    assert torch.isfinite(encoder(points, torch.full((3, 40), 2))[0]).all()


def test_neighbour_attention_agrees_with_the_sum_written_out():
    torch.manual_seed(1)
    layer = NeighbourAttention(8, 2)
    features, places = torch.randn(1, 6, 8), torch.randn(1, 6, 3)
    neighbours = torch.stack([torch.randperm(6)[:3] for _ in range(6)]).unsqueeze(0)
    query, key, value = layer.query_key_value(layer.norm(features))[0].chunk(3, -1)
    by_score, by_value = layer.place.weight.chunk(2)
    for point in range(6):
        near = neighbours[0, point]
        apart = places[0, point] - places[0, near]
        scores = layer.score(F.gelu(query[point] - key[near] + apart @ by_score.T)).softmax(0)
        values = (value[near] + apart @ by_value.T).view(3, 2, 4)
        expected = features[0, point] + layer.out((values * scores.unsqueeze(-1)).sum(0).flatten())
        torch.testing.assert_close(layer(features, places, neighbours)[0, point], expected, atol=1e-5, rtol=1e-4)


def test_a_constant_in_all_scores_changes_nothing_and_learns_nothing():
    layer = NeighbourAttention(8, 2)
    inputs = torch.randn(2, 6, 8), torch.randn(2, 6, 3), torch.arange(6).expand(2, 6, 6)
    made = layer(*inputs)
    nn.init.normal_(layer.score.bias)
    assert torch.equal(layer(*inputs), made)
    made.square().sum().backward()
    without = {name for name, each in layer.named_parameters() if each.grad is None}
    assert without == {"score.bias"} and len(layer.used_parameters()) == len(list(layer.parameters())) - 1


def test_more_than_one_neighbour_matters(encoder):
    points, groups = cloud()
    one = FrameEncoder(SIZES.model_copy(update={"neighbours": 1})).eval()
    one.load_state_dict(encoder.state_dict())
    assert (one(points, groups)[0] - encoder(points, groups)[0]).abs().max() > 1e-2


def test_positions_within_a_group_have_unit_spread():
    points, groups = cloud(200, 1)
    spread = within_group(points, F.one_hot(groups, 5).float())
    for group in range(5):
        inside = spread[0, groups[0] == group]
        torch.testing.assert_close(inside.mean(0), torch.zeros(3), atol=1e-4, rtol=0)
        assert abs(inside.square().sum(-1).mean() - 1) < 1e-2


def test_gradients_agree_with_finite_differences():
    torch.manual_seed(2)
    layer = NeighbourAttention(4, 2).double()
    neighbours = torch.tensor([[[0, 1], [1, 2], [2, 0]]])
    inputs = (
        torch.randn(1, 3, 4, dtype=torch.double, requires_grad=True),
        torch.randn(1, 3, 3, dtype=torch.double, requires_grad=True),
    )
    assert torch.autograd.gradcheck(lambda features, places: layer(features, places, neighbours), inputs)


def test_neighbours_are_not_chosen_by_rounded_places(encoder):
    """Under bfloat16 latents differ by rounding alone: two points a millimetre apart keep their places."""
    points, groups = cloud(200)
    exact = encoder(points, groups)[0]
    with torch.autocast("cpu", torch.bfloat16):
        mixed = encoder(points, groups)[0]
    assert mixed.dtype == torch.float32
    assert (mixed - exact).abs().mean() < 0.02
