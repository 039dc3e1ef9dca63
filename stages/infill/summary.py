"""What a person is told of a fill: warnings, what fell back to plain interpolation, how smooth the keys are."""

from __future__ import annotations

from typing import Any

import numpy as np

from data_schemas.skeleton import BODY_GROUPS, Skeleton
from stages.inference.filling import Filled
from stages.kinematics.conventions import MODEL_FPS

STRANGE_RIG_M = 0.1  # decoded points that stray this far on their bones: the autoencoder does not know such a rig
WORST_SHOWN = 5
EVERY_BONE = "every bone"


def warnings_of(skeleton: Skeleton, filled: Filled, longest_trained_gap: int) -> list[str]:
    """Sentences on what lies outside of what the weights were trained for.

    Args:
        longest_trained_gap: in model frames (30 a second).
    """
    told = []
    trained_s = longest_trained_gap / MODEL_FPS
    if filled.longest_gap_s > trained_s + 1e-6:
        told.append(
            f"The longest gap is {filled.longest_gap_s:.2f} s, but these weights were trained on gaps of up to "
            f"{trained_s:.2f} s: expect less of it, or add a keyframe."
        )
    missing = [name for g, name in enumerate(BODY_GROUPS) if not (skeleton.sampled & (skeleton.groups == g)).any()]
    if missing:
        told.append(f"The rig has no bone that was found to be {' or '.join(missing).replace('_', ' ')}.")
    if filled.wander_m > STRANGE_RIG_M:
        told.append(
            f"The rig is strange to these weights: their points stray {filled.wander_m * 1000:.0f} mm on its bones."
        )
    return told


def fallbacks_of(skeleton: Skeleton, plain: np.ndarray, first: int, missing: np.ndarray) -> list[dict[str, Any]]:
    """What fell back, as rows of `frames` (first and last), `bones` and `why`.

    Args:
        plain: (T, J) as `Filled.plain`. first: the output's number of frame 0 of `plain`.
        missing: (M,) frames, counted as `plain` counts, that were filled.
    """
    rows: list[dict[str, Any]] = []
    if len(missing) == 0:
        return rows
    never = np.asarray(plain[missing].all(axis=0))
    # Bones that no point rides on are plain in every gap; a gap that was given up is plain in every bone.
    gave_up = plain[missing].all(axis=1)
    if not gave_up.all() and bool(never.any()):
        names = [name for name, one in zip(skeleton.names, never, strict=True) if one]
        span = (int(missing[0]) + first, int(missing[-1]) + first)
        rows.append({"frames": span, "bones": names, "why": "no point of the cloud rides on them"})
    given_up = missing[gave_up]
    for run in np.split(given_up, np.flatnonzero(np.diff(given_up) > 1) + 1):
        if len(run):
            span = (int(run[0]) + first, int(run[-1]) + first)
            rows.append({"frames": span, "bones": [EVERY_BONE], "why": "the points could not be followed"})
    return rows


def lines_of_fallbacks(rows: list[dict[str, Any]]) -> list[str]:
    """The rows of `fallbacks_of` as a table in plain text."""
    if not rows:
        return ["No bone fell back to plain interpolation."]
    lines = ["Fell back to plain interpolation (frames, bones, why):"]
    lines += [f"  {a}-{b}  {', '.join(row['bones'])}  ({row['why']})" for row in rows for a, b in [row["frames"]]]
    return lines


def lines_of_jumps(frames: np.ndarray, jumps: np.ndarray, plain_jumps: np.ndarray) -> list[str]:
    """Velocity jumps at keys as a table in plain text; frames in the output's numbering, metres a second."""
    if len(frames) == 0:
        return ["No key lies between two frames, so there is no velocity jump to tell."]
    lines = [
        f"Velocity jump at {len(frames)} keys, mean over the body's joints: {jumps.mean():.3f} m/s "
        f"(plain interpolation {plain_jumps.mean():.3f}). The largest (frame, m/s, plain interpolation):"
    ]
    worst = np.argsort(-jumps, kind="stable")[:WORST_SHOWN]
    return lines + [f"  {frames[row]}  {jumps[row]:.3f}  {plain_jumps[row]:.3f}" for row in worst]
