"""The request of `infill`: which frames the output has, which of them are keys, which are kept as their text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError, UsageError
from stages.infill.config import Config
from stages.shared.inference.keyframes import parse_keyframes, parse_transition

MOST_FRAMES = 1_000_000  # of an output: 9 hours at 30 frames a second, and 1.3 GB of memory
_ALWAYS_FRAMES = 100_000  # that any input may ask for; beyond them up to a hundred for each of its rows


@dataclass(frozen=True)
class Request:
    """Frames of the output and rows of the input.

    frames:   how many frames the output has.
    keys:     (K,) int64, strictly rising frames of the output that are given.
    key_rows: (K,) int64, the input's row of each.
    kept:     frame -> row, all frames that are copied word for word: keys, and what lies before and after them.
    notes:    what the user should know, one sentence each.
    """

    frames: int
    keys: np.ndarray
    key_rows: np.ndarray
    kept: dict[int, int]
    notes: tuple[str, ...] = ()

    @property
    def missing(self) -> np.ndarray:
        """(M,) frames to fill."""
        return np.setdiff1d(np.arange(self.keys[0], self.frames), np.fromiter(self.kept, np.int64))


def most_frames(rows: int) -> int:
    """The most frames that an output may have, for an input of `rows` rows."""
    return max(rows, min(MOST_FRAMES, max(_ALWAYS_FRAMES, 100 * rows)))


def request_of(config: Config, rows: int, fps: float) -> Request:
    """What a config asks of a file of `rows` rows at `fps` frames a second.

    Raises: UsageError where options contradict each other or nothing is to be filled; InputError where frames or
        times are not in the file.
    """
    given = [name for name in ("keyframes", "transition", "times", "frames") if getattr(config, name) is not None]
    if len(given) > 1:
        raise UsageError(f"--{given[0]} and --{given[1]} both say which frames are keys.", "Give one of them.")
    if not given and config.predict is None:
        raise UsageError("Nothing says which frames are keys.", "Give --keyframes, such as every:15 or 0,15,40.")
    added = 0 if config.predict is None else config.predict
    if config.predict is not None and added < 1:
        raise UsageError(f"--predict {added} is not a number of frames to append.", "Give 1 or more.")
    if rows + added > most_frames(rows):
        raise UsageError(
            f"--predict {added} asks for {rows + added} frames of {rows}.",
            f"Give at most {max(most_frames(rows) - rows, 0)}.",
        )
    if given and given[0] in ("times", "frames"):
        return _sparse(config, rows, fps, added)
    if config.keyframes is not None:
        keys = parse_keyframes(config.keyframes, rows)
    elif config.transition is not None:
        keys = parse_transition(config.transition, rows)
    else:
        keys = np.arange(rows)
    if added and keys[-1] != rows - 1:
        raise UsageError(
            f"--predict goes on from the last frame, {rows - 1}, but the last key is {keys[-1]}.",
            "Name the last frame among the keys, or leave --predict away.",
        )
    outside = [*range(keys[0]), *range(keys[-1], rows)]
    first, last = int(keys[0]), int(keys[-1])
    notes = (_note_outside(first, last, rows),) if first > 0 or last < rows - 1 else ()
    request = Request(rows + added, keys, keys, {int(frame): int(frame) for frame in [*outside, *keys]}, notes)
    if len(request.missing) == 0:
        raise UsageError("No frame lies between the keys, so there is nothing to fill.", "Name fewer keys.")
    return request


def _note_outside(first: int, last: int, rows: int) -> str:
    """What the user should know of rows before the first key and after the last one."""
    ranges = [(0, first - 1)] * (first > 0) + [(last + 1, rows - 1)] * (last < rows - 1)
    named = " and ".join(f"{a}-{b}" for a, b in ranges)
    return f"Rows {named} lie outside the keys and are copied unchanged. To fill them, name keys there."


def _sparse(config: Config, rows: int, fps: float, added: int) -> Request:
    """Keys alone: every row of the input is a key, at the frames or times given."""
    notes: list[str] = []
    exact = np.zeros(0)
    if config.frames is not None:
        name, keys = "--frames", _numbers(config.frames, "--frames").astype(np.int64)
    else:
        name = "--times"
        exact = _numbers(config.times or "", name) * fps
        keys = np.rint(exact).astype(np.int64)
        worst = int(np.abs(exact - keys).argmax())
        if abs(exact[worst] - keys[worst]) > 0.05:
            notes.append(
                f"Times were moved to the nearest frame; frame {keys[worst]} by "
                f"{(keys[worst] - exact[worst]) / fps * 1000:+.1f} ms."
            )
    if len(keys) != rows:
        raise InputError(f"{name} names {len(keys)} keys, but the file has {rows} rows.", "Name one for each row.")
    if config.frames is None and keys[0] >= 0 and (np.diff(exact) > 0).all() and (np.diff(keys) == 0).any():
        shared = int(np.flatnonzero(np.diff(keys) == 0)[0])
        raise InputError(
            f"At {fps:g} frames a second the times {exact[shared] / fps:g} and {exact[shared + 1] / fps:g} of {name} "
            f"fall on one frame, {keys[shared]}.",
            "Give the frame rate of the output with --fps-override.",
        )
    if keys[0] < 0 or (np.diff(keys) <= 0).any():
        raise InputError(f"{name} must rise from 0 or more, and no two keys may share a frame.", "Mend the list.")
    if keys[0] > 0:
        notes.append(f"Frames 0-{keys[0] - 1} lie before the first key and repeat its row.")
    if keys[-1] + added >= most_frames(rows):
        raise InputError(
            f"{name} asks for {keys[-1] + 1 + added} frames between {rows} keys.",
            f"Stay below frame {most_frames(rows) - added}.",
        )
    kept = {frame: 0 for frame in range(int(keys[0]))}
    kept |= {int(frame): row for row, frame in enumerate(keys)}
    request = Request(int(keys[-1]) + 1 + added, keys, np.arange(rows), kept, tuple(notes))
    if len(request.missing) == 0:
        raise UsageError("No frame lies between the keys, so there is nothing to fill.", f"Spread {name} out.")
    return request


def _numbers(text: str, option: str) -> np.ndarray:
    """Numbers joined by commas; whole ones for --frames."""
    parts = [part for part in text.replace(",", " ").split() if part]
    try:
        values = [float(int(part)) if option == "--frames" else float(part) for part in parts]
    except ValueError:
        raise UsageError(f"{option} {text!r} is not a list of numbers.", "Write for instance 0,15,40.") from None
    if not values or not np.isfinite(values).all() or max(map(abs, values)) > 10 * MOST_FRAMES:
        raise UsageError(f"{option} {text!r} is not a list of numbers.", "Write for instance 0,15,40.")
    return np.array(values)
