"""SpecTrHuMS' networks: what they may and may not see, and siMLPe's beginning."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.shared.networks.layers.sizes import JointMlpSizes, SpectralSizes
from stages.shared.networks.spectral.autoencoder import SpectralAutoencoder
from stages.shared.networks.spectral.joint_mlp import JointMlp
from stages.shared.networks.spectral.moments import RunningMoments
from stages.shared.networks.spectral.motion_transformer import MotionTransformer, filled_plainly
from stages.shared.networks.spectral.spectral_model import SpectralModel

SMALL = SpectralSizes(channels=(4, 8, 8), latent=16, heads=2, layers=2, feedforward=32, dropout=0.0)


def _model(last: bool = False) -> SpectralModel:
    torch.manual_seed(0)
    model = SpectralModel(20, 12, 8, last, SMALL)
    model.moments.add(torch.randn(100, 16))
    return model.eval()


def test_shapes_and_the_papers_sizes() -> None:
    network = SpectralAutoencoder(512, SpectralSizes())
    assert network.encode(torch.randn(2, 3, 512, 3)).shape == (2, 3, 256)
    assert network.decode(torch.randn(2, 3, 256)).shape == (2, 3, 512, 3)
    transformer = MotionTransformer(75, SpectralSizes())
    assert transformer.positions.requires_grad and transformer(torch.randn(1, 75, 256)).shape == (1, 75, 256)


def test_a_frames_latent_does_not_depend_on_other_frames() -> None:
    network = _model().autoencoder
    frames = torch.randn(2, 5, 20, 3)
    alone = network.encode(frames[:1, 3])
    assert torch.allclose(network.encode(frames)[:1, 3], alone, atol=1e-6)


def test_the_loss_is_one_for_the_mean_mesh() -> None:
    network = SpectralAutoencoder(20, SMALL)
    data = torch.randn(5000, 20, 3) * torch.linspace(3, 0.1, 20)[:, None] + 4
    network.set_statistics(data.mean(0), data.std(0))
    assert abs(float(network.loss(data.mean(0).expand_as(data), data)) - 1) < 0.01


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(1, 40), min_size=1, max_size=6), st.integers(0, 1000))
def test_running_moments_are_those_of_all_vectors(sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = [rng.normal(3, 2, (size, 4)).astype(np.float32) for size in sizes]
    moments = RunningMoments(4)
    for part in parts:
        moments.add(torch.from_numpy(part))
    whole = np.concatenate(parts).astype(np.float64)
    assert np.abs(moments.mean.numpy() - whole.mean(0)).max() < 1e-4
    assert np.abs(moments.squares.numpy() - whole.var(0)).max() < 1e-3
    again = moments.restore(moments.standardise(torch.from_numpy(parts[0])))
    assert torch.allclose(again, torch.from_numpy(parts[0]), atol=1e-3)


def test_unknown_latents_repeat_the_last_or_lie_on_a_line() -> None:
    latents = torch.arange(10.0).reshape(1, 10, 1).repeat(1, 1, 2) ** 2
    held = filled_plainly(latents, 6, last=False)
    assert torch.equal(held[:, :6], latents[:, :6]) and (held[:, 6:] == 25).all()
    line = filled_plainly(latents, 6, last=True)
    assert torch.allclose(line[0, 5:, 0], torch.linspace(25, 81, 5)) and line[0, 9, 0] == 81


def test_unknown_frames_are_not_read() -> None:
    for last in (False, True):
        model, window = _model(last), torch.randn(2, 12, 20, 3)
        changed = window.clone()
        changed[:, 8 : 11 if last else 12] += 5
        if last:  # the stage puts the last known frame there; the network replaces its latent all the same
            assert torch.allclose(model(window), model(changed), atol=1e-5)
        else:
            assert torch.equal(model(window), model(changed))
        changed[:, 2] += 1
        assert not torch.allclose(model(window), model(changed))


def test_the_transformers_loss_does_not_reach_the_encoder() -> None:
    model = _model().train()
    static, dynamic = model.losses(torch.randn(2, 12, 20, 3), static_steps=0)
    dynamic.backward()
    assert all(p.grad is None for p in model.autoencoder.parameters())
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in model.transformer.parameters())
    static.backward()
    assert all(p.grad is not None for p in model.autoencoder.parameters())


def test_the_static_part_trains_alone_first() -> None:
    model, window = _model().train(), torch.randn(2, 12, 20, 3)
    seen = int(model.moments.count)
    losses = [float(model.losses(window, static_steps=2)[1].detach()) for _ in range(3)]
    assert losses[:2] == [0, 0] and losses[2] > 0
    assert int(model.steps) == 3 and int(model.moments.count) == seen + 24


def test_simlpe_starts_as_the_last_pose_and_learns() -> None:
    torch.manual_seed(0)
    network = JointMlp(3, 10, 5, JointMlpSizes(blocks=2))
    joints = torch.randn(2, 10, 3, 3)
    assert torch.allclose(network(joints), joints[:, -1:].expand(-1, 5, -1, -1), atol=1e-4)
    identity = network.transform @ network.transform.T
    assert torch.allclose(identity, torch.eye(10), atol=1e-5)
    optimiser = torch.optim.Adam(network.parameters(), 1e-2)
    times = torch.arange(15.0)[None, :, None, None]
    sway = torch.sin(times * 0.4 + torch.arange(16.0)[:, None, None, None]) * torch.ones(1, 1, 3, 3)
    first = float(network.loss(network(sway[:, :10]), sway[:, 10:]).detach())
    for _ in range(25):
        optimiser.zero_grad()
        loss = network.loss(network(sway[:, :10]), sway[:, 10:])
        loss.backward()
        optimiser.step()
    assert float(loss.detach()) < 0.9 * first


def test_an_untrained_autoencoder_returns_other_meshes_for_other_inputs() -> None:
    """With weights that make their inputs smaller, fourteen layers leave a thousandth of the differences."""
    torch.manual_seed(0)
    network = SpectralAutoencoder(256, SpectralSizes(channels=(16, 32, 64)))
    with torch.no_grad():
        made = network.decode(network.encode(torch.randn(64, 256, 3)))
    assert 0.1 < float(made.std(0).mean()) < 3
