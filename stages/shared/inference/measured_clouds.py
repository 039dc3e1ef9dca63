"""True clouds of held-out motion, for measuring an autoencoder: windows of a `tpc` artefact and draws of points."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.tpc import ClipRow, TpcReader
from stages.shared.kinematics.forward import positions_of
from stages.shared.pointcloud.drawn_points import DrawnPoints, drawn_on_bones
from stages.shared.pointcloud.sampling import draw_points, spread_points
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.window_seeds import seed_words
from stages.shared.statistics.windows import Window, chosen_windows


@dataclass(frozen=True)
class MovingBones:
    """A window of motion, as the bones that points are bound to.

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
        """Seeds a generator for this window's own draws, independent of other windows."""
        return seed_words(base, self.row.clip, self.start)

    def cloud(self, drawn: DrawnPoints) -> Tensor:
        """(T, P, 3) metres, positions of the points of a draw on these bones."""
        return drawn.place(self.heads, self.rotations)


def measured_windows(reader: TpcReader, splits: Sequence[str], frames: int, limit: int) -> list[MovingBones]:
    """Windows of `frames` frames of the rigid clips of some splits, at most `limit` (0: all that fit without overlap)
    for each archive, spread evenly over its clips. An archive without training clips counts as held out.

    Raises: InputError if there is no such window.
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
    """The same for a motion on its skeleton; every sampled bone is weighted by its length."""
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


def draw_on_window(window: MovingBones, points: int, rng: np.random.Generator, sigma_m: float) -> DrawnPoints:
    """Points on the window's bones, each bone in proportion to its weight."""
    return _on_window(window, map(torch.from_numpy, draw_points(window.weights, points, rng)), sigma_m)


def spread_on_window(window: MovingBones, points: int, rng: np.random.Generator, sigma_m: float) -> DrawnPoints:
    """Points spread evenly over the window's bones (`spread_points`), with a random start."""
    weights = torch.from_numpy(np.asarray(window.weights, np.float64))
    return _on_window(window, spread_points(weights, points, torch.tensor(rng.random())), sigma_m)


def redraw_on_window(window: MovingBones, groups: Tensor, rng: np.random.Generator, sigma_m: float) -> DrawnPoints:
    """Other points, of the body groups given (P,), on the window's bones."""
    wanted = groups.numpy()
    bones = np.empty(len(wanted), np.int64)
    for group in np.unique(wanted):
        share = np.where(window.groups == group, window.weights, 0).astype(np.float64)
        members = wanted == group
        if not share.sum() > 0:
            raise InputError(f"A skeleton of {window.row.clip} has no bone of the body group {int(group)}.")
        bones[members] = rng.choice(len(share), size=int(members.sum()), p=share / share.sum())
    alphas = rng.uniform(0, 1, len(bones)).astype(np.float32)
    offsets = rng.standard_normal((len(bones), 3)).astype(np.float32)
    return _on_window(window, map(torch.from_numpy, (bones, alphas, offsets)), sigma_m)


def _on_window(window: MovingBones, draw: Iterable[Tensor], sigma_m: float) -> DrawnPoints:
    return drawn_on_bones(draw, window.groups, window.tails, sigma_m)
