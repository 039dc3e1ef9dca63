"""Frames of which some parts are given: what filling does differently for the joints that have keys of their own.

Joints that are given in the same frames are treated together (`Alike`). Their plain interpolation runs through their
own keys, the models' corrections of them vanish in their own keys, and so do the velocities that easing lends. The
pelvis' place is treated likewise on each axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from stages.shared.inference.constraints.fixed import Fixed
from stages.shared.inference.easing import ease_at_keys
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.plain_interpolation import Glide, damped_smoothness, interpolate_values
from stages.shared.solve.skeleton_pose import SkeletonPose

STIFF = 1e8  # precision, 1 / radians^2, of joints that are given in all frames: the solve does not turn them


@dataclass(frozen=True)
class Alike:
    """Joints (n,) that are given in the same frames (T,), bool: whole keys, and others."""

    joints: np.ndarray
    given: np.ndarray


@dataclass(frozen=True)
class PartlyKnown:
    """What is given of T frames beside whole keys.

    known: (T,) bool, whole keys. alike: joints with more keys than these, by their keys.
    pelvis: (T, 3) metres, NaN where it is free; given in whole keys.
    """

    known: np.ndarray
    alike: tuple[Alike, ...]
    pelvis: np.ndarray

    @classmethod
    def of(cls, fixed: Fixed, known: np.ndarray, given: SkeletonPose) -> PartlyKnown:
        """Of what is fixed in a pose of T frames."""
        joints = fixed.joints | known[:, None]
        kinds: dict[bytes, list[int]] = {}
        for joint in range(joints.shape[1]):
            kinds.setdefault(joints[:, joint].tobytes(), []).append(joint)
        alike = tuple(
            Alike(np.array(members), joints[:, members[0]])
            for members in kinds.values()
            if (joints[:, members[0]] & ~known).any()
        )
        pelvis = fixed.pelvis.copy()
        keys = np.flatnonzero(known)
        pelvis[keys] = given.rows(keys).heads[:, given.skeleton.root].double().cpu().numpy()
        return cls(known, alike, pelvis)

    @property
    def stiff(self) -> np.ndarray:
        """Joints that are given in every frame."""
        return np.concatenate([np.zeros(0, np.int64), *(kind.joints for kind in self.alike if kind.given.all())])

    def bases(
        self, keys: SkeletonPose, given: SkeletonPose, fps: float, glide: Glide | None, *times: Tensor
    ) -> list[SkeletonPose]:
        """The plain interpolation at each of some lists of times (M,) in model frames.

        Args:
            keys: the K whole keys. given: all T frames, of which only what is given is read.
        """
        everywhere = torch.arange(len(self.known), device=keys.heads.device).double() * (MODEL_FPS / fps)
        key_times = everywhere[np.flatnonzero(self.known)]
        smooth = damped_smoothness(key_times, MODEL_FPS)

        def by_part(at: Tensor) -> SkeletonPose:
            return self._by_part(keys.at(key_times, at, smooth, glide), given, fps, glide, at)

        away = self.pelvis - by_part(everywhere).heads[:, given.skeleton.root].double().cpu().numpy()
        away[self.known] = 0.0
        made = []
        for at in times:
            base = by_part(at)
            shifts = self._along_axes(away, ~np.isnan(away), fps, at)
            made.append(base.corrected(base.heads.new_zeros(base.heads.shape), shifts))
        return made

    def _by_part(
        self, base: SkeletonPose, given: SkeletonPose, fps: float, glide: Glide | None, times: Tensor
    ) -> SkeletonPose:
        """The interpolation of whole keys, with the joints that have more keys going through all of theirs."""
        local, offsets = base.local.clone(), base.offsets.clone()
        for kind in self.alike:
            keys = np.flatnonzero(kind.given)
            key_times = torch.as_tensor(keys * (MODEL_FPS / fps), device=times.device)
            own = given.rows(keys).by_local().to(times.device)
            made = own.at(key_times, times, damped_smoothness(key_times, MODEL_FPS), glide)
            local[:, kind.joints] = made.local[:, kind.joints]
            if base.moves:  # the pelvis' place is brought to its own keys afterwards
                offsets[:, kind.joints] = made.offsets[:, kind.joints]
        return base.with_local(local, base.roots, offsets)

    def without(self, turns: Tensor, shifts: Tensor, fps: float) -> tuple[Tensor, Tensor]:
        """Corrections that vanish where parts are given: their values there are interpolated over the frames between,
        and subtracted.

        Args:
            turns: (M, J, 3) of the M frames that are not known. shifts: (M, 3) of the same frames.
        """
        gaps = np.flatnonzero(~self.known)
        times = torch.as_tensor(gaps * (MODEL_FPS / fps), device=turns.device)
        pelvis = ~np.isnan(self.pelvis)
        turns, shifts = turns.clone(), shifts.clone()
        columns = [(turns, kind.joints, kind.given) for kind in self.alike]
        columns += [(shifts, np.array([axis]), pelvis[:, axis]) for axis in range(3)]
        for values, own, given in columns:
            there = np.flatnonzero(given[gaps])
            if not len(there):
                continue
            keys = np.flatnonzero(given)
            at_keys = values.new_zeros(len(keys), *values[:, own].shape[1:])
            at_keys[torch.as_tensor(np.isin(keys, gaps))] = values[there][:, own]
            key_times = torch.as_tensor(keys * (MODEL_FPS / fps), device=turns.device)
            left = values[:, own] - interpolate_values(at_keys, key_times, times, smooth=1.0)
            left[there] = 0.0
            values[:, own] = left
        return turns, shifts

    def eased(self, pose: SkeletonPose, fps: float, ease_s: float) -> SkeletonPose:
        """As `ease_at_keys`, each joint at its own keys; the pelvis' place as far as it is free."""
        whole = ease_at_keys(pose, self.known, fps, ease_s)
        local, offsets = whole.local.clone(), whole.offsets
        for kind in self.alike:
            own = ease_at_keys(pose, kind.given, fps, ease_s)
            local[:, kind.joints] = own.local[:, kind.joints]
            if pose.moves:
                offsets = offsets.clone()
                offsets[:, kind.joints] = own.offsets[:, kind.joints]
        gaps = np.flatnonzero(~self.known)
        made = pose.with_local(local, whole.roots, offsets)
        # Where the pelvis' place is given, what easing moved it by is taken off again.
        root = pose.skeleton.root
        moved = (pose.heads - made.heads)[:, root]
        back = torch.where(torch.as_tensor(~np.isnan(self.pelvis)), moved, 0.0)
        made = made.corrected(torch.zeros_like(made.heads), back)
        return pose.with_rows(gaps, made.rows(gaps))

    def _along_axes(self, values: np.ndarray, given: np.ndarray, fps: float, times: Tensor) -> Tensor:
        """(M, 3) values (T, 3) of given frames at times in model frames, each axis through its own frames."""
        columns = []
        for axis in range(3):
            keys = np.flatnonzero(given[:, axis])
            own = torch.as_tensor(values[keys, axis], dtype=torch.float32, device=times.device)
            key_times = torch.as_tensor(keys * (MODEL_FPS / fps), device=times.device)
            columns.append(interpolate_values(own, key_times, times, smooth=1.0))
        return torch.stack(columns, -1)
