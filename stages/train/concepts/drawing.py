"""Batches of windows of segmented clips, with what each network of motion concepts learns from them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from torch import Tensor

from stages.shared.concepts.sequences import ConceptSet, SegmentedSequence, placing_of, segment_arrays
from stages.shared.networks.concepts.refiners import Segments
from stages.shared.training.task import RowRandom


@dataclass(frozen=True)
class ConceptBatch:
    """B windows of T frames, F = 3 J features in metres.

    motion: (B, T, F). restored: (B, T, F) from the fitted splines. valid, anchors: (B, T) bool. action: (B,).
    at: (B,) the anchor that is masked. seen: (B, T) False for it and the transitions beside it. concept: (B,), -1
    where it is not known. of_frame, times (B, T), first, last (B, S): the transitions.
    start, end: (B, F) anchors of one transition, relative to the first; seconds: (B,); between: (B, L, F), padded;
    counts: (B,) its real frames.
    """

    motion: Tensor
    restored: Tensor
    valid: Tensor
    anchors: Tensor
    action: Tensor
    at: Tensor
    seen: Tensor
    concept: Tensor
    of_frame: Tensor
    times: Tensor
    first: Tensor
    last: Tensor
    start: Tensor
    end: Tensor
    seconds: Tensor
    between: Tensor
    counts: Tensor

    @property
    def segments(self) -> Segments:
        return Segments(self.of_frame, self.times, self.first, self.last)

    def to(self, device: torch.device) -> ConceptBatch:
        return ConceptBatch(**{each.name: getattr(self, each.name).to(device) for each in fields(self)})


class ConceptDrawer:
    """Draws windows: an action, then a clip of it, then a place in the clip and one of its anchors."""

    def __init__(self, found: ConceptSet, sequences: list[SegmentedSequence], window: int):
        self.found, self.window = found, window
        by_action: dict[int, list[SegmentedSequence]] = {}
        for each in sequences:
            by_action.setdefault(each.action, []).append(each)
        self.by_action = [by_action[action] for action in sorted(by_action)]

    def draw(self, rng: RowRandom) -> ConceptBatch:
        rows = [self._row(row) for row in rng.rows]
        most = max(len(row["first"]) for row in rows)
        longest = max(len(row["between"]) for row in rows)
        for row in rows:
            for name, size in (("first", most), ("last", most), ("between", longest)):
                array = row[name]
                row[name] = np.concatenate([array, np.zeros((size - len(array), *array.shape[1:]), array.dtype)])
        stacked = {name: torch.from_numpy(np.stack([row[name] for row in rows])) for name in rows[0]}
        return ConceptBatch(
            **{name: each.float() if each.is_floating_point() else each for name, each in stacked.items()}
        )

    def _row(self, rng: np.random.Generator) -> dict[str, Any]:
        clips = self.by_action[rng.integers(len(self.by_action))]
        clip = clips[rng.integers(len(clips))]
        size = min(self.window, len(clip.positions))
        start = int(rng.integers(len(clip.positions) - size + 1))
        part = slice(start, start + size)
        positions = clip.positions[part].astype(np.float64)
        placing = placing_of(positions, self.found.body.groups)
        inside = (clip.anchors > start) & (clip.anchors < start + size - 1)
        anchors = np.concatenate([[0], clip.anchors[inside] - start, [size - 1]])
        known = dict(zip((clip.anchors - start).tolist(), clip.concepts.tolist(), strict=True))
        chosen = int(rng.integers(len(anchors)))
        before, after = anchors[max(chosen - 1, 0)], anchors[min(chosen + 1, len(anchors) - 1)]
        seen, valid, marks = (np.zeros(self.window, bool) for _ in range(3))
        valid[:size] = seen[:size] = True
        seen[before + (chosen > 0) : after + (chosen == len(anchors) - 1)] = False
        marks[anchors] = True
        if not seen.any():
            seen[before if chosen else after] = True
        segments = segment_arrays(anchors, size)
        flat = (self.window, 3 * positions.shape[1])
        return {
            "motion": _padded(placing.put(positions).reshape(size, -1), flat),
            "restored": _padded(placing.put(clip.restored[part].astype(np.float64)).reshape(size, -1), flat),
            "valid": valid, "anchors": marks, "action": np.int64(clip.action), "at": np.int64(anchors[chosen]),
            "seen": seen, "concept": np.int64(known.get(int(anchors[chosen]), -1)),
            "of_frame": _padded(segments.of_frame, (self.window,)), "times": _padded(segments.times, (self.window,)),
            "first": segments.first, "last": segments.last, **self._transition(clip, rng),
        }  # fmt: skip

    def _transition(self, clip: SegmentedSequence, rng: np.random.Generator) -> dict[str, Any]:
        chosen = int(rng.integers(len(clip.anchors) - 1))
        first, last = int(clip.anchors[chosen]), int(clip.anchors[chosen + 1])
        frames = clip.positions[first : last + 1].astype(np.float64)
        flat = placing_of(frames, self.found.body.groups).put(frames).reshape(len(frames), -1)
        return {
            "start": flat[0], "end": flat[-1], "seconds": np.float32((last - first) / self.found.fps),
            "between": flat, "counts": np.int64(len(flat)),
        }  # fmt: skip


def _padded(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    out = np.zeros(shape, values.dtype)
    out[: len(values)] = values
    return out
