"""A calibrated confidence: how much of a correction to apply, per frame and body group.

A correction is multiplied by its trust, between 0 and 1. The table gives trust by the length of the gap, the body
part and the size of the gap's corrections of that part; it changes linearly from `edge` at the gap's keys to `middle`
halfway between them. `pumps weights calibrate` fits it as the factor that brings the joints of held-back motions
nearest to their true positions (least squares). Without a table, corrections are shrunk by fixed floors
(`FillOptions`).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from data_schemas.damaged_files import reading
from data_schemas.skeleton import Skeleton
from stages.shared.inference.token_times import Tokens
from stages.shared.outputs import write_output
from stages.shared.solve.solving import Corrections
from stages.shared.weights.shipped import CONFIDENCE_NAME

VERSION = 1
GAP_EDGES = (7.0, 12.0, 20.0, 32.0, 48.0)  # model frames between the keys around a gap
SIZE_EDGES = (0.02, 0.05, 0.1, 0.2)  # root mean square of a gap's corrections: radians; metres for the shift
# Parts with a trust of their own: rotations of the spine, of both arms, of both legs; and the pelvis' position.
PARTS = ("spine", "arms", "legs", "shift")
PART_OF_GROUP = np.array([0, 1, 1, 2, 2])
NODES = ("edge", "middle")
SHAPE = (len(GAP_EDGES) + 1, len(PARTS), len(SIZE_EDGES) + 1, len(NODES))


@dataclass(frozen=True)
class Confidence:
    """trust: SHAPE, by gap, part, size and position in the gap, each between 0 and 1."""

    trust: np.ndarray

    def of(self, gap: GapSizes) -> Tensor:
        """(n, parts) trust of a gap's tokens."""
        nodes = self.trust[gap.length_bin, np.arange(len(PARTS)), gap.size_bins]  # (parts, 2)
        return torch.from_numpy(nodes[None, :, 0] * (1 - gap.depth[:, None]) + nodes[None, :, 1] * gap.depth[:, None])


class GapSizes(NamedTuple):
    """The indices into the trust table: a gap's tokens, the bin of its length, the bins of each part's corrections
    (parts,), and the depth of each token in the gap (n,), 0 at a key and 1 halfway between two, or at an end without
    a key."""

    tokens: np.ndarray
    length_bin: int
    size_bins: np.ndarray
    depth: np.ndarray


def gap_sizes(tokens: Tokens, gap: np.ndarray, skeleton: Skeleton, corrections: Corrections) -> GapSizes:
    """Measure one gap, without the truth."""
    before = tokens.times[gap[0] - 1] if gap[0] > 0 else None
    after = tokens.times[gap[-1] + 1] if gap[-1] + 1 < len(tokens.times) else None
    times = tokens.times[gap]
    if before is None or after is None:  # beyond all keys: as deep as in a gap twice as long
        key = before if before is not None else after
        reach = np.abs(times - (key if key is not None else times[0]))
        length = 2 * float(reach.max()) + 1
    else:
        reach, length = np.minimum(times - before, after - times), float(after - before)
    sizes = [
        float(_root_mean_square(corrections.turns[gap][:, joints])) for joints in part_joints(skeleton, corrections)
    ]
    sizes.append(float(_root_mean_square(corrections.shifts[gap])))
    depth = np.clip(reach / max(length / 2, 1e-9), 0, 1)
    return GapSizes(gap, int(np.digitize(length, GAP_EDGES)), np.digitize(sizes, SIZE_EDGES), depth)


def part_joints(skeleton: Skeleton, corrections: Corrections) -> list[np.ndarray]:
    """For each part that rotates, its joints that are corrected."""
    seen = corrections.seen.cpu().numpy() & (skeleton.groups >= 0)
    part = PART_OF_GROUP[np.maximum(skeleton.groups, 0)]
    return [np.flatnonzero(seen & (part == number)) for number in range(len(PARTS) - 1)]


def trust_of(
    confidence: Confidence, tokens: Tokens, gap: np.ndarray, skeleton: Skeleton, corrections: Corrections
) -> tuple[Tensor, Tensor]:
    """The factors of a gap's corrections: turns (n, J) and shifts (n,), float32, on their device."""
    trust = confidence.of(gap_sizes(tokens, gap, skeleton, corrections)).to(corrections.turns)
    parts = torch.as_tensor(PART_OF_GROUP[np.maximum(skeleton.groups, 0)], device=trust.device)
    return trust[:, parts], trust[:, -1]


def _root_mean_square(values: Tensor) -> float:
    """Root mean square of vectors (..., 3); 0 if there are none."""
    return float(values.square().sum(-1).mean().sqrt()) if values.numel() else 0.0


def write_confidence(path: Path, confidence: Confidence, about: dict[str, object]) -> None:
    """Write it as JSON; `about` states what it was fitted on."""
    content = {"version": VERSION, "gap_edges": GAP_EDGES, "size_edges": SIZE_EDGES, "parts": PARTS, "nodes": NODES}
    content |= {"about": about, "trust": np.round(confidence.trust, 4).tolist()}
    write_output(path, (json.dumps(content, indent=1) + "\n").encode("utf-8"))


def read_confidence(folder: Path) -> Confidence | None:
    """The confidence beside some weights; None if there is none. Raises InputError if it is damaged."""
    path = folder / CONFIDENCE_NAME
    if not path.is_file():
        return None
    with reading(path):
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict) or content.get("version") != VERSION:
            raise ValueError("it is of another version")
        same = (list(GAP_EDGES), list(SIZE_EDGES), list(PARTS), list(NODES))
        if tuple(content.get(name) for name in ("gap_edges", "size_edges", "parts", "nodes")) != same:
            raise ValueError("its bins are others")
        trust = np.asarray(content.get("trust"), np.float64)
        if trust.shape != SHAPE or not ((trust >= 0) & (trust <= 1)).all():
            raise ValueError("its table is none of trust between 0 and 1")
    return Confidence(trust)
