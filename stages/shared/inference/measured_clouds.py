"""True clouds of held-out motion, to measure an autoencoder on: windows of a `tpc` artefact and draws of points."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.tpc import ClipRow, TpcReader
from stages.shared.kinematics.forward import positions_of
from stages.shared.pointcloud.sampling import place_points, points_in_bone, spread_points
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.windows import Window, chosen_windows


@dataclass(frozen=True)
class MovingBones:
    """A window of motion as the bones that points ride on.

    row: the clip it is from. start: its first frame. heads (T, B, 3) metres, the window's mean root at the origin.
    rotations (T, B, 4) global xyzw. tails (B, 3), groups (B,) and weights (B,) as in `BoneSet`.
    """

    row: ClipRow
    start: int
    heads: Tensor
    rotations: Tensor
    tails: Tensor
    groups: np.ndarray
    weights: np.ndarray

    def seed(self, base: int) -> list[int]:
        """Seeds a generator for this window's own draws, whatever else is measured."""
        return [base, zlib.crc32(self.row.clip.encode("utf-8", "surrogateescape")), self.start]


@dataclass(frozen=True)
class DrawnCloud:
    """Points drawn on bones: bones (P,), alphas (P,) and standard normal offsets (P, 3), so that the same draw can
    be scattered wider or put on another body."""

    bones: np.ndarray
    alphas: np.ndarray
    offsets: np.ndarray

    def groups(self, window: MovingBones) -> Tensor:
        """(P,) int64 body groups."""
        return torch.from_numpy(window.groups[self.bones].astype(np.int64))

    def on(self, window: MovingBones, sigma_m: float) -> Tensor:
        """(T, P, 3) metres."""
        bones, alphas, offsets = (torch.from_numpy(part) for part in (self.bones, self.alphas, self.offsets))
        in_bone = points_in_bone(window.tails, bones, alphas, offsets, sigma_m)
        return place_points(window.heads, window.rotations, bones, in_bone)


def measured_windows(reader: TpcReader, splits: Sequence[str], frames: int, limit: int) -> list[MovingBones]:
    """Windows of `frames` frames of the rigid clips of some splits, at most `limit` (0: all that fit without overlap)
    for each archive, spread evenly over its clips. An archive of which nothing was trained on counts as held out.

    Raises: InputError where there is none.
    """
    trained = {archive_of(row) for row in reader.clips if row.split == "train"}
    held_out = {archive_of(row) for row in reader.clips} - trained if "test" in splits else set()
    by_archive: dict[str, list[list[Window]]] = {}
    for row in sorted(reader.clips, key=lambda row: (archive_of(row), row.clip)):
        wanted = row.split in splits or archive_of(row) in held_out
        if wanted and row.frames >= frames and reader.layout(row.clip) == "rigid":
            starts = np.linspace(0, row.frames - frames, row.frames // frames).astype(int)
            windows = [Window(row.clip, int(start), frames) for start in starts]
            by_archive.setdefault(archive_of(row), []).append(windows)
    chosen = [window for clips in by_archive.values() for window in chosen_windows(clips, limit)]
    if not chosen:
        raise InputError(
            f"{reader.artefact.path} has no rigid clip of {frames} frames in the split {' or '.join(splits)}.",
            "Name another split with --splits, or measure shorter windows with --window.",
        )
    return [_read(reader, window) for window in chosen]


def _read(reader: TpcReader, window: Window) -> MovingBones:
    row = reader.row(window.clip)
    bones = reader.bones(row.skeleton)
    heads, rotations = (
        torch.from_numpy(part) for part in reader.transforms(window.clip, window.start, window.start + window.frames)
    )
    return MovingBones(
        row,
        window.start,
        heads - heads[:, :1].mean(0, keepdim=True),
        rotations,
        torch.from_numpy(bones.tails),
        bones.groups,
        bones.weights,
    )


def bones_of_motion(row: ClipRow, start: int, skeleton: Skeleton, motion: Motion) -> MovingBones:
    """The same of a motion on its skeleton: every sampled bone in proportion to its length."""
    heads = torch.from_numpy(positions_of(skeleton, motion))
    lengths = np.linalg.norm(skeleton.tails, axis=-1) * (skeleton.sampled & (skeleton.groups >= 0))
    return MovingBones(
        row,
        start,
        heads - heads[:, skeleton.root : skeleton.root + 1].mean(0, keepdim=True),
        torch.from_numpy(np.asarray(motion.rotations, np.float32)),
        torch.from_numpy(np.asarray(skeleton.tails, np.float32)),
        skeleton.groups,
        lengths,
    )


def draw_cloud(window: MovingBones, points: int, rng: np.random.Generator) -> DrawnCloud:
    """Points on the window's bones, each bone in proportion to its weight."""
    share = window.weights.astype(np.float64)
    return _with_places(rng.choice(len(share), size=points, p=share / share.sum()), rng)


def spread_cloud(window: MovingBones, points: int, rng: np.random.Generator) -> DrawnCloud:
    """Points spread evenly over the window's bones (`spread_points`), from a place drawn at random."""
    weights = torch.from_numpy(np.asarray(window.weights, np.float64))
    bones, alphas, offsets = (part.numpy() for part in spread_points(weights, points, torch.tensor(rng.random())))
    return DrawnCloud(bones, alphas, offsets)


def redraw_cloud(window: MovingBones, groups: Tensor, rng: np.random.Generator) -> DrawnCloud:
    """Other points, of the body groups given (P,), on the window's bones."""
    wanted = groups.numpy()
    bones = np.empty(len(wanted), np.int64)
    for group in np.unique(wanted):
        share = np.where(window.groups == group, window.weights, 0).astype(np.float64)
        members = wanted == group
        if not share.sum() > 0:
            raise InputError(f"A skeleton of {window.row.clip} has no bone of the body group {int(group)}.")
        bones[members] = rng.choice(len(share), size=int(members.sum()), p=share / share.sum())
    return _with_places(bones, rng)


def _with_places(bones: np.ndarray, rng: np.random.Generator) -> DrawnCloud:
    alphas = rng.uniform(0, 1, len(bones)).astype(np.float32)
    return DrawnCloud(bones.astype(np.int64), alphas, rng.standard_normal((len(bones), 3)).astype(np.float32))
