"""The decoder: points know nothing of each other, dropout is the same in every frame."""

import pytest
import torch

from stages.shared.networks.layers.sizes import DecoderSizes
from stages.shared.networks.pumps.cloud_decoder import CloudDecoder, PointHead, drop_features


@pytest.fixture(params=["mlp", "skinning"])
def decoder(request) -> CloudDecoder:
    torch.manual_seed(0)
    sizes = DecoderSizes(
        width=16, layers=2, heads=2, noise=6, head=request.param, codes=8, point_width=12, point_hidden=8
    )
    return CloudDecoder(10, sizes).eval()


def inputs() -> tuple[torch.Tensor, ...]:
    generator = torch.Generator().manual_seed(1)
    return (
        torch.randn(2, 7, 10, generator=generator),
        torch.randn(2, 7, 3, generator=generator),
        torch.arange(7.0).unsqueeze(0),
        torch.randint(0, 5, (2, 9), generator=generator),
        torch.randn(2, 9, 6, generator=generator),
    )


def test_points_are_independent(decoder):
    latents, centroids, times, groups, noise = inputs()
    whole = decoder(latents, centroids, times, groups, noise)
    order = torch.tensor([8, 0, 3])
    part = decoder(latents, centroids, times, groups[:, order], noise[:, order])
    torch.testing.assert_close(part, whole[:, :, order], atol=1e-4, rtol=1e-4)


def test_the_same_points_in_all_sequences_are_given_once(decoder):
    latents, centroids, times, groups, noise = inputs()
    once = decoder(latents, centroids, times, groups[:1], noise[:1])
    twice = decoder(latents, centroids, times, groups[:1].expand(2, -1), noise[:1].expand(2, -1, -1))
    torch.testing.assert_close(once, twice, atol=1e-5, rtol=1e-5)


def test_moving_the_centroids_moves_the_cloud(decoder):
    latents, centroids, times, groups, noise = inputs()
    shift = torch.tensor([5.0, 1.0, -2.0])
    whole = decoder(latents, centroids, times, groups, noise)
    torch.testing.assert_close(
        decoder(latents, centroids + shift, times, groups, noise), whole + shift, atol=1e-4, rtol=1e-4
    )


def test_frames_beyond_the_end_change_nothing(decoder):
    latents, centroids, times, groups, noise = inputs()
    valid = torch.ones(2, 7, dtype=torch.bool)
    valid[:, 5:] = False
    whole = decoder(latents, centroids, times, groups, noise, valid)
    latents[:, 5:] = 9
    centroids[:, 5:] = -9
    torch.testing.assert_close(decoder(latents, centroids, times, groups, noise, valid)[:, :5], whole[:, :5])


def test_the_joined_first_layer_is_one_linear_layer_of_the_concatenation():
    head = PointHead(DecoderSizes(width=8, noise=4, point_width=6, point_hidden=5))
    frames, groups, noise = torch.randn(1, 2, 8), torch.tensor([[0, 3]]), torch.randn(1, 2, 4)
    out = head(frames, groups, noise)
    for frame in range(2):
        for point in range(2):
            rows = slice(6 * int(groups[0, point]), 6 * int(groups[0, point]) + 6)
            weight = torch.cat([head.by_frame.weight[rows], head.by_point.weight], dim=1)
            joined = torch.cat([frames[0, frame], noise[0, point]])
            hidden = torch.nn.functional.gelu(weight @ joined + head.by_frame.bias[rows])
            expected = head.out(torch.nn.functional.gelu(head.hidden(hidden)))
            torch.testing.assert_close(out[0, frame, point], expected, atol=1e-5, rtol=1e-4)


def test_sequence_wise_dropout_leaves_out_the_same_features_in_every_frame():
    values = torch.ones(400, 5, 20)
    dropped = drop_features(values, 0.25, "sequence", torch.Generator().manual_seed(0))
    assert (dropped == dropped[:, :1]).all()
    torch.testing.assert_close(dropped.unique(), torch.tensor([0.0, 1 / 0.75]))
    assert abs(dropped.mean() - 1) < 0.02
    by_element = drop_features(values, 0.25, "element", torch.Generator().manual_seed(0))
    assert (by_element != by_element[:, :1]).any()
    assert drop_features(values, 0.0, "sequence") is values


def test_nothing_is_dropped_in_use(decoder):
    torch.testing.assert_close(decoder(*inputs()), decoder(*inputs()), atol=0, rtol=0)
