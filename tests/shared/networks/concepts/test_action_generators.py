"""The two generators: frames in and out, padding, sampling, divergence and gradients."""

from __future__ import annotations

import pytest
import torch

from stages.shared.networks.concepts.action_generators import NETWORKS, ActionGenerator, new_generator

FEATURES, ACTIONS = 12, 3


def network(name: str) -> ActionGenerator:
    torch.manual_seed(0)
    found = new_generator(name, FEATURES, ACTIONS, width=16, blocks=2, latent=4).eval()
    found.mean.copy_(torch.randn(FEATURES))
    found.spread.copy_(torch.rand(FEATURES) + 0.5)
    return found


def given(found: ActionGenerator, rows: int = 2, frames: int = 9):
    motion, action = torch.randn(rows, frames, FEATURES), torch.arange(rows) % ACTIONS
    return motion, action, torch.randn(found.noise_shape(rows, frames))


@pytest.mark.parametrize("name", NETWORKS)
def test_frames_are_standardised_relative_to_the_pelvis(name: str):
    found = network(name)
    motion = torch.randn(2, 5, FEATURES)
    torch.testing.assert_close(found.positions(found.standardised(motion)), motion, atol=1e-5, rtol=1e-5)
    joints = motion.unflatten(-1, (-1, 3))
    plain = torch.cat([joints[..., :1, :], joints[..., 1:, :] - joints[..., :1, :]], dim=-2).flatten(-2)
    torch.testing.assert_close(found.standardised(motion), (plain - found.mean) / found.spread)
    moved = joints.clone() + torch.tensor([1.0, 2.0, 3.0])
    apart = found.standardised(moved.flatten(-2)) - found.standardised(motion)
    assert apart[..., 3:].abs().max() < 1e-4 and apart[..., :3].abs().min() > 0.1


@pytest.mark.parametrize("name", NETWORKS)
def test_padding_is_not_read(name: str):
    found = network(name)
    motion, action, noise = given(found)
    valid = torch.arange(9) < torch.tensor([[5], [9]])
    changed = motion.clone()
    changed[0, 5:] = 100
    one, two = (found(each, action, valid, noise) for each in (motion, changed))
    torch.testing.assert_close(one.divergence, two.divergence)
    torch.testing.assert_close(one.frames[0, :5], two.frames[0, :5])
    torch.testing.assert_close(one.frames[1], two.frames[1])


@pytest.mark.parametrize("name", NETWORKS)
def test_samples_depend_on_noise_and_action_and_not_on_the_other_rows(name: str):
    found = network(name)
    _, _, noise = given(found, 3)
    action = torch.tensor([0, 1, 2])
    whole = found.sample(action, 9, noise)
    assert whole.shape == (3, 9, FEATURES)
    torch.testing.assert_close(found.sample(action[1:2], 9, noise[1:2])[0], whole[1], atol=1e-5, rtol=1e-5)
    same_noise = found.sample(action, 9, noise[:1].expand_as(noise))
    assert (same_noise[0] - same_noise[1]).abs().max() > 1e-3
    same_action = found.sample(torch.zeros(3, dtype=torch.long), 9, noise)
    assert (same_action[0] - same_action[1]).abs().max() > 1e-3


@pytest.mark.parametrize("name", NETWORKS)
def test_every_parameter_learns(name: str):
    found = network(name).train()
    motion, action, noise = given(found, 3)
    valid = torch.ones(3, 9, dtype=torch.bool)
    made = found(motion, action, valid, noise)
    (made.frames.square().mean() + made.divergence.mean()).backward()
    for key, value in found.named_parameters():
        assert value.grad is not None and torch.isfinite(value.grad).all() and value.grad.abs().max() > 0, key


def test_the_recurrent_divergence_is_that_of_two_normal_distributions():
    """Against torch.distributions, with the codes' layers recorded."""
    found = network("recurrent")
    motion, action, noise = given(found, 2, 4)
    codes = {"prior": [], "posterior": []}
    for key in codes:
        getattr(found, f"{key}_code").register_forward_hook(
            lambda _, __, out, key=key: codes[key].append(out.detach())
        )
    made = found(motion, action, torch.ones(2, 4, dtype=torch.bool), noise)
    total = torch.zeros(2)
    for prior, posterior in zip(codes["prior"], codes["posterior"], strict=True):
        normals = [
            torch.distributions.Normal(mean, (log.clamp(-8, 4) / 2).exp())
            for mean, log in (each.chunk(2, dim=1) for each in (posterior, prior))
        ]
        total += torch.distributions.kl_divergence(*normals).sum(1)
    torch.testing.assert_close(made.divergence, total, atol=1e-5, rtol=1e-4)


def test_the_last_number_of_the_noise_chooses_the_true_frame():
    """A true frame instead of the made one changes the frame after it, and no frame before."""
    found = network("recurrent")
    motion, action, noise = given(found, 1)
    valid = torch.ones(1, 9, dtype=torch.bool)
    noise[..., -1] = 3.0  # the normal distribution's share below it is above the share of true frames
    made = found(motion, action, valid, noise).frames
    noise[:, 4, -1] = -3.0
    taught = found(motion, action, valid, noise).frames
    torch.testing.assert_close(made[:, :5], taught[:, :5])
    assert (made[:, 5] - taught[:, 5]).abs().max() > 1e-4
    sampled = found.sample(action, 9, noise)
    noise[..., -1] = 0
    torch.testing.assert_close(found.sample(action, 9, noise), sampled)
