"""One motion refined on its own rig."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from data_schemas.errors import InputError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.concepts.body_positions import Body, body_of, body_positions
from stages.shared.concepts.posing import follow_positions
from stages.shared.concepts.sequences import LEAST_FRAMES
from stages.shared.inference.refining import ConceptModel, Refinement, check_rig, refine
from stages.shared.kinematics.resampling import resample


@dataclass(frozen=True)
class Refined:
    """A motion refined.

    motion: at its own rate. given, moved: (T, J, 3) metres at the networks' rate: the positions on the standard body
    that were refined, and by how much they moved on the rig. found: what the networks judged. body: its joints.
    """

    motion: Motion
    given: np.ndarray
    moved: np.ndarray
    found: Refinement
    body: Body

    @property
    def moved_mm(self) -> float:
        """How far the joints moved, in mm: the mean over joints and frames."""
        return float(1000 * np.linalg.norm(self.moved, axis=-1).mean())

    def anchors(self, fps: float) -> list[dict]:
        """One mapping an anchor. fps: the networks' rate; frames are counted at the motion's own rate."""
        found, apart = self.found, 1000 * np.linalg.norm(self.moved, axis=-1).mean(axis=1)
        return [
            {
                "frame": round(int(frame) * self.motion.fps / fps), "seconds": int(frame) / fps,
                "score": float(score), "flawed": bool(flaw), "concept": int(concept), "moved_mm": float(apart[frame]),
            }
            for frame, score, flaw, concept in zip(
                found.anchors, found.scores, found.flawed, found.concepts, strict=True
            )
        ]  # fmt: skip


def refined_motion(
    model: ConceptModel,
    skeleton: Skeleton,
    motion: Motion,
    action: str,
    only: str | None,
    seed: int,
    name: str,
    known: np.ndarray | None = None,
) -> Refined:
    """Refine a motion.

    Args:
        name: of the motion, for errors.
        known: (T,) bool; frames that stay, value for value. What refinement would move there is taken off between
            them too.

    Raises: UsageError for an action that was not learned; InputError for another rig, or a motion that is too short.
    """
    body = body_of(skeleton)
    check_rig(model, body, name)
    slow = resample(motion, model.fps)
    if slow.frames < LEAST_FRAMES:
        raise InputError(
            f"{name} has {slow.frames} frames at the {model.fps:g} a second that the networks read, and "
            f"{LEAST_FRAMES} are the fewest.",
            "Give a longer clip.",
        )
    given = body_positions(skeleton, slow, body) * body.scale
    found = refine(model, given, action, only=only, seed=seed)
    moved = (found.positions - given) / body.scale
    away = _at_rate(moved, model.fps, motion.frames, motion.fps)
    if known is not None:
        away = away - _between(away, np.flatnonzero(known))
    made = follow_positions(skeleton, motion, body, body_positions(skeleton, motion, body) + away)
    if known is not None:
        for to, of in zip(_arrays(made), _arrays(motion), strict=True):
            to[known] = of[known]
    return Refined(made, given, moved, found, body)


def _arrays(motion: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return motion.rotations, motion.root_positions, motion.tracks


def _between(values: np.ndarray, keys: np.ndarray) -> np.ndarray:
    """(T, ...) what stands at keys, smooth and without overshoot between them, constant beyond them."""
    at = np.arange(len(values)).clip(keys[0], keys[-1])
    return PchipInterpolator(keys, values[keys])(at) if len(keys) > 1 else values[np.repeat(keys, len(values))]


def _at_rate(moved: np.ndarray, fps: float, frames: int, target_fps: float) -> np.ndarray:
    """Displacements (T, J, 3) resampled to `frames` frames of another rate; later frames keep the last
    displacement."""
    times = np.minimum(np.arange(frames) / target_fps, (len(moved) - 1) / fps)
    return CubicSpline(np.arange(len(moved)) / fps, moved, axis=0)(times)
