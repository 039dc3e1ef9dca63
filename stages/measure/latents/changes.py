"""Changes of a window, with what should stay the same: other points, another body, another rig, another heading.

Every change gives the bones and the cloud that are encoded; the motion is the same in all but the last two kinds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from data_schemas.clips import ClipRow
from data_schemas.motion import skeleton_id
from stages.shared.humanoid.retargeting import retarget
from stages.shared.humanoid.rig_changes import RIGS, Rigged, with_other_proportions, with_stiff_spine
from stages.shared.inference.measured_clouds import MovingBones, bones_of_motion, draw_on_window, spread_on_window
from stages.shared.pointcloud.drawn_points import DrawnPoints


@dataclass(frozen=True)
class OriginalWindow:
    """A window and its cloud before any change.

    rigged: the motion on its skeleton. bones: the same as moving bones. drawn: the points drawn on them.
    """

    row: ClipRow
    start: int
    rigged: Rigged
    bones: MovingBones
    drawn: DrawnPoints

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the drawn points' offsets, metres."""
        return float(self.drawn.sigma_m)

    @property
    def points(self) -> int:
        """Number of drawn points."""
        return len(self.drawn.bones)

    def seed(self, base: int, change: int) -> np.random.Generator:
        """Generator for the draws of a change."""
        return np.random.default_rng([*self.bones.seed(base), change])


@dataclass(frozen=True)
class Encoded:
    """The encoder's input after a change: the cloud (T, P, 3), its groups (P,), and whether its points were spread
    evenly, as in filling, or drawn at random."""

    cloud: Tensor
    groups: Tensor
    spread: bool = False


@dataclass(frozen=True)
class Change:
    """A row of the table.

    kind:  what stays and what changes, in words; rows of a kind are together.
    apply: returns the encoder's input after the change; None if a window has nothing to change.
    same_cloud: whether the changed cloud is another draw of the base's cloud, so that the two can be compared.
    """

    name: str
    kind: str
    apply: Callable[[OriginalWindow, np.random.Generator], Encoded | None]
    same_cloud: bool = True


def original_window(
    row: ClipRow, start: int, rigged: Rigged, points: int, sigma_m: float, seed: int
) -> OriginalWindow:
    """The window with its first draw of points."""
    bones = bones_of_motion(row, start, rigged.skeleton, rigged.motion)
    drawn = draw_on_window(bones, points, np.random.default_rng(bones.seed(seed)), sigma_m)
    return OriginalWindow(row, start, rigged, bones, drawn)


def unchanged(original: OriginalWindow) -> Encoded:
    """The base itself."""
    return _on(original.bones, original.drawn)


def spread_evenly(original: OriginalWindow, bones: MovingBones, rng: np.random.Generator) -> Encoded:
    """Points spread evenly over some bones, with a random start."""
    return replace(_on(bones, spread_on_window(bones, original.points, rng, original.sigma_m)), spread=True)


def changes(others: Mapping[str, Rigged] | None = None) -> list[Change]:
    """All rows, in order. `others`: skeletons to put the motions on, by name, each with poses of its own."""
    counts = (("half", 0.5), ("four times", 4))
    return [
        *(Change(f"{frames} frames later", TIME, _later(frames), same_cloud=False) for frames in (1, 5)),
        Change("points redrawn", POINTS, lambda original, rng: _fresh(original, original.bones, rng)),
        Change("points spread evenly, anew", POINTS, _spread_anew),
        *(Change(f"sigma {sigma:g} m, same draw", POINTS, _sigma(sigma)) for sigma in (0.025, 0.075)),
        *(Change(f"{text} the points", POINTS, _count(factor)) for text, factor in counts),
        *(Change(f"size x {size:g}, same draw", BODY, _size(size), same_cloud=False) for size in (0.85, 1.2)),
        Change("limbs 15% longer or shorter, same draw", BODY, _proportions, same_cloud=False),
        Change("rig: all-of-these", RIG, _rig(RIGS["all-of-these"], spread=False)),
        *(Change(f"rig: {name}, spread", RIG, _rig(change, spread=True)) for name, change in RIGS.items()),
        Change("rig: stiff-spine, spread", RIG, _rig(lambda rigged, rng: with_stiff_spine(rigged), spread=True)),
        *(Change(f"retargeted to {name}, spread", RETARGETED, _retargeted(other), same_cloud=False)
          for name, other in (others or {}).items()),
        *(Change(f"turned by {degrees} degrees, same draw", TURN, _turned(degrees), same_cloud=False)
          for degrees in (15, 90, 180)),
    ]  # fmt: skip


TIME = "the motion goes on: how far latents go in time"
POINTS = "the same motion of the same body, other points"
BODY = "the same rotations on another body"
RIG = "the same motion on another rig"
RETARGETED = "the same motion on another data set's skeleton, by `pumps retarget`"
TURN = "the whole window turned about the vertical: the latent is meant to tell"


def _on(bones: MovingBones, drawn: DrawnPoints) -> Encoded:
    """The draw on these bones; it was drawn on other bones of the same number."""
    return Encoded(bones.cloud(replace(drawn, tails=bones.tails)), drawn.groups)


def _fresh(original: OriginalWindow, bones: MovingBones, rng: np.random.Generator, points: int = 0) -> Encoded:
    return _on(bones, draw_on_window(bones, points or original.points, rng, original.sigma_m))


def _spread_anew(original: OriginalWindow, rng: np.random.Generator) -> Encoded:
    return spread_evenly(original, original.bones, rng)


def _later(frames: int) -> Callable[[OriginalWindow, np.random.Generator], Encoded]:
    def apply(original: OriginalWindow, rng: np.random.Generator) -> Encoded:
        base = unchanged(original)
        kept = torch.arange(len(base.cloud)).add(frames).clamp_max(len(base.cloud) - 1)
        return replace(base, cloud=base.cloud[kept])

    return apply


def _sigma(sigma_m: float) -> Callable[[OriginalWindow, np.random.Generator], Encoded]:
    return lambda original, rng: _on(original.bones, replace(original.drawn, sigma_m=sigma_m))


def _count(factor: float) -> Callable[[OriginalWindow, np.random.Generator], Encoded]:
    return lambda original, rng: _fresh(original, original.bones, rng, max(8, round(factor * original.points)))


def _size(size: float) -> Callable[[OriginalWindow, np.random.Generator], Encoded]:
    def apply(original: OriginalWindow, rng: np.random.Generator) -> Encoded:
        bones = replace(original.bones, heads=original.bones.heads * size, tails=original.bones.tails * size)
        return _on(bones, original.drawn)

    return apply


def _proportions(original: OriginalWindow, rng: np.random.Generator) -> Encoded:
    changed = with_other_proportions(original.rigged, rng)
    bones = bones_of_motion(original.row, original.start, changed.skeleton, changed.motion)
    return _on(bones, original.drawn)


def _rig(
    change: Callable[[Rigged, np.random.Generator], Rigged], *, spread: bool
) -> Callable[[OriginalWindow, np.random.Generator], Encoded]:
    def apply(original: OriginalWindow, rng: np.random.Generator) -> Encoded:
        changed = change(original.rigged, rng)
        bones = bones_of_motion(original.row, original.start, changed.skeleton, changed.motion)
        return spread_evenly(original, bones, rng) if spread else _fresh(original, bones, rng)

    return apply


def _retargeted(other: Rigged) -> Callable[[OriginalWindow, np.random.Generator], Encoded | None]:
    """None if the motion is on that skeleton already."""

    def apply(original: OriginalWindow, rng: np.random.Generator) -> Encoded | None:
        if skeleton_id(original.rigged.skeleton) == skeleton_id(other.skeleton):
            return None
        moved = retarget(original.rigged.skeleton, original.rigged.motion, other.skeleton, other.motion).motion
        return spread_evenly(original, bones_of_motion(original.row, original.start, other.skeleton, moved), rng)

    return apply


def _turned(degrees: float) -> Callable[[OriginalWindow, np.random.Generator], Encoded]:
    def apply(original: OriginalWindow, rng: np.random.Generator) -> Encoded:
        base = unchanged(original)
        angle = np.radians(degrees)
        turn = torch.tensor(
            [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]], dtype=torch.float32
        )
        return replace(base, cloud=base.cloud @ turn.T)

    return apply
