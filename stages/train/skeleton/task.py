"""Training the network from clouds to a rig (PC-MRL 3.2): batches, loss, validation.

The source's cloud is scaled slightly (`size_min` to `size_max`) and never to the rig's own size. The paper compares
clouds in metres without normalising, so a short rig follows a tall dancer only as far as its size allows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from stages.shared.kinematics.conventions import MIRRORED_GROUP
from stages.shared.networks.layers.device import precision
from stages.shared.networks.pcmrl.skeleton_losses import end_bones, end_effector_loss, roll_loss, unit_quaternion_loss
from stages.shared.networks.pcmrl.skeleton_network import RigPose, SkeletonNetwork, draw_own_points
from stages.shared.pointcloud.drawn_points import DrawnPoints
from stages.shared.pointcloud.knn_loss import distances_of, nearest_trajectories, normalised_by_group, velocities
from stages.shared.pointcloud.rig import Rig
from stages.shared.training.task import RowRandom, TrainingTask, rows_of
from stages.shared.training.windows import CloudDraws, Windows, clouds_of, draw_clouds, known_centre
from stages.train.skeleton.config import Config
from stages.train.skeleton.sources import MixedPool

_HELD_BACK = 32  # windows to validate on
_SIGMA_M = 0.05  # of clouds to validate with, as in PC-MRL 4.2


@dataclass
class SourceBatch:
    """points (B, T, P, 3) metres, groups (B, P), sigma (B,), valid (B, T); heads (B, T, J, 3) of the source's bones
    in the same place; ends (B, T, 5, 3), the positions where head, hands and feet begin, and has_end (B, 5), whether
    there is one."""

    points: Tensor
    groups: Tensor
    sigma: Tensor
    valid: Tensor
    heads: Tensor
    ends: Tensor
    has_end: Tensor


class SourceDrawer:
    """Draws windows of the sources, and the clouds on them."""

    def __init__(self, config: Config, pool: MixedPool):
        self.config, self.pool = config, pool

    @property
    def drawn_points(self) -> int:
        """Points of a source's cloud; the network gets the first of them."""
        return max(self.config.points, self.config.loss_points)

    def draw(self, rng: RowRandom) -> SourceBatch:
        config = self.config
        batch = len(rng.rows)
        windows = self.pool.draw(batch, config.window, rng, augment=config.augment, proportions=config.proportions)
        sigma = (config.sigma_min_m, config.sigma_max_m)
        cloud = draw_clouds(windows, self.drawn_points, sigma, rng, augment=config.augment)
        if config.augment:
            low, high = np.log(config.size_min), np.log(config.size_max)
            size = np.exp([row.uniform(low, high) for row in rows_of(rng, batch)])
            cloud = resized(cloud, torch.from_numpy(size).float())
        return self.batch(windows, cloud)

    def batch(self, windows: Windows, cloud: CloudDraws) -> SourceBatch:
        centre = known_centre(windows.heads, windows.valid)
        points = clouds_of(windows.heads, windows.rotations, cloud, centre)
        heads = (windows.heads - centre) @ cloud.turn.transpose(1, 2).unsqueeze(1) + cloud.shift
        rows = [
            end_bones(*(part.numpy() for part in parts))
            for parts in zip(windows.parents, windows.groups, windows.tails, windows.weights, strict=True)
        ]
        ends = torch.tensor(rows)  # (B, 5), by the groups before mirroring
        flipped = torch.linalg.det(cloud.turn) < 0
        ends = torch.where(flipped.unsqueeze(1), ends[:, list(MIRRORED_GROUP)], ends)
        index = ends.clamp_min(0)[:, None, :, None].expand(-1, heads.shape[1], -1, 3)
        sigma = cloud.drawn.sigma_m * torch.linalg.det(cloud.turn).abs().pow(1 / 3)
        return SourceBatch(
            points, cloud.drawn.groups, sigma, windows.valid, heads, torch.gather(heads, 2, index), ends >= 0
        )


class SkeletonTask(TrainingTask[SkeletonNetwork]):
    """Training one rig's network."""

    def __init__(self, config: Config, rig: Rig, pool: MixedPool, held_back: MixedPool, device: torch.device):
        self.config, self.rig, self.device = config, rig, device
        self._drawer = SourceDrawer(config, pool)
        torch.manual_seed(config.seed)  # weights are drawn only here; parameters have no other generator
        self.networks = SkeletonNetwork(rig.body, config.encoder, config.network).to(device)
        body = rig.body
        self.ends = end_bones(body.parents, body.groups.numpy(), body.tails.numpy(), body.weights.numpy())
        rng = np.random.default_rng((config.seed, 7))
        windows = held_back.draw(_HELD_BACK, config.window, rng, augment=False)
        self.own = is_of_rig(windows, rig)
        cloud = draw_clouds(windows, self._drawer.drawn_points, (_SIGMA_M, _SIGMA_M), rng, augment=False)
        self.held_back = self._drawer.batch(windows, cloud)
        self.redrawn = self._drawer.batch(windows, cloud.redrawn(windows, rng))

    def drawer(self, *, elsewhere: bool = False) -> SourceDrawer:
        return self._drawer

    def splits(self) -> bool:
        return True

    def _pose(self, batch: SourceBatch) -> RigPose:
        points, groups, valid = (part.to(self.device) for part in (batch.points, batch.groups, batch.valid))
        times = torch.arange(points.shape[1], device=self.device).unsqueeze(0)
        with precision(self.device, self.config.mixed_precision):
            shown = self.config.points
            return self.networks(points[:, :, :shown], groups[:, :shown], times, valid)

    def loss(self, batch: SourceBatch, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        config, body = self.config, self.rig.body
        pose = self._pose(batch)
        own = draw_own_points(body, batch.sigma, batch.groups[:, : config.loss_points], generator)
        terms = self._cloud_terms(batch, own, pose)
        valid = batch.valid.to(self.device)
        terms["unit"] = unit_quaternion_loss(pose.raw, valid)
        if config.roll_weight:
            terms["roll"] = roll_loss(pose.rotations, body, valid)
        if config.end_weight:
            terms["end"] = self._end_distance(batch, pose)
        weights = {
            "knn": config.knn_weight,
            "back": config.back_weight,
            "velocity": config.velocity_weight,
            "shape": config.shape_weight,
            "unit": config.unit_weight,
            "roll": config.roll_weight,
            "end": config.end_weight,
        }
        loss = torch.stack([weights[name] * value for name, value in terms.items()]).sum()
        return loss, {name: value.detach() for name, value in terms.items()}

    def _end_distance(self, batch: SourceBatch, pose: RigPose) -> Tensor:
        """L_end of head, hands and feet, summed over the ends that both have, metres."""
        there = torch.tensor([end >= 0 for end in self.ends])
        ends = pose.heads[:, :, [max(end, 0) for end in self.ends]]
        pairs = (batch.has_end & there).to(self.device)
        return end_effector_loss(ends, batch.ends.to(self.device), pairs, batch.valid.to(self.device))

    def _cloud_terms(self, batch: SourceBatch, own: DrawnPoints, pose: RigPose) -> dict[str, Tensor]:
        """Distances of the source's cloud and the rig's: positions, shapes of body groups, velocities."""
        config = self.config
        source, groups, valid = (part.to(self.device) for part in (batch.points, batch.groups, batch.valid))
        made = own.place(pose.heads, pose.rotations)
        near = nearest_trajectories(source, made, groups, own.groups, valid, config.neighbours)
        terms = {"knn": near.means().mean()}
        if config.back_weight:
            terms["back"] = (
                nearest_trajectories(made, source, own.groups, groups, valid, config.neighbours).means().mean()
            )
        if config.velocity_weight:
            speed, real = velocities(source, valid)
            terms["velocity"] = distances_of(speed, velocities(made)[0], near, real).means().mean()
        if config.shape_weight:
            shapes = normalised_by_group(source, groups, valid), normalised_by_group(made, own.groups, valid)
            terms["shape"] = (
                nearest_trajectories(*shapes, groups, own.groups, valid, config.neighbours).means().mean()
            )
        return terms

    def validate(self) -> dict[str, float]:
        """Millimetres, on held-back windows at sigma 0.05: the distance of clouds (`knn_mm`, less is better), the
        same between two draws of the source (`reference_mm`), and, for windows of the rig's own skeleton, the mean
        distance of its joints (`mpjpe_mm`). `end_mm` is the mean distance of head, wrists and ankles."""
        batch = self.held_back
        generator = torch.Generator(device=self.device).manual_seed(0)
        pose = self._pose(batch)
        own = draw_own_points(self.rig.body, batch.sigma, batch.groups, generator)
        source, groups, valid = (part.to(self.device) for part in (batch.points, batch.groups, batch.valid))
        near = nearest_trajectories(source, own.place(pose.heads, pose.rotations), groups, own.groups, valid)
        other = self.redrawn
        floor = nearest_trajectories(
            source, other.points.to(self.device), groups, other.groups.to(self.device), valid
        )
        figures = {"knn_mm": 1000 * float(near.mean()), "reference_mm": 1000 * float(floor.mean())}
        figures["end_mm"] = 1000 * float(self._end_distance(batch, pose)) / max(1, sum(end >= 0 for end in self.ends))
        figures["roll"] = float(roll_loss(pose.rotations, self.rig.body, valid))
        if bool(self.own.any()):
            figures["mpjpe_mm"] = self._joint_error_mm(pose)
        return figures

    def _joint_error_mm(self, pose: RigPose) -> float:
        mine, seen = self.own.to(self.device), self.rig.body.weights > 0
        bones = pose.heads.shape[2]
        truth = self.held_back.heads[self.own][:, :, :bones].to(self.device)
        apart = (pose.heads[mine] - truth).norm(dim=-1)[..., seen].mean(-1)
        keep = self.held_back.valid[self.own].to(apart)
        return 1000 * float((apart * keep).sum() / keep.sum())


def resized(cloud: CloudDraws, size: Tensor) -> CloudDraws:
    """The same draws with windows scaled to `size` (B,), in place of the size drawn before."""
    before = torch.linalg.det(cloud.turn).abs().pow(1 / 3)
    return replace(cloud, turn=cloud.turn * (size / before).view(-1, 1, 1))


def is_of_rig(windows: Windows, rig: Rig) -> Tensor:
    """(B,) True for windows of motion of the rig's own skeleton: the same bones, to a tenth of a millimetre."""
    body, count = rig.body, len(rig.body.joints)
    if windows.parents.shape[1] < count:
        return torch.zeros(len(windows.parents), dtype=torch.bool)
    same = (windows.parents[:, :count] == torch.as_tensor(body.parents)).all(1)
    same &= ((windows.tails[:, :count] - body.tails).abs() < 1e-4).all(2).all(1)
    same &= ((windows.weights[:, :count] > 0) == (body.weights > 0)).all(1)
    return same & (windows.weights[:, count:] == 0).all(1)
