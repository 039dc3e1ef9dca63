"""Windows of motion for training, drawn in batches from a `tpc` artefact that stays on the disk.

Every batch depends on (seed, step) only, so that resuming needs no generator's state.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from data_schemas.tpc import TpcReader
from stages.shared.kinematics.conventions import MIRRORED_GROUP, WHOLE_TURN
from stages.shared.kinematics.device import onto
from stages.shared.pointcloud.drawn_points import DrawnPoints
from stages.shared.pointcloud.sampling import spread_points
from stages.shared.training.borrowed_parts import with_borrowed_parts
from stages.shared.training.frame_cache import FrameCache
from stages.shared.training.proportions import with_other_proportions
from stages.shared.training.task import rows_of

_SPEED = (0.8, 1.25)  # playback speed, size: the ranges that improved a small synthesiser most on unseen skeletons
_SIZE = (0.8, 1.4)
_CPU = torch.device("cpu")
_DEVICE_SHARE = 0.3  # most of a GPU's free memory that frames may take


@dataclass
class Windows:
    """A batch of windows of bones' transforms; J is the largest skeleton's number of bones, further rows are padding.

    heads (B, T, J, 3), rotations (B, T, J, 4) global xyzw, valid (B, T), parents (B, J) int64 (-1 for the root),
    tails (B, J, 3), groups (B, J) int64, weights (B, J) (0 for bones without points and for padding). `valid` is on
    the CPU, the others are on the pool's device.
    """

    heads: Tensor
    rotations: Tensor
    valid: Tensor
    parents: Tensor
    tails: Tensor
    groups: Tensor
    weights: Tensor

    def of_rows(self, rows: Tensor) -> Windows:
        """These windows of the batch (int64, on the CPU)."""
        elsewhere = onto(rows, self.heads.device)
        parts = {name: each[elsewhere] for name, each in vars(self).items() if name != "valid"}
        return Windows(**parts, valid=self.valid[rows])


class WindowPool:
    """Draws windows of all rigid clips of some splits; the reader must stay open while the pool is in use.

    Args:
        reader: the tpc artefact.
        splits: the splits to draw from.
        balance: the probability of a data set (a clip's archive or folder) is proportional to its frames to this
            power: 1 is by frames, 0 is an equal share for each, as in the authors' code.
        cache_mb: megabytes of frames to keep in memory.
        skeletons: ids of the sets of bones whose clips are drawn; None for all.
        device: where windows are made. On a CUDA device all frames are kept there if they fit.

    Raises: InputError if no clip of the splits is rigid and long enough.
    """

    def __init__(
        self,
        reader: TpcReader,
        splits: Sequence[str],
        *,
        least_frames: int = 8,
        balance: float = 0.0,
        cache_mb: float = 256,
        device: torch.device = _CPU,
        skeletons: Collection[str] | None = None,
    ):
        # A rigid clip refers to a set of bones; a dense one has none.
        rows = [row for row in reader.clips if row.split in splits and row.frames >= least_frames and row.skeleton]
        if skeletons is not None:
            rows = [row for row in rows if row.skeleton in skeletons]
        if not rows:
            raise InputError(
                f"The tpc artefact has no rigid clip of {least_frames} frames in {', '.join(splits)}.",
                "Give longer clips, or splits that have some.",
            )
        self._load_skeletons(reader, sorted({row.skeleton for row in rows}))
        self._cache = FrameCache(reader, cache_mb)
        self.clips = [row.clip for row in rows]
        self.lengths = np.array([row.frames for row in rows])
        self.skeletons = np.array([self._order[row.skeleton] for row in rows])
        self.device = device if self._fits(device) else _CPU
        self._all_frames: Tensor | None = None
        if self.device.type != "cpu":
            self._keep_all_frames()
        self.share = _clip_shares([row.source for row in rows], self.lengths, balance)
        self._chances = np.cumsum(self.share)

    def _load_skeletons(self, reader: TpcReader, names: list[str]) -> None:
        sets = [reader.bones(name) for name in names]
        bones = max(len(each.parents) for each in sets)
        self._order = {name: index for index, name in enumerate(names)}
        self.parents = torch.full((len(sets), bones), -1, dtype=torch.long)
        self.tails = torch.zeros(len(sets), bones, 3)
        self.groups = torch.zeros(len(sets), bones, dtype=torch.long)
        self.weights = torch.zeros(len(sets), bones)
        for index, each in enumerate(sets):
            count = len(each.parents)
            self.parents[index, :count] = torch.from_numpy(np.asarray(each.parents, dtype=np.int64))
            self.tails[index, :count] = torch.from_numpy(np.asarray(each.tails, dtype=np.float32))
            self.groups[index, :count] = torch.from_numpy(np.maximum(np.asarray(each.groups, dtype=np.int64), 0))
            self.weights[index, :count] = torch.from_numpy(np.asarray(each.weights, dtype=np.float32))

    def _fits(self, device: torch.device) -> bool:
        wanted = 28 * int(self.lengths.sum()) * self.tails.shape[1]
        return device.type == "cuda" and wanted < _DEVICE_SHARE * torch.cuda.mem_get_info(device)[0]

    def _keep_all_frames(self) -> None:
        """The frames of all clips, concatenated, (F, J, 7), and each clip's first index, on the device."""
        frames = torch.zeros(int(self.lengths.sum()), self.tails.shape[1], 7)
        frames[..., 6] = 1
        self._begins = np.cumsum(self.lengths) - self.lengths
        for clip, begin, length in zip(self.clips, self._begins, self.lengths, strict=True):
            read = torch.from_numpy(self._cache.frames(clip, 0, length))
            frames[begin : begin + length, : read.shape[1]] = read
        self._all_frames = frames.to(self.device)
        for name in ("parents", "tails", "groups", "weights"):
            setattr(self, name, getattr(self, name).to(self.device))

    @property
    def kept_bytes(self) -> int:
        """Bytes of frames kept in memory."""
        return self._cache.kept_bytes

    def draw(
        self,
        batch: int,
        window: int,
        rng: np.random.Generator,
        *,
        augment: bool,
        proportions: float = 1.0,
        as_recorded: np.ndarray | None = None,
        borrowed_share: float = 0.0,
    ) -> Windows:
        """Windows of up to `window` frames at random places, each drawn from its own generator (`rows_of`).

        With `augment` the playback speed is varied and bones are scaled by factors of up to `proportions`, except in
        the windows that are `as_recorded` (B,) bool. In a fraction `borrowed_share` of the windows the arms, or all
        above the pelvis, move as in another clip of the same skeleton (`with_borrowed_parts`).
        """
        other = _other(augment, as_recorded, batch)
        chance = np.stack([row.random(3) for row in rows_of(rng, batch)])
        clips = np.minimum(np.searchsorted(self._chances, chance[:, 0], side="right"), len(self.lengths) - 1)
        speed = np.where(other, _log_uniform(_SPEED, chance[:, 1]), 1.0)
        span = np.minimum((window - 1) * speed, self.lengths[clips] - 1)
        first = chance[:, 2] * (self.lengths[clips] - 1 - span)
        windows = self._read(clips, np.where(other, first, np.floor(first)), speed, window)
        if borrowed_share > 0:
            self._borrow(windows, clips, borrowed_share, rng)
        if not (augment and proportions > 1):
            return windows
        return with_other_proportions(windows, np.where(other, proportions, 1.0), rng)

    def _borrow(self, windows: Windows, clips: np.ndarray, share: float, rng: np.random.Generator) -> None:
        """Let a share of the windows borrow parts, in place. Half of these borrow the arms alone."""
        chance = np.stack([row.random(4) for row in rows_of(rng, len(clips))])
        chosen = np.flatnonzero(chance[:, 0] < share)
        if not len(chosen):
            return
        clips, chance, frames = clips[chosen], chance[chosen], windows.heads.shape[1]
        same = self.skeletons == self.skeletons[clips, None]
        chances = np.cumsum(np.where(same, self.share, 0.0), axis=1)
        lenders = (chances <= chance[:, 1:2] * chances[:, -1:]).sum(1)
        first = np.floor(chance[:, 2] * np.maximum(self.lengths[lenders] - frames + 1, 1)).astype(np.int64)
        rows = torch.from_numpy(chosen)
        mixed = with_borrowed_parts(windows.of_rows(rows), self.at(lenders, first, frames), chance[:, 3] < 0.5)
        elsewhere = onto(rows, self.device)
        windows.heads[elsewhere], windows.rotations[elsewhere] = mixed.heads, mixed.rotations
        windows.valid[rows] = mixed.valid

    def at(self, clips: np.ndarray, first: np.ndarray, window: int) -> Windows:
        """The windows of given clips (indices) at given first frames."""
        return self._read(clips, first.astype(np.float64), np.ones(len(clips)), window)

    def _read(self, clips: np.ndarray, first: np.ndarray, speed: np.ndarray, window: int) -> Windows:
        last = self.lengths[clips, None] - 1
        wanted = first[:, None] + np.arange(window) * speed[:, None]
        valid = wanted <= last + 1e-6
        wanted = np.minimum(wanted, last)
        below = np.floor(wanted).astype(np.int64)
        above = np.minimum(below + 1, last)
        between = bool((wanted > below).any())
        share = onto(torch.from_numpy(wanted - below).float(), self.device)
        frames = self._frames_at(clips, below, above)
        (heads, next_heads), (rotations, next_rotations) = frames.split((3, 4), dim=-1)
        if between:
            heads = torch.lerp(heads, next_heads, share[..., None, None])
            rotations = torch.lerp(rotations, next_rotations, share[..., None, None])
            rotations = torch.nn.functional.normalize(rotations, dim=-1)
        kind = onto(torch.from_numpy(self.skeletons[clips]), self.device)
        return Windows(
            heads.contiguous(),
            rotations.contiguous(),
            torch.from_numpy(valid),
            self.parents[kind],
            self.tails[kind],
            self.groups[kind],
            self.weights[kind],
        )

    def _frames_at(self, clips: np.ndarray, below: np.ndarray, above: np.ndarray) -> Tensor:
        """Frames `below` and `above` (B, T) of the clips (B,): (2, B, T, J, 7)."""
        if self._all_frames is not None:
            rows = np.stack([below, above]) + self._begins[clips, None]
            return self._all_frames[onto(torch.from_numpy(rows), self.device)]
        frames = np.zeros((2, *below.shape, self.tails.shape[1], 7), np.float32)
        frames[..., 6] = 1
        for row, clip in enumerate(clips):
            start = below[row, 0]
            read = self._cache.frames(self.clips[clip], start, above[row, -1] + 1)
            frames[0, row, :, : read.shape[1]] = read[below[row] - start]
            frames[1, row, :, : read.shape[1]] = read[above[row] - start]
        return torch.from_numpy(frames)


def _clip_shares(sources: Sequence[str], lengths: np.ndarray, balance: float) -> np.ndarray:
    """Each clip's probability: its data set's share, divided within the data set in proportion to frames."""
    sets = np.array([source.split("!")[0] if "!" in source else str(Path(source).parent) for source in sources])
    share = np.zeros(len(sets))
    for name in np.unique(sets):
        inside = sets == name
        frames = lengths[inside].sum()
        share[inside] = frames**balance * lengths[inside] / frames
    return share / share.sum()


@dataclass
class CloudDraws:
    """Random draws that turn windows of transforms into clouds; a motion and its interpolation use the same draws.

    drawn: P points on each window's bones, their groups after mirroring. turn: (B, 3, 3) of yaw, mirror and size.
    shift: (B, 1, 1, 3) metres.
    """

    drawn: DrawnPoints
    turn: Tensor
    shift: Tensor

    def redrawn(self, windows: Windows, rng: np.random.Generator) -> CloudDraws:
        """Another draw of points, with the same number in each body group and the same placement."""
        same_group = (windows.groups.unsqueeze(1) == windows.groups.gather(1, self.drawn.bones).unsqueeze(2)).float()
        count = self.drawn.bones.shape[1]
        draws = [_draw_points(row, count) for row in rows_of(rng, len(self.drawn.bones))]
        chance, alphas, offsets = _stacked(draws, windows.heads.device)
        bones = _chosen(windows.weights.unsqueeze(1) * same_group, chance.unsqueeze(2)).squeeze(2)
        return replace(self, drawn=replace(self.drawn, bones=bones, alphas=alphas, offsets=offsets))


def draw_clouds(
    windows: Windows,
    points: int,
    sigma_m: tuple[float, float],
    rng: np.random.Generator,
    *,
    augment: bool,
    even: bool = False,
    as_recorded: np.ndarray | None = None,
) -> CloudDraws:
    """Draw points and a placement for each window, from its own generator (`rows_of`).

    The placement is a yaw over the whole circle and a shift of up to half a metre along each axis; with `augment`
    also mirroring and size, where windows that are `as_recorded` (B,) bool keep their size. `even` spreads points
    evenly (`spread_points`).
    """
    rows = rows_of(rng, len(windows.heads))
    device = windows.heads.device
    if even:
        start = onto(torch.tensor([row.random() for row in rows]), device)
        bones, alphas, offsets = spread_points(windows.weights, points, start)
    else:
        draws = [_draw_points(row, points) for row in rows]
        chance, alphas, offsets = _stacked(draws, device)
        bones = _chosen(windows.weights, chance)
    placing = np.stack([row.random(7) for row in rows])
    sigma = onto(torch.from_numpy(sigma_m[0] + (sigma_m[1] - sigma_m[0]) * placing[:, 0]).float(), device)
    groups = torch.gather(windows.groups, 1, bones)
    size = np.where(_other(augment, as_recorded, len(rows)), _log_uniform(_SIZE, placing[:, 1]), 1.0)
    flip = placing[:, 2] < 0.5 if augment else np.zeros(len(rows), bool)
    turn = onto(torch.from_numpy(_turns(WHOLE_TURN * placing[:, 3], size, flip)).float(), device)
    mirrored = onto(torch.tensor(MIRRORED_GROUP), device)[groups]
    groups = torch.where(onto(torch.from_numpy(flip), device).unsqueeze(1), mirrored, groups)
    shift = onto(torch.from_numpy(placing[:, 4:] - 0.5).float(), device).view(-1, 1, 1, 3)
    return CloudDraws(DrawnPoints(bones, alphas, offsets, groups, windows.tails, sigma), turn, shift)


def _other(augment: bool, as_recorded: np.ndarray | None, batch: int) -> np.ndarray:
    """(B,) bool: windows that get another speed, size and proportions than recorded."""
    return np.full(batch, augment) if as_recorded is None else augment & ~as_recorded


def _log_uniform(limits: tuple[float, float], chance: np.ndarray) -> np.ndarray:
    low, high = np.log(limits)
    return np.exp(low + (high - low) * chance)


def _stacked(draws: Sequence[tuple[np.ndarray, ...]], device: torch.device) -> list[Tensor]:
    """Stack the arrays of all windows: one tensor per array, on the device."""
    return [onto(torch.from_numpy(np.stack(part)), device) for part in zip(*draws, strict=True)]


def _draw_points(rng: np.random.Generator, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random numbers for each point's bone (P,), its place along the bone (P,) and its offset (P, 3)."""
    chance = rng.random(points)
    return chance, rng.random(points, np.float32), rng.standard_normal((points, 3), np.float32)


def _chosen(weights: Tensor, chance: Tensor) -> Tensor:
    """Indices drawn in proportion to weights (..., J), by the uniform numbers `chance` (..., P)."""
    ends = weights.double().cumsum(-1)
    total = ends[..., -1:]
    # Less than the total, so that rounding never chooses an index without weight.
    place = torch.minimum(chance * total, torch.nextafter(total, torch.zeros_like(total)))
    return torch.searchsorted(ends, place.contiguous(), right=True)


def _turns(yaw: np.ndarray, size: np.ndarray, flip: np.ndarray) -> np.ndarray:
    """(B, 3, 3): about Y by yaw, after mirroring X where `flip`, scaled by size."""
    turn = np.zeros((len(yaw), 3, 3))
    sign = np.where(flip, -1.0, 1.0)
    turn[:, 0, 0], turn[:, 0, 2] = np.cos(yaw) * sign, np.sin(yaw)
    turn[:, 2, 0], turn[:, 2, 2] = -np.sin(yaw) * sign, np.cos(yaw)
    turn[:, 1, 1] = 1.0
    return turn * size[:, None, None]


def clouds_of(heads: Tensor, rotations: Tensor, cloud: CloudDraws, centre: Tensor) -> Tensor:
    """Points (B, T, P, 3) of transforms with the draws of `cloud`; `centre` (B, 1, 1, 3) is moved to the origin."""
    placed = cloud.drawn.place(heads - centre, rotations)
    return placed @ cloud.turn.transpose(1, 2).unsqueeze(1) + cloud.shift


def known_centre(heads: Tensor, known: Tensor) -> Tensor:
    """(B, 1, 1, 3) mean position of the root (bone 0) over the known frames, the only ones that may be used."""
    weight = onto(known, heads.device).unsqueeze(-1).to(heads.dtype)
    return ((heads[:, :, 0] * weight).sum(1) / weight.sum(1).clamp_min(1)).view(-1, 1, 1, 3)
