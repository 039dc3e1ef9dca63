"""What cleaning changed: how many frames, which joints, by how much, where most."""

from __future__ import annotations

from typing import Any

import numpy as np

from data_schemas.skeleton import Skeleton
from stages.shared.inference.denoising import Denoised
from stages.shared.kinematics.runs import runs_of

_SHOWN = 6


def figures_of(skeleton: Skeleton, found: Denoised) -> dict[str, Any]:
    """What changed, for machines: counts, frames as pairs of first and last, a row for each joint that changed."""
    touched = found.changed.any(axis=1) | found.moved
    rows = []
    for joint in np.flatnonzero(found.changed.any(axis=0)):
        mine, turned = found.changed[:, joint], found.turned_deg[:, joint]
        rows.append(
            {
                "joint": skeleton.names[joint],
                "frames": int(mine.sum()),
                "noisy": int(found.noisy[:, joint].sum()),
                "mean_deg": float(turned[mine].mean()),
                "most_deg": float(turned.max()),
                "worst_frame": int(turned.argmax()),
            }
        )
    moved = found.shifted_m[found.moved]
    return {
        "frames": len(touched),
        "changed_frames": int(touched.sum()),
        "kept_frames": int((~touched).sum()),
        "noisy_frames": stretches(np.asarray(found.noisy.all(axis=1))),
        "filled_by_weights": stretches(found.filled),
        "swapped": [
            {"joint": skeleton.names[joint], "frames": stretches(found.swapped[:, joint])}
            for joint in np.flatnonzero(found.swapped.any(axis=0))
        ],
        "mean_shift_mm": float(1000 * moved.mean()) if len(moved) else 0.0,
        "most_shift_mm": float(1000 * found.shifted_m.max()),
        "joints": sorted(rows, key=lambda row: -row["mean_deg"] * row["frames"]),
    }


def lines_of(figures: dict[str, Any], found: Denoised, seconds: float) -> list[str]:
    """The same for people."""
    noisy = int(found.noisy.all(axis=1).sum())
    lines = [
        f"Changed {figures['changed_frames']} of {figures['frames']} frames in {seconds:.2f} s; the other "
        f"{figures['kept_frames']} are as they were.",
        f"Noisy or missing as a whole: {noisy} frames{_listed(figures['noisy_frames'])}.",
        f"The position moved by {figures['mean_shift_mm']:.1f} mm where it moved, at most "
        f"{figures['most_shift_mm']:.1f} mm.",
    ]
    if figures["swapped"]:
        joints = ", ".join(row["joint"] for row in figures["swapped"])
        frames = stretches(np.asarray(found.swapped.any(axis=1)))
        lines.append(f"Left and right were exchanged and are put back{_listed(frames)}: {joints}.")
    if found.filled.any():
        lines.append(
            f"Filled by the weights, as no frame was usable: {int(found.filled.sum())} frames"
            f"{_listed(figures['filled_by_weights'])}."
        )
    if figures["joints"]:
        lines.append("Joints that changed most (frames, mean and largest turn in degrees, frame of the largest):")
        lines += [
            f"  {row['joint']}  {row['frames']}  {row['mean_deg']:.2f}  {row['most_deg']:.2f}  {row['worst_frame']}"
            for row in figures["joints"][:_SHOWN]
        ]
    return lines


def stretches(chosen: np.ndarray) -> list[tuple[int, int]]:
    """First and last frame of each run of True in (T,) bool."""
    return [(int(run[0]), int(run[-1])) for run in runs_of(chosen)]


def _listed(runs: list[tuple[int, int]]) -> str:
    if not runs:
        return ""
    shown = ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in runs[:_SHOWN])
    return f" ({shown}{', ...' if len(runs) > _SHOWN else ''})"
