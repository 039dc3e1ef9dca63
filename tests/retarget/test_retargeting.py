"""A motion on another rig: what must stay, whatever the rig's names, axes, bone counts and proportions."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stages.shared.clips
from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import BODY_GROUPS, Motion, Skeleton
from stages.retarget.config import Config
from stages.retarget.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.humanoid.bone_matching import LIMBS, bones_of, match_limb, size_ratio, spine_of
from stages.shared.humanoid.retargeting import is_human_pose, rest_pose, retarget
from stages.shared.inference.retarget_clouds import pull_to_places
from stages.shared.kinematics.forward import positions_of
from stages.train.skeleton.config import Config as TrainSkeleton
from stages.train.skeleton.run import run as train_skeleton
from tests.shared.training.tiny_clouds import write_clouds

CLIPS = Path(stages.shared.clips.__file__).parent
KICK = CLIPS / "kick.bvh"


@pytest.fixture(scope="module")
def kick() -> tuple[Skeleton, Motion]:
    skeleton, motion, _ = motion_of(read_bvh(KICK.read_bytes(), KICK.name))
    return skeleton, Motion(motion.rotations[:60], motion.root_positions[:60], motion.fps)


def _other_axes(skeleton: Skeleton, motion: Motion, rng: np.random.Generator) -> tuple[Skeleton, Motion]:
    """The same figure with every joint's own axes turned at random."""
    turns = Rotation.random(skeleton.joints, random_state=rng)
    rotations = np.stack(
        [(Rotation.from_quat(motion.rotations[:, j]) * turns[j]).as_quat() for j in range(len(turns))]
    )
    offsets = skeleton.offsets.copy()
    for joint in range(1, skeleton.joints):
        offsets[joint] = turns[int(skeleton.parents[joint])].inv().apply(offsets[joint])
    tails = turns.inv().apply(skeleton.tails)
    changed = replace(skeleton, offsets=offsets, tails=tails)
    return changed, replace(motion, rotations=rotations.transpose(1, 0, 2).astype(np.float32))


def _split(skeleton: Skeleton, joint: int) -> Skeleton:
    """The skeleton with one bone made of two halves; the new joint comes right after the old one."""
    order = [*range(joint + 1), joint, *range(joint + 1, skeleton.joints)]
    parents = np.array([p + (p > joint) for p in skeleton.parents[order]], np.int32)
    parents[joint + 1] = joint
    below = [j for j in range(joint + 2, len(order)) if skeleton.parents[order[j]] == joint]
    parents[below] = joint + 1
    offsets, tails = skeleton.offsets[order].copy(), skeleton.tails[order].copy()
    tails[joint : joint + 2] = skeleton.tails[joint] / 2
    offsets[joint + 1] = skeleton.tails[joint] / 2
    offsets[below] -= skeleton.tails[joint] / 2
    names = tuple(f"{skeleton.names[j]}{'_twist' if i == joint + 1 else ''}" for i, j in enumerate(order))
    return replace(
        skeleton, names=names, parents=parents, offsets=offsets, tails=tails,
        groups=skeleton.groups[order], sampled=skeleton.sampled[order],
    )  # fmt: skip


def _stretched(skeleton: Skeleton, joint: int, factor: float) -> Skeleton:
    """The skeleton with one bone longer."""
    offsets, tails = skeleton.offsets.copy(), skeleton.tails.copy()
    tails[joint] *= factor
    offsets[skeleton.parents == joint] *= factor
    return replace(skeleton, offsets=offsets, tails=tails)


def _apart_mm(a: np.ndarray, b: np.ndarray) -> float:
    return 1000 * float(np.linalg.norm(a - b, axis=-1).max())


def test_a_figure_retargeted_to_itself_stays_as_it_is(kick):
    skeleton, motion = kick
    made = retarget(skeleton, motion, skeleton, motion)
    assert made.size == pytest.approx(1)
    assert _apart_mm(positions_of(skeleton, made.motion), positions_of(skeleton, motion)) < 0.1
    pulled = pull_to_places(skeleton, motion, skeleton, made)
    assert _apart_mm(positions_of(skeleton, pulled), positions_of(skeleton, motion)) < 0.5


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_joints_own_axes_mean_nothing(kick, seed: int):
    skeleton, motion = kick
    turned, turned_motion = _other_axes(skeleton, motion, np.random.default_rng(seed))
    assert _apart_mm(positions_of(turned, turned_motion), positions_of(skeleton, motion)) < 0.1
    made = retarget(skeleton, motion, turned, replace(turned_motion, rotations=turned_motion.rotations[:1],
                                                      root_positions=motion.root_positions[:1]))  # fmt: skip
    assert _apart_mm(positions_of(turned, made.motion), positions_of(skeleton, motion)) < 0.5


def test_names_mean_nothing(kick):
    skeleton, motion = kick
    nameless = replace(skeleton, names=tuple(f"j{i}" for i in range(skeleton.joints)))
    ours, theirs = (retarget(skeleton, motion, rig, motion).motion for rig in (skeleton, nameless))
    np.testing.assert_array_equal(ours.rotations, theirs.rotations)


def test_a_larger_figure_goes_further_in_the_same_poses(kick):
    skeleton, motion = kick
    large = replace(skeleton, offsets=skeleton.offsets * 1.3, tails=skeleton.tails * 1.3)
    made = retarget(skeleton, motion, large, None)
    assert made.size == pytest.approx(1.3)
    wanted = made.in_targets_world(positions_of(skeleton, motion))
    assert _apart_mm(positions_of(large, made.motion), wanted) < 1


@pytest.mark.parametrize("degrees", [40.0, 180.0, -100.0])
def test_the_result_turns_and_moves_with_the_source(kick, degrees: float):
    skeleton, motion = kick
    rig = _stretched(_stretched(skeleton, 4, 1.2), 7, 0.9)
    yaw, shift = Rotation.from_euler("y", degrees, degrees=True), np.array([3.0, 0.0, -2.0])
    rotations = (yaw * Rotation.from_quat(motion.rotations.reshape(-1, 4))).as_quat().reshape(motion.rotations.shape)
    moved = replace(
        motion, rotations=rotations.astype(np.float32),
        root_positions=(yaw.apply(motion.root_positions) + shift).astype(np.float32),
    )  # fmt: skip
    plain = positions_of(rig, retarget(skeleton, motion, rig).motion)
    turned = positions_of(rig, retarget(skeleton, moved, rig).motion)
    assert _apart_mm(yaw.apply(plain.reshape(-1, 3)).reshape(plain.shape) + shift, turned) < 1


@pytest.mark.parametrize("group", ["left_arm", "right_leg"])
def test_a_split_bone_answers_with_both_halves(kick, group: str):
    skeleton, motion = kick
    joint = bones_of(skeleton, BODY_GROUPS.index(group))[0]
    rig = _split(skeleton, joint)
    pieces = match_limb(skeleton, rig, BODY_GROUPS.index(group))
    assert (joint,) in [piece.source for piece in pieces] and (joint, joint + 1) in [piece.target for piece in pieces]
    kept = [j for j in range(rig.joints) if j != joint + 1]
    made = positions_of(rig, retarget(skeleton, motion, rig).motion)[:, kept]
    assert _apart_mm(made, positions_of(skeleton, motion)) < 1
    back = retarget(rig, retarget(skeleton, motion, rig).motion, skeleton).motion
    assert _apart_mm(positions_of(skeleton, back), positions_of(skeleton, motion)) < 1


def test_pieces_are_in_order_and_share_no_bone(kick):
    skeleton, _ = kick
    rig = _split(_split(skeleton, 8), 4)
    for group in LIMBS:
        pieces = match_limb(skeleton, rig, group)
        for side in ("source", "target"):
            bones = [bone for piece in pieces for bone in getattr(piece, side)]
            assert bones == sorted(set(bones))
    assert size_ratio(skeleton, rig) == pytest.approx(1)


def test_a_spine_runs_from_pelvis_to_head(kick):
    spine = spine_of(kick[0])
    assert spine.bones[0] == kick[0].root
    assert spine.places[0] == 0 and spine.places[-1] == 2 and (np.diff(spine.places) > 0).all()


def test_pulling_brings_hands_nearer_where_arms_differ(kick):
    skeleton, motion = kick
    arm = bones_of(skeleton, BODY_GROUPS.index("left_arm"))
    rig = _stretched(_stretched(skeleton, arm[0], 0.8), arm[1], 1.25)
    turned = retarget(skeleton, motion, rig)
    wanted = turned.in_targets_world(_ends(skeleton, motion, arm[-1]))
    before = np.linalg.norm(_ends(rig, turned.motion, arm[-1]) - wanted, axis=1).mean()
    pulled = pull_to_places(skeleton, motion, rig, turned)
    after = np.linalg.norm(_ends(rig, pulled, arm[-1]) - wanted, axis=1).mean()
    assert after < 0.6 * before
    still = [j for j in range(rig.joints) if rig.groups[j] != BODY_GROUPS.index("left_arm")]
    assert _apart_mm(positions_of(rig, pulled)[:, still], positions_of(rig, turned.motion)[:, still]) < 40


def _ends(skeleton: Skeleton, motion: Motion, bone: int) -> np.ndarray:
    tails = Rotation.from_quat(motion.rotations[:, bone]).apply(skeleton.tails[bone])
    return positions_of(skeleton, motion)[:, bone] + tails


def test_a_rig_without_a_human_pose_is_refused_and_helped_by_a_frame(kick):
    skeleton, motion = kick
    flat, poses = _other_axes(skeleton, motion, np.random.default_rng(0))  # its limbs point anywhere at rest
    assert is_human_pose(skeleton, rest_pose(skeleton)) and not is_human_pose(flat, rest_pose(flat))
    with pytest.raises(InputError, match="rest pose"):
        retarget(skeleton, motion, flat)
    made = retarget(skeleton, motion, flat, poses)
    assert _apart_mm(positions_of(flat, made.motion), positions_of(skeleton, motion)) < 0.1


def test_the_command_writes_the_rigs_header_and_the_motions_frames(tmp_path: Path):
    out = tmp_path / "out.bvh"
    rig = CLIPS / "walk.bvh"
    report = run(Config(input=KICK, to=rig, output=out))
    made, source, header = (read_bvh(path.read_bytes(), path.name) for path in (out, KICK, rig))
    assert made.header == header.header
    assert (made.frames, made.frame_time) == (source.frames, pytest.approx(source.frame_time, rel=1e-6))
    assert report.figures["size"] == pytest.approx(1)
    a, b = (positions_of(*motion_of(bvh)[:2]) for bvh in (made, source))
    assert _apart_mm(a, b) < 6  # no two of their poses are quite alike
    with pytest.raises(UsageError, match="exists"):
        run(Config(input=KICK, to=rig, output=out))
    with pytest.raises(InputError, match="cannot be read"):
        run(Config(input=tmp_path / "none.bvh", to=rig, output=tmp_path / "new.bvh"))
    assert run(Config(input=KICK, to=rig, output=out, overwrite=True)).output == out
    with zipfile.ZipFile(tmp_path / "clips.zip", "w") as archive:
        archive.write(KICK, "some/kick.bvh")
    run(Config(input=tmp_path / "clips.zip!some/kick.bvh", to=rig, output=tmp_path / "same.bvh"))
    assert (tmp_path / "same.bvh").read_bytes() == out.read_bytes()


def test_a_rigs_network_moves_that_rig_and_no_other(tmp_path: Path):
    clouds = write_clouds(tmp_path / "tpc")
    rig = CLIPS / "walk.bvh"
    train_skeleton(
        TrainSkeleton.model_validate(
            {
                "skeleton": str(rig), "tpc": (clouds,), "output": tmp_path / "network", "device": "cpu", "steps": 2,
                "batch": 2, "window": 8, "points": 40, "loss_points": 60, "validate_every": 2,
                "encoder": {"width": 8, "blocks": 2, "neighbours": 4, "heads": 2},
                "network": {"width": 32, "layers": 1, "heads": 2},
            }
        )
    )  # fmt: skip
    for method in ("network", "both"):
        out = tmp_path / f"{method}.bvh"
        run(Config(input=KICK, to=rig, output=out, method=method, network=tmp_path / "network", device="cpu"))
        assert read_bvh(out.read_bytes(), "out").frames == read_bvh(KICK.read_bytes(), "kick").frames
    other = tmp_path / "other.bvh"
    other.write_bytes(rig.read_bytes().replace(b"OFFSET 13.", b"OFFSET 15."))
    with pytest.raises(InputError, match="another rig"):
        run(Config(input=KICK, to=other, output=tmp_path / "o.bvh", method="network", network=tmp_path / "network"))
    with pytest.raises(ValueError, match="--network"):
        Config(input=KICK, to=rig, output=tmp_path / "o", method="network")


def _with_hip_bones(skeleton: Skeleton, motion: Motion) -> tuple[Skeleton, Motion]:
    """The same figure as Acclaim has it: each leg begins at the pelvis with a bone to the hip, which never turns."""
    for group in (3, 4):
        thigh = bones_of(skeleton, group)[0]
        hip = replace(
            skeleton,
            names=(*skeleton.names[:thigh], f"hip{group}", *skeleton.names[thigh:]),
            parents=np.insert(np.where(skeleton.parents >= thigh, skeleton.parents + 1, skeleton.parents), thigh,
                              skeleton.parents[thigh]).astype(np.int32),
            offsets=np.insert(skeleton.offsets, thigh, 0.0, axis=0),
            tails=np.insert(skeleton.tails, thigh, skeleton.offsets[thigh], axis=0),
            groups=np.insert(skeleton.groups, thigh, group).astype(np.int8),
            sampled=np.insert(skeleton.sampled, thigh, True),
            root=skeleton.root + int(skeleton.root >= thigh),
            header="",
        )  # fmt: skip
        hip.parents[thigh + 1] = thigh
        turns = motion.rotations[:, skeleton.parents[thigh]]
        skeleton, motion = hip, replace(motion, rotations=np.insert(motion.rotations, thigh, turns, axis=1))
    return skeleton, motion


def test_legs_that_begin_at_the_pelvis_tell_how_it_is_turned(kick):
    skeleton, motion = kick
    acclaim, same = _with_hip_bones(skeleton, motion)
    apart = positions_of(acclaim, same)[:, bones_of(acclaim, 3)[0]] - positions_of(acclaim, same)[:, acclaim.root]
    assert np.abs(apart).max() < 1e-5
    assert np.isfinite(retarget(skeleton, motion, acclaim, same).motion.rotations).all()
    made = retarget(acclaim, same, skeleton, motion)
    away = np.linalg.norm(positions_of(skeleton, made.motion) - positions_of(skeleton, motion), axis=-1)
    assert away.mean() < 0.03
