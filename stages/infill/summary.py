"""What a fill reports to its user: warnings, what fell back to plain interpolation, how smooth the keys are."""

from __future__ import annotations

from typing import Any

import numpy as np

from data_schemas.skeleton import BODY_GROUPS, Skeleton
from stages.shared.inference.filled import Filled
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.statistics.tables import counted

STRANGE_RIG_M = 0.1  # decoded points that stray this far on their bones: the autoencoder does not know such a rig
WORST_SHOWN = 5
ROWS_SHOWN = 20
EVERY_BONE = "every bone"
UNSEEN = "no point of the cloud rides on them, or none moved surely"
UNSURE = "the points did not move surely enough"


def warnings_of(skeleton: Skeleton, filled: Filled, longest_trained_gap: int) -> list[str]:
    """Sentences on what lies outside of what the weights were trained for.

    Args:
        longest_trained_gap: in model frames (30 a second).
    """
    lines = []
    trained_s = longest_trained_gap / MODEL_FPS
    if filled.longest_gap_s > trained_s + 1e-6:
        lines.append(
            f"The longest gap is {filled.longest_gap_s:.2f} s, but these weights were trained on gaps of up to "
            f"{trained_s:.2f} s: expect less of it, or add a keyframe."
        )
    missing = [name for g, name in enumerate(BODY_GROUPS) if not (skeleton.sampled & (skeleton.groups == g)).any()]
    if missing:
        lines.append(f"The rig has no bone that was found to be {' or '.join(missing).replace('_', ' ')}.")
    if filled.wander_m > STRANGE_RIG_M:
        lines.append(
            f"The rig is strange to these weights: their points stray {filled.wander_m * 1000:.0f} mm on its bones."
        )
    return lines


def fallbacks_of(skeleton: Skeleton, plain: np.ndarray, first: int, missing: np.ndarray) -> list[dict[str, Any]]:
    """What fell back, as rows of `frames` (first and last), `bones` and `why`.

    Args:
        plain: (T, J) as `Filled.plain`. first: the output's number of frame 0 of `plain`.
        missing: (M,) frames, counted as `plain` counts, that were filled.
    """
    rows: list[dict[str, Any]] = []
    if len(missing) == 0:
        return rows
    names = np.array(skeleton.names, dtype=object)
    never = np.asarray(plain[missing].all(axis=0))
    if never.any() and not never.all():
        span = (int(missing[0]) + first, int(missing[-1]) + first)
        rows.append({"frames": span, "bones": names[never].tolist(), "why": UNSEEN})
    if never.all():
        never = np.zeros_like(never)
    # Frames that follow each other, a key between them counting as nothing, and fell back in the same bones.
    change = np.flatnonzero((plain[missing[1:]] != plain[missing[:-1]]).any(axis=1)) + 1
    for run in np.split(missing, change):
        bones = plain[run[0]] & ~never
        if bones.any():
            span = (int(run[0]) + first, int(run[-1]) + first)
            listed = [EVERY_BONE] if plain[run[0]].all() else names[bones].tolist()
            rows.append({"frames": span, "bones": listed, "why": UNSURE})
    return rows


def lines_of_fallbacks(rows: list[dict[str, Any]]) -> list[str]:
    """The rows of `fallbacks_of` as a table in plain text."""
    if not rows:
        return ["No bone fell back to plain interpolation."]
    lines = ["Fell back to plain interpolation (frames, bones, why):"]
    shown = [f"  {a}-{b}  {', '.join(row['bones'])}  ({row['why']})" for row in rows for a, b in [row["frames"]]]
    if len(shown) > ROWS_SHOWN:
        shown = [*shown[:ROWS_SHOWN], f"  and {len(shown) - ROWS_SHOWN} stretches more, all of them under --json"]
    return lines + shown


def lines_of_jumps(frames: np.ndarray, jumps: np.ndarray, plain_jumps: np.ndarray) -> list[str]:
    """Velocity jumps at keys as a table in plain text; frames in the output's numbering, metres a second."""
    if len(frames) == 0:
        return ["No key lies between two frames, so no velocity jump can be measured."]
    lines = [
        f"Velocity jump at {counted(len(frames), 'key')}, mean over the body's joints: {jumps.mean():.3f} m/s "
        f"(plain interpolation {plain_jumps.mean():.3f}). The largest (frame, m/s, plain interpolation):"
    ]
    worst = np.argsort(-jumps, kind="stable")[:WORST_SHOWN]
    return lines + [f"  {frames[row]}  {jumps[row]:.3f}  {plain_jumps[row]:.3f}" for row in worst]


def line_of_skate(filled: Filled, locked: bool) -> str:
    """How fast the feet slide while they stand, before and after."""
    if np.isnan(filled.skate_mps):
        return "No foot stands, so there is no foot skate to tell."
    before = f"plain interpolation {filled.base_skate_mps:.3f}"
    if locked:
        before += f", before the feet were held {filled.loose_skate_mps:.3f}"
    hint = "" if locked else "; --foot-lock holds them"
    return f"Foot skate while the feet stand: {filled.skate_mps:.3f} m/s ({before}{hint})."


def lines_of_pins(filled: Filled) -> list[str]:
    """How far pinned ends are from their places."""
    if not filled.pins_off_m:
        return []
    shown = ", ".join(f"{name} {off * 1000:.1f} mm" for name, off in filled.pins_off_m.items())
    return [f"Largest distances of pinned ends from their places: {shown}."]
