"""Windows and clouds for training: right frames, right groups, no leak."""

import pickle

import numpy as np
import pytest
import roma
import torch

from data_schemas.tpc import TpcReader
from stages.shared.kinematics.forward import global_rotations, joint_positions, local_rotations
from stages.shared.kinematics.plain_interpolation import Glide, interpolate_pose
from stages.shared.kinematics.window_interpolation import interpolate_windows
from stages.shared.training.masks import draw_known
from stages.shared.training.task import step_random
from stages.shared.training.windows import WindowPool, clouds_of, draw_clouds, known_centre
from tests.shared.training.tiny_clouds import write_clouds


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    with TpcReader(write_clouds(tmp_path_factory.mktemp("clouds") / "tpc")) as reader:
        yield reader


@pytest.fixture(scope="module")
def pool(reader) -> WindowPool:
    return WindowPool(reader, ("train",))


def test_the_same_seed_draws_the_same_windows(pool):
    first, second = (pool.draw(5, 20, np.random.default_rng(4), augment=True) for _ in range(2))
    assert (first.heads == second.heads).all()
    assert (first.rotations == second.rotations).all()


def test_short_clips_are_masked_and_hold_their_last_frame(pool):
    short = int(pool.lengths.argmin())
    window = pool.at(np.array([short]), np.array([0]), 20)
    assert window.valid.sum() == pool.lengths[short] == 12
    assert (window.heads[0, 12:] == window.heads[0, 11]).all()


@pytest.mark.parametrize("balance", [0.0, 0.5, 1.0])
def test_data_sets_share_as_balance_says(reader, balance):
    pool = WindowPool(reader, ("train",), balance=balance)
    frames, share = {}, {}
    for clip, length, chance in zip(pool.clips, pool.lengths, pool.share, strict=True):
        archive = reader.row(clip).source.split("!")[0]
        frames[archive] = frames.get(archive, 0) + length
        share[archive] = share.get(archive, 0) + chance
    wanted = {archive: count**balance for archive, count in frames.items()}
    assert len(share) == 2
    for archive, chance in share.items():
        assert chance == pytest.approx(wanted[archive] / sum(wanted.values()))


def test_windows_come_from_the_file_as_it_is_whatever_is_kept_in_memory(tmp_path):
    with TpcReader(write_clouds(tmp_path / "tpc", clips=2, frames=600)) as reader:
        kept, unkept = (WindowPool(reader, ("train",), cache_mb=limit) for limit in (100, 0))
        scarce = WindowPool(reader, ("train",), cache_mb=0.1)  # room for one piece of the long clip
        for seed in range(8):
            drawn = [pool.draw(4, 40, np.random.default_rng(seed), augment=True) for pool in (kept, unkept, scarce)]
            for other in drawn[1:]:
                assert all((getattr(drawn[0], name) == value).all() for name, value in vars(other).items())
        assert scarce.kept_bytes <= 0.1e6 < kept.kept_bytes
        assert unkept.kept_bytes == 0
        heads, rotations = reader.transforms(kept.clips[1])
        window = kept.at(np.array([1]), np.array([250]), 20)  # across the border of two chunks
        assert (window.heads[0].numpy() == heads[250:270]).all()
        assert (window.rotations[0].numpy() == rotations[250:270]).all()


def test_a_pool_can_be_sent_to_another_process(pool):
    copy = pickle.loads(pickle.dumps(pool))
    first, second = (each.draw(3, 20, np.random.default_rng(1), augment=True) for each in (pool, copy))
    assert (first.heads == second.heads).all()


def test_clouds_are_placed_by_the_known_frames_alone(pool):
    rng = np.random.default_rng(0)
    windows = pool.draw(3, 20, rng, augment=False)
    known = torch.zeros(3, 20, dtype=torch.bool)
    known[:, [0, 19]] = True
    before = known_centre(windows.heads, known)
    windows.heads[:, 1:19] += 100
    assert (known_centre(windows.heads, known) == before).all()


def test_mirroring_exchanges_left_and_right_and_keeps_distances(pool):
    rng = np.random.default_rng(1)
    windows = pool.draw(40, 4, rng, augment=True)
    cloud = draw_clouds(windows, 16, (0.05, 0.05), rng, augment=True)
    flips = torch.linalg.det(cloud.turn) < 0
    assert flips.any() and not flips.all()
    drawn = windows.groups.gather(1, cloud.drawn.bones)
    assert (cloud.drawn.groups[~flips] == drawn[~flips]).all()
    assert (cloud.drawn.groups[flips] == torch.tensor([0, 2, 1, 4, 3])[drawn[flips]]).all()
    centre = known_centre(windows.heads, windows.valid)
    points = clouds_of(windows.heads, windows.rotations, cloud, centre)
    size = torch.linalg.det(cloud.turn).abs() ** (1 / 3)
    plain = clouds_of(windows.heads, windows.rotations, cloud.redrawn(windows, rng), centre)
    assert plain.shape == points.shape
    torch.testing.assert_close(
        cloud.turn @ cloud.turn.mT, torch.eye(3) * size[:, None, None] ** 2, atol=1e-5, rtol=1e-4
    )


def test_windows_that_stay_as_recorded_keep_speed_size_and_bones_but_are_mirrored(pool):
    kept = np.arange(40) % 2 == 0
    windows = pool.draw(40, 8, step_random(0, 1, 3, range(40)), augment=True, proportions=1.15, as_recorded=kept)
    plain = pool.draw(40, 8, step_random(0, 1, 3, range(40)), augment=False)
    same = (windows.tails == plain.tails).flatten(1).all(1).numpy()
    assert (same == kept).all()
    paces = (windows.heads[:, :, 0] - windows.heads[:, :1, 0]).norm(dim=-1)
    own = (plain.heads[:, :, 0] - plain.heads[:, :1, 0]).norm(dim=-1)
    torch.testing.assert_close(windows.heads[kept], plain.heads[kept], atol=1e-5, rtol=0)
    assert not torch.allclose(paces[~kept], own[~kept], atol=1e-4)
    turn = draw_clouds(windows, 8, (0.05, 0.05), step_random(0, 1, 3, range(40)), augment=True, as_recorded=kept).turn
    size = torch.linalg.det(turn)
    torch.testing.assert_close(size.abs()[kept], torch.ones(int(kept.sum())))
    assert (size[kept] < 0).any() and (size[kept] > 0).any()
    assert (size.abs()[~kept] - 1).abs().median() > 0.05


def test_redrawn_points_keep_their_groups(pool):
    rng = np.random.default_rng(2)
    windows = pool.draw(4, 4, rng, augment=False)
    cloud = draw_clouds(windows, 30, (0.05, 0.05), rng, augment=False)
    again = cloud.redrawn(windows, rng)
    assert (windows.groups.gather(1, again.drawn.bones) == windows.groups.gather(1, cloud.drawn.bones)).all()
    assert (again.drawn.in_bone != cloud.drawn.in_bone).any()


def test_points_spread_evenly_follow_from_each_windows_own_generator(pool):
    rng = step_random(0, 1, 5, range(6))
    windows = pool.draw(6, 4, rng, augment=False)
    clouds = [
        draw_clouds(windows, 30, (0.05, 0.05), step_random(0, 1, seed, range(6)), augment=False, even=True)
        for seed in (5, 5, 6)
    ]
    first, again, other = (cloud.drawn.in_bone for cloud in clouds)
    assert (first == again).all() and (first != other).any()
    assert (windows.groups.gather(1, clouds[0].drawn.bones) == clouds[0].drawn.groups).all()
    held = (windows.weights > 0).gather(1, clouds[0].drawn.bones)
    assert held.all()


def test_yaw_goes_round_the_whole_circle(pool):
    rng = np.random.default_rng(3)
    windows = pool.draw(400, 2, rng, augment=False)
    turn = draw_clouds(windows, 2, (0.05, 0.05), rng, augment=False).turn
    yaw = torch.atan2(turn[:, 0, 2], turn[:, 0, 0])
    assert torch.histc(yaw, 8, -np.pi, np.pi).min() > 25


def test_interpolated_windows_keep_keys_and_read_nothing_else(pool):
    rng = np.random.default_rng(5)
    windows = pool.draw(6, 24, rng, augment=False)
    known = draw_known(windows.valid.sum(1), 24, 12, rng)
    heads, _ = interpolate_windows(windows.heads, windows.rotations, windows.parents, known, rate_hz=30)
    torch.testing.assert_close(heads[known], windows.heads[known], atol=1e-4, rtol=1e-4)
    junk = torch.where(known[..., None, None], windows.heads, torch.randn_like(windows.heads))
    again, _ = interpolate_windows(junk, windows.rotations, windows.parents, known, rate_hz=30)
    assert (again == heads).all()
    last = int(known[0].nonzero()[-1])
    torch.testing.assert_close(heads[0, last + 1 :], heads[0, last].expand_as(heads[0, last + 1 :]))


def test_windows_glide_on_as_a_single_motion_does(pool):
    rng = np.random.default_rng(6)
    windows = pool.draw(5, 24, rng, augment=False)
    glide = Glide(root=9.0, turn=3.0)
    known = torch.zeros(5, 24, dtype=torch.bool)
    for row, frames in enumerate(([6, 7, 8, 9], [0, 5, 12], [10, 23], [14], range(4, 24))):
        known[row, list(frames)] = True
    heads, rotations = interpolate_windows(
        windows.heads, windows.rotations, windows.parents, known, rate_hz=30, glide=glide
    )
    held, _ = interpolate_windows(windows.heads, windows.rotations, windows.parents, known, rate_hz=30)
    parents = windows.parents[0].numpy()
    for row in range(5):
        keys = torch.nonzero(known[row]).squeeze(1)
        turns = windows.rotations[row, keys]
        local = local_rotations(turns, parents)
        inverse = roma.quat_conjugation(turns[:, parents.clip(0)])
        offsets = roma.quat_action(inverse, windows.heads[row, keys] - windows.heads[row, keys][:, parents.clip(0)])
        beyond = (torch.arange(24) < keys[0]) | (torch.arange(24) > keys[-1])
        times = torch.arange(24.0)[beyond]
        out = interpolate_pose(local, windows.heads[row, keys, 0], offsets, keys.float(), times, glide=glide)
        world = global_rotations(out[0], parents)
        places = joint_positions(world, out[1], out[2] if len(keys) > 1 else offsets[:1], parents)
        torch.testing.assert_close(heads[row, beyond], places, atol=1e-4, rtol=1e-4)
        same = (rotations[row, beyond] * world).sum(-1).abs()
        torch.testing.assert_close(same, torch.ones_like(same), atol=1e-5, rtol=0)
        assert (heads[row, ~beyond] == held[row, ~beyond]).all()


@pytest.mark.parametrize("length", [4, 9, 30, 64])
def test_masks_always_leave_keys_and_gaps_within_the_clip(length):
    rng = np.random.default_rng(length)
    lengths = torch.full((200,), length)
    known = draw_known(lengths, 64, 32, rng)
    assert known.any(1).all()
    assert not known[:, length:].any()
    assert (~known[:, :length]).any(1).float().mean() > 0.5
