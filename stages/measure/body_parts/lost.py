"""Limbs that are lost for a while or for good, completed by the models of `infill` and by the bodies of parts.

A stretch begins with one window in which the whole body is seen. Then limbs are lost for some windows, in which the
other limbs, the spine and the pelvis' path are still known. Then one more window is seen, or the stretch ends.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
import torch
from torch import Tensor

from data_schemas.clips import ClipRow
from data_schemas.metrics import MetricRow
from data_schemas.motion import MotionReader
from data_schemas.skeleton import BODY_GROUPS, Motion, Skeleton
from stages.measure.body_parts.config import Config
from stages.shared.humanoid.clips_on_rig import frames_read, local_on_rig, skeleton_on_rig
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.constraints.fixed import Fixed
from stages.shared.inference.filling import FillOptions, fill_motion, start_from
from stages.shared.inference.models import Models
from stages.shared.inference.part_models import PartBody
from stages.shared.kinematics.foot_contacts import and_below
from stages.shared.kinematics.forward_numpy import global_rotations, local_rotations, positions_of
from stages.shared.kinematics.matrix_poses import columns_of
from stages.shared.kinematics.resampling import resampled_frames
from stages.shared.progress import Progress
from stages.shared.statistics.part_errors import joint_errors
from stages.shared.statistics.window_seeds import window_seed

SEEN_AGAIN, FOR_GOOD = "lost, seen again", "lost for good"
TRUTH, INTERPOLATED, FILLED = "truth", "plain interpolation", "infill"
HIDDEN, HELD, RECONSTRUCTED = "limbs hidden", "last latent again", "limbs seen"
LOST_METRICS = ("lost_mpjpe_180_cm", "lost_mpjae_deg", "seam_cm")
_OPTIONS = FillOptions(foot_lock=True)


@dataclass(frozen=True)
class Stretch:
    """T frames of a clip on its skeleton. local: (T, B, 4) of the body's joints, in the parents' frames.

    lost: (T,) bool. joints: the body's joints on the skeleton.
    """

    row: ClipRow
    start: int
    skeleton: Skeleton
    motion: Motion
    joints: np.ndarray
    local: np.ndarray
    lost: np.ndarray

    def until_lost(self) -> Stretch:
        """The same stretch without the frames after the lost ones."""
        end = int(np.flatnonzero(self.lost)[-1]) + 1
        return replace(self, motion=self.motion.at(slice(0, end)), local=self.local[:end], lost=self.lost[:end])


def stretches_of(reader: MotionReader, rows: Sequence[ClipRow], body: PartBody, config: Config) -> list[Stretch]:
    """Stretches that do not overlap, evenly spread over the clips; none if every clip is shorter than one."""
    window = body.window
    windows = max(1, round(config.lost_seconds * body.rate_hz / window))
    frames = (windows + 2) * window
    lost = np.zeros(frames, bool)
    lost[window:-window] = True
    places: list[tuple[ClipRow, int]] = []
    for row in rows:
        count = resampled_frames(frames_read(row, config.clip_seconds), row.fps, body.rate_hz) // frames
        places += [(row, index * frames) for index in range(count)]
    if not places:
        return []
    chosen = np.unique(np.linspace(0, len(places) - 1, config.lost_stretches).round().astype(int))
    found: list[Stretch] = []
    for row, group in groupby((places[int(place)] for place in chosen), lambda place: place[0]):
        read = reader.motion(row.clip, 0, frames_read(row, config.clip_seconds))
        made = skeleton_on_rig(reader.skeleton(row.skeleton), read, body.body, body.rate_hz)
        if made is None:
            continue
        skeleton, motion, joints = made
        local = local_on_rig(motion, joints, body.body)
        for _, start in group:
            own = slice(start, start + frames)
            found.append(Stretch(row, start, skeleton, motion.at(own), joints, local[own], lost))
    return found


def rows_of_lost(
    config: Config,
    label: str,
    bodies: Mapping[str, PartBody],
    models: Models,
    stretches: Sequence[Stretch],
    progress: Progress,
) -> Iterator[MetricRow]:
    """For each clip, method and metric the mean over stretches, of the lost limbs' joints in lost frames."""
    first = next(iter(bodies.values()))
    numbers = [BODY_GROUPS.index(group) for group in config.lost]
    limbs = np.isin(first.body.groups, numbers)
    found: dict[tuple[ClipRow, str, str, int, str], list[float]] = {}
    for stretch in stretches:
        for task, some in ((SEEN_AGAIN, stretch), (FOR_GOOD, stretch.until_lost())):
            completed = {TRUTH: _columns(some.local), **_filled(config, some, first, numbers, models)}
            for name, body in bodies.items():
                completed |= {f"{name}, {what}": made for what, made in _by_parts(body, some, numbers).items()}
            for method, made in completed.items():
                for metric, value in _measured(made, some, limbs, first).items():
                    key = (stretch.row, method, task, int(some.lost.sum()), metric)
                    found.setdefault(key, []).append(value)
        progress.advance(1, stretch.row.clip)
    for (row, method, task, frames, metric), values in found.items():
        common = (row.clip, row.skeleton, label, method, task, frames, metric)
        yield MetricRow(*common, float(np.mean(values)), windows=len(values))


def _columns(local: np.ndarray) -> Tensor:
    """(T, B, 6) of rotations (T, B, 4)."""
    return columns_of(torch.from_numpy(np.ascontiguousarray(local)))


def _measured(made: Tensor, stretch: Stretch, limbs: np.ndarray, body: PartBody) -> dict[str, float]:
    """Errors of the lost limbs' joints in the lost frames, and how far these joints move at the seams, where the lost
    frames begin and end: cm at 1.80 m with the pelvis at the origin."""
    truth, lost = _columns(stretch.local), torch.from_numpy(stretch.lost)
    whole = truth.clone()
    rows = torch.nonzero(lost).squeeze(-1)
    whole[rows[:, None], torch.from_numpy(np.flatnonzero(limbs))] = made[rows[:, None], np.flatnonzero(limbs)]
    sizes = (body.body.offsets, body.body.parents)
    errors = joint_errors(whole[rows][None], truth[rows][None], *sizes)
    seams = torch.nonzero(lost[1:] != lost[:-1]).squeeze(-1)
    steps = joint_errors(whole[seams + 1][None], whole[seams][None], *sizes)
    values = (errors.distance_cm[..., limbs], errors.global_deg[..., limbs], steps.distance_cm[..., limbs])
    return {name: float(each.mean()) for name, each in zip(LOST_METRICS, values, strict=True)}


def _filled(
    config: Config, stretch: Stretch, body: PartBody, groups: Sequence[int], models: Models
) -> dict[str, Tensor]:
    """The stretch as `infill` completes it, and the plain interpolation that it starts from."""
    skeleton, known = stretch.skeleton, ~stretch.lost
    limbs = limbs_of(skeleton, groups)
    motion = without_limbs(skeleton, stretch.motion, limbs, stretch.lost)
    pelvis = positions_of(skeleton, stretch.motion)[:, skeleton.root].astype(np.float64)
    fixed = Fixed(known[:, None] | ~limbs[None], pelvis)
    seed = window_seed(config.seed, stretch.row.clip, stretch.start)
    source, device = SynthesisedClouds(models), models.autoencoder.device
    begun = start_from(skeleton, motion, known, source, device=device, options=_OPTIONS, fixed=fixed)
    plain = begun.given.with_rows(np.flatnonzero(~known), begun.base).motion(motion.fps)
    filled = fill_motion(skeleton, motion, known, source, seed=seed, device=device, options=_OPTIONS, fixed=fixed)
    made = {INTERPOLATED: plain, FILLED: filled.motion}
    return {name: _columns(local_on_rig(each, stretch.joints, body.body)) for name, each in made.items()}


def limbs_of(skeleton: Skeleton, groups: Sequence[int]) -> np.ndarray:
    """(J,) bool: the joints of body groups, and all that hang on them."""
    own = np.flatnonzero(np.isin(skeleton.groups, groups)).tolist()
    return np.isin(np.arange(skeleton.joints), and_below(skeleton.parents, own))


def without_limbs(skeleton: Skeleton, motion: Motion, limbs: np.ndarray, lost: np.ndarray) -> Motion:
    """The motion (T frames) with local rotations of zero for the joints `limbs` (J,) in the frames `lost` (T,)."""
    local = local_rotations(motion.rotations.astype(np.float64), skeleton.parents)
    local[np.ix_(lost, limbs)] = [0, 0, 0, 1]
    return replace(motion, rotations=global_rotations(local, skeleton.parents).astype(np.float32))


def _by_parts(body: PartBody, stretch: Stretch, groups: Sequence[int]) -> dict[str, Tensor]:
    """What a body of parts decodes: with the limbs hidden; the window before the loss, repeated; and with the limbs
    seen, which gives its error without any loss."""
    truth = _columns(stretch.local)
    count = len(truth) // body.window
    windows = truth.reshape(count, body.window, *truth.shape[1:])
    hidden, seen = (
        body.decode(body.encode(given.to(body.device))).cpu()
        for given in (body.without_groups(windows, groups), windows)
    )
    again = seen[:1].expand_as(seen)  # the first window is the one before the loss
    made = {HIDDEN: hidden, HELD: again, RECONSTRUCTED: seen}
    return {name: each.reshape(truth.shape) for name, each in made.items()}
