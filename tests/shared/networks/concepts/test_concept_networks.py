"""The networks of motion concepts: what each frame may see, splines, and where they start from."""

from __future__ import annotations

import pytest
import torch

from stages.shared.networks.concepts.motion_encoder import MotionEncoder, sinusoidal
from stages.shared.networks.concepts.reconstruction import MotionReconstructor
from stages.shared.networks.concepts.refiners import AnchorRefiner, Segments, TransitionRefiner
from stages.shared.networks.concepts.transition_generator import (
    TransitionGenerator,
    at_times,
    joint_distance,
    straight,
)

F = 6


def drawn(*shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(sum(shape)))


def test_hidden_frames_change_nothing():
    torch.manual_seed(0)
    encoder = MotionEncoder(F, 2, width=16).eval()
    motion, action = drawn(3, 12, F), torch.tensor([0, 1, 1])
    seen = torch.ones(3, 12, dtype=torch.bool)
    seen[:, 4:7] = False
    changed = motion.clone()
    changed[:, 4:7] += 100
    torch.testing.assert_close(encoder(motion, action, seen), encoder(changed, action, seen))
    assert not torch.allclose(encoder(motion, action, seen), encoder(motion, 1 - action, seen))


def test_frames_apart_do_not_see_each_other():
    torch.manual_seed(0)
    encoder = MotionEncoder(F, 1, width=16).eval()
    motion, action, seen = drawn(2, 10, F), torch.zeros(2, dtype=torch.long), torch.ones(2, 10, dtype=torch.bool)
    part = torch.arange(10) < 4
    together = (part[:, None] == part[None]).expand(2, -1, -1)
    changed = motion.clone()
    changed[:, 4:] += 5
    first, second = (encoder(each, action, seen, together) for each in (motion, changed))
    torch.testing.assert_close(first[:, :4], second[:, :4])
    assert (first[:, 4:] - second[:, 4:]).abs().max() > 1e-3


def test_positions_are_the_formula():
    found = sinusoidal(50, 8, torch.device("cpu"))
    for column in range(8):
        rate = 10000.0 ** (-(column - column % 2) / 8)
        expected = (torch.arange(50) * rate).sin() if column % 2 == 0 else (torch.arange(50) * rate).cos()
        torch.testing.assert_close(found[:, column], expected, atol=1e-5, rtol=1e-4)


def test_splines_are_polynomials_and_straight_lines_are_lines():
    first, last, times = drawn(4, F), drawn(4, F) + 1, torch.linspace(0, 1, 9).expand(4, -1)
    line = at_times(straight(first, last), times)
    torch.testing.assert_close(line, first[:, None] + times[..., None] * (last - first)[:, None])
    splines = drawn(4, 4, F)
    cubic = sum(splines[:, power, None] * times[..., None] ** power for power in range(4))
    torch.testing.assert_close(at_times(splines, times), cubic)


def test_joint_distance_is_the_mean_over_joints():
    true = torch.zeros(1, F)
    found = torch.tensor([[3.0, 4.0, 0.0, 0.0, 0.0, 1.0]])
    torch.testing.assert_close(joint_distance(found, true), torch.tensor([3.0]))


def test_padding_of_transitions_changes_nothing_and_codes_change_samples():
    torch.manual_seed(0)
    network = TransitionGenerator(F, latent=4, hidden=16)
    first, last, seconds = drawn(2, F), drawn(2, F) + 1, torch.tensor([0.4, 0.9])
    frames, counts, noise = drawn(2, 8, F), torch.tensor([5, 8]), torch.zeros(2, 4)
    longer = torch.cat([frames, torch.full((2, 3, F), 50.0)], dim=1)
    one, two = (network(first, last, seconds, each, counts, noise) for each in (frames, longer))
    torch.testing.assert_close(one.code, two.code)
    times = torch.linspace(0, 1, 5).expand(2, -1)
    codes = [network.decoded(first, last, seconds, code, times) for code in (torch.zeros(2, 4), torch.ones(2, 4))]
    assert not torch.allclose(*codes)


def test_transitions_are_cubics_with_splines_and_any_curve_without():
    torch.manual_seed(0)
    first, last, seconds, code = drawn(2, F), drawn(2, F) + 1, torch.tensor([0.4, 0.9]), drawn(2, 4)
    times = torch.linspace(0, 1, 9).expand(2, -1)
    for splines in (True, False):
        network = TransitionGenerator(F, latent=4, hidden=16, splines=splines)
        whole = network.decoded(first, last, seconds, code, times)
        fourth = whole.diff(n=4, dim=1).abs().max()
        assert (fourth < 1e-5) == splines
        torch.testing.assert_close(whole[:, ::2], network.decoded(first, last, seconds, code, times[:, ::2]))


def test_only_concepts_of_the_action_are_chosen():
    torch.manual_seed(0)
    concepts, action_of = drawn(5, F), torch.tensor([0, 0, 1, 1, 1])
    network = AnchorRefiner(F, 2, 16, concepts, action_of)
    logits, poses = network(
        drawn(4, 9, F), torch.tensor([0, 1, 0, 1]), torch.ones(4, 9, dtype=torch.bool), torch.tensor([0, 3, 8, 4])
    )
    assert action_of[logits.argmax(-1)].tolist() == [0, 1, 0, 1] and poses.shape == (4, F)


def test_a_reconstruction_reads_the_whole_motion_and_no_padding():
    torch.manual_seed(0)
    network = MotionReconstructor(F, 2, 16).eval()
    motion, action, valid = drawn(2, 10, F), torch.tensor([0, 1]), torch.ones(2, 10, dtype=torch.bool)
    valid[:, 7:] = False
    changed, padded = motion.clone(), motion.clone()
    changed[:, 2] += 1
    padded[:, 7:] += 100
    given = [network(each, action, valid)[:, :7] for each in (motion, changed, padded)]
    assert given[0].shape == (2, 7, F) and ((given[0] - given[1]).abs().amax((0, 2)) > 0).all()
    torch.testing.assert_close(given[0], given[2])


@pytest.mark.parametrize("splines", [True, False])
def test_an_untrained_transition_refiner_returns_its_concepts_and_gradients_reach_all_parts(splines: bool):
    torch.manual_seed(0)
    network = TransitionRefiner(F, 1, 16, splines=splines)
    motion, valid = drawn(2, 9, F), torch.ones(2, 9, dtype=torch.bool)
    of_frame = torch.tensor([0] * 4 + [1] * 5).expand(2, -1)
    times = torch.tensor([0, 0.25, 0.5, 0.75, 0, 0.25, 0.5, 0.75, 1.0]).expand(2, -1)
    ends = torch.tensor([[0, 4], [0, 4]]), torch.tensor([[4, 8], [4, 8]])
    whole, restored = network(motion, torch.zeros(2, dtype=torch.long), valid, Segments(of_frame, times, *ends))
    torch.testing.assert_close(whole, restored)
    torch.nn.init.normal_(network.output.weight)
    whole, _ = network(motion, torch.zeros(2, dtype=torch.long), valid, Segments(of_frame, times, *ends))
    whole.square().sum().backward()
    assert all(parameter.grad is not None for parameter in network.parameters())
