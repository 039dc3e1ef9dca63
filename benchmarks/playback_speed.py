"""Fit and measure the cue for wrong frame rates on a motion artefact whose rates are right.

    python benchmarks/playback_speed.py runs/reproduce/ingest

Every clip is played at half, its own and twice its speed. The weights are fitted on the training split, each archive
counting alike; the table is of the clips held out, and below it of archives that were left out of the fit whole.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from data_schemas.motion import MotionReader
from stages.shared.kinematics.forward import positions_of
from stages.shared.kinematics.playback_speed import LONGEST_S, SUSPECT, design, speed_figures

SPEEDS = (-1.0, -0.5, 0.0, 0.5, 1.0)
MOST_OF_AN_ARCHIVE = 500


def main(folder: Path) -> None:
    figures, speeds, archives, held_out = read(folder)
    weights = fit(figures, speeds, archives, ~held_out)
    print("WEIGHTS = np.array([" + ", ".join(f"{w:.5g}" for w in weights) + "])")
    print("\n| clips | right rate | false alarms | x2 found | x0.5 found |\n|---|---|---|---|---|")
    guess = design(figures) @ weights
    for archive in [None, *sorted(set(archives))]:
        rows = held_out if archive is None else held_out & (archives == archive)
        print(row(f"held out, {archive or 'all'}", guess, speeds, rows))
    for archive in sorted(set(archives)):
        left_out = archives == archive
        guess = design(figures) @ fit(figures, speeds, archives, ~left_out)
        print(row(f"left out whole, {archive}", guess, speeds, left_out))


def read(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Figures (N, 6), log2 of the speed played at (N,), archive (N,), held out (N,)."""
    rows = []
    with MotionReader(folder) as reader:
        for archive in sorted({clip.source.split("!")[0] for clip in reader.clips}):
            clips = [clip for clip in reader.clips if clip.source.split("!")[0] == archive]
            for clip in clips[:: -(-len(clips) // MOST_OF_AN_ARCHIVE)]:
                skeleton = reader.skeleton(clip.skeleton)
                motion = reader.motion(clip.clip, 0, min(clip.frames, int(LONGEST_S * clip.fps)))
                positions = positions_of(skeleton, motion)
                for speed in SPEEDS:
                    found = speed_figures(skeleton, positions, motion.fps * 2**speed)
                    if found is not None:
                        rows.append((found, speed, Path(archive).name, clip.split != "train"))
    return tuple(np.array(column) for column in zip(*rows, strict=True))  # type: ignore[return-value]


def fit(figures: np.ndarray, speeds: np.ndarray, archives: np.ndarray, used: np.ndarray) -> np.ndarray:
    share = np.array([1 / np.sum(archives[used] == archive) for archive in archives[used]])
    rows = design(figures[used])
    gram = rows.T @ (rows * share[:, None]) + 1e-4 * share.sum() * np.eye(rows.shape[1])
    return np.linalg.solve(gram, rows.T @ (share * speeds[used]))


def row(name: str, guess: np.ndarray, speeds: np.ndarray, rows: np.ndarray) -> str:
    right, fast, slow = (rows & (speeds == speed) for speed in (0.0, 1.0, -1.0))
    shares = [np.mean(hit) for hit in (abs(guess[right]) > SUSPECT, guess[fast] > SUSPECT, guess[slow] < -SUSPECT)]
    return f"| {name} | {right.sum()} | " + " | ".join(f"{100 * share:.0f}%" for share in shares) + " |"


if __name__ == "__main__":
    given = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/reproduce/ingest")
    if (given / "manifest.json").exists():
        main(given)
    else:
        print(f"{given} is no motion artefact; make one with pumps ingest.")
