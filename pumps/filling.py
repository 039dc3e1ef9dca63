"""Filling a motion between its keyframes, and giving it to another rig."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from data_schemas.errors import UsageError
from pumps.motion import Motion
from stages.shared.threads import one_thread_if_they_spin

if TYPE_CHECKING:
    from stages.shared.inference.constraints.asked import Constraints

Frames = str | Iterable[int]
Times = str | Iterable[float]
Ranges = Mapping[str, Frames]
PathPlaces = Mapping[int, Sequence[float]] | str | os.PathLike[str]


def infill(
    motion: Motion,
    keyframes: Frames | Mapping[str, Frames] | None = None,
    *,
    transition: str | tuple[int, int] | None = None,
    predict: int | None = None,
    frames: Frames | None = None,
    times: Times | None = None,
    keep: Ranges | None = None,
    pins: Ranges | None = None,
    path: PathPlaces | None = None,
    lock: Ranges | None = None,
    constraints: Mapping[str, Any] | str | os.PathLike[str] | None = None,
    weights: str | os.PathLike[str] | None = None,
    foot_lock: bool = True,
    points: int = 256,
    seed: int = 0,
    device: str = "auto",
) -> Motion:
    """Fill the frames between keyframes, as `pumps infill` does; frames that are neither are never read.

    Args:
        keyframes: frame numbers (a list, a range, an array), or a text such as "every:15" or "0:10,40:"; or a
            dictionary from parts of the body to these, where "" stands for the whole body.
        transition: (A, B), or "A:B": frames A to B - 1 are missing, all others are keys.
        predict: frames to append after the last.
        frames: where the motion holds the keys alone, the frame of the result that each of its frames becomes.
        times: the same in seconds.
        keep: part of the body, or joint -> frames in which it keeps what the motion holds: "all", or as `keyframes`.
        pins: end effector ("right_hand", ...) -> frames in which it stays at its place in the world.
        path: frame -> (x, z) or (x, y, z) of the pelvis, metres, Y up; or the name of a CSV of them.
        lock: part of the body, or joint -> frames in which only keyframes turn it.
        constraints: all of these as a dictionary, or the name of a JSON file (docs/formats.md).
        weights: a shipped name (`pumps weights list`) or a folder; None for the default. They stay loaded.
        foot_lock: hold feet that stand.
        points: of the cloud. seed: of its points; the same seed gives the same motion.
        device: "auto", "cpu", "cuda" or "mps".

    Returns: the filled motion. Saved as a BVH, its key rows, and what else is kept, are those of the file, byte for
        byte.
    Raises:
        UsageError: nothing says which frames are keys, or two arguments do.
        InputError: frames are not in the motion, constraints contradict each other, or the weights are not there.
    """
    return infill_samples(
        motion, 1, keyframes, transition=transition, predict=predict, frames=frames, times=times, keep=keep,
        pins=pins, path=path, lock=lock, constraints=constraints, weights=weights, foot_lock=foot_lock,
        points=points, seed=seed, device=device,
    )[0]  # fmt: skip


@one_thread_if_they_spin()
def infill_samples(
    motion: Motion,
    samples: int,
    keyframes: Frames | Mapping[str, Frames] | None = None,
    *,
    transition: str | tuple[int, int] | None = None,
    predict: int | None = None,
    frames: Frames | None = None,
    times: Times | None = None,
    keep: Ranges | None = None,
    pins: Ranges | None = None,
    path: PathPlaces | None = None,
    lock: Ranges | None = None,
    constraints: Mapping[str, Any] | str | os.PathLike[str] | None = None,
    weights: str | os.PathLike[str] | None = None,
    foot_lock: bool = True,
    points: int = 256,
    seed: int = 0,
    device: str = "auto",
) -> list[Motion]:
    """Different plausible fills of the same gaps, as `pumps infill --samples` makes them.

    Args:
        samples: how many, 1 or more. The others are as of `infill`.

    Returns: the fill that `infill` returns first, then the others. All have the same key rows.
    Raises:
        UsageError: as `infill`.
        InputError: as `infill`, and for weights that do not hold how motions vary.
    """
    from stages.infill.config import Config
    from stages.infill.fillers import filler_of
    from stages.infill.row_files import row_file
    from stages.infill.run import fill_files
    from stages.shared.formats.bvh_of_motion import bvh_of_motion
    from stages.shared.formats.sources import Source
    from stages.shared.settings.layers import Layer, settle
    from stages.shared.weights.shipped import default_weights

    data = motion.source or bvh_of_motion(motion.skeleton, motion.record, motion.name)
    here = Path(f"{motion.name}.bvh")
    settings = {
        "input": here,
        "output": here,
        "keyframes": _keyframes_of(keyframes),
        "keep": _texts_of("keep", keep),
        "pin": _texts_of("pins", pins),
        "path": path if isinstance(path, (str, os.PathLike)) else None,
        "lock": _texts_of("lock", lock),
        "constraints": constraints if isinstance(constraints, (str, os.PathLike)) else None,
        "transition": _range_of(transition),
        "predict": predict,
        "frames": _text_of("frames", frames),
        "times": _text_of("times", times, whole=False),
        "up_axis": motion.skeleton.up_axis if motion.up_axis else None,  # of the BVH that is filled
        "weights": os.fspath(weights or default_weights()),
        "samples": samples,
        "foot_lock": foot_lock,
        "points": points,
        "seed": seed,
        "device": device,
    }
    config = settle(Config, [Layer("arguments", settings)], what="pumps infill")
    filler = filler_of(config)
    file = row_file(Source(here.name, "", here.name, len(data)), config, data)
    fills = []
    for made in fill_files(file, config, filler, _constraints_of(path, constraints)):
        skeleton, record = file.motion_in(made.data)
        fills.append(replace(motion, skeleton=skeleton, record=record, notes=made.notes, source=made.data))
    return fills


@one_thread_if_they_spin()
def retarget(motion: Motion, to: Motion, *, points: int = 256, seed: int = 0, device: str = "auto") -> Motion:
    """Give a motion to another rig, as `pumps retarget` does; no mapping of joints is needed.

    Args:
        to: a motion of the rig: its rest pose, or one of its frames, is the pose that the two rigs share.
        points: of the cloud that draws hands and feet to their places. seed: of its points. device: as of `infill`.

    Returns: the motion on the rig's skeleton.
    Raises:
        InputError: a rig has no pose to start from.
        UsageError: the settings are not possible.
    """
    from stages.retarget.config import Config
    from stages.retarget.run import retargeted
    from stages.retarget.targets import target_of_bvh
    from stages.shared.formats.bvh import read_bvh
    from stages.shared.settings.layers import Layer, settle

    here = Path(f"{motion.name}.bvh")
    settings = {"input": here, "to": Path(f"{to.name}.bvh"), "output": here}
    settings |= {"points": points, "seed": seed, "device": device}
    config = settle(Config, [Layer("arguments", settings)], what="pumps retarget")
    record, _ = retargeted(motion.skeleton, motion.record, to.skeleton, to.record, config)
    verbatim = target_of_bvh(read_bvh(to.source, to.name)).written(record)[0] if to.source else b""
    return Motion(to.skeleton, record, motion.name, licence=motion.licence, source=verbatim)


def _text_of(name: str, numbers: str | Iterable[float] | None, *, whole: bool = True) -> str | None:
    """Numbers as the command line takes them. Raises UsageError for what is not a list of (whole) numbers."""
    if numbers is None or isinstance(numbers, str):
        return numbers
    kind = "whole frame numbers" if whole else "numbers of seconds"
    example = "[0, 15, 40]" if whole else "[0, 0.5, 1.25]"
    values = np.asarray(list(numbers) if isinstance(numbers, Iterable) else numbers)
    if values.dtype == bool:
        raise UsageError(f"{name} must be {kind}, not a mask.", "Give numpy.flatnonzero(mask).")
    if values.ndim != 1 or values.size == 0 or values.dtype.kind not in "iuf" or not np.isfinite(values).all():
        raise UsageError(f"{name} must be a list of {kind}.", f"Give one such as {example}.")
    if whole and (values != np.floor(values)).any():
        raise UsageError(f"{name} must be {kind}.", f"Give a list such as {example}.")
    return ",".join(str(int(value)) if whole else repr(float(value)) for value in values)


def _keyframes_of(keyframes: Frames | Mapping[str, Frames] | None) -> str | None:
    """Keyframes as the command line takes them."""
    if not isinstance(keyframes, Mapping):
        return _text_of("keyframes", keyframes)
    texts = [(part, _text_of("keyframes", frames)) for part, frames in keyframes.items()]
    return ";".join(f"{part}={text}" if part else f"{text}" for part, text in texts)


def _texts_of(name: str, ranges: Ranges | None) -> tuple[str, ...]:
    """{"legs": "all"} as the command line takes it. Raises UsageError for another type."""
    if ranges is None:
        return ()
    if not isinstance(ranges, Mapping):
        raise UsageError(f"{name} must say frames for each part.", 'Give one such as {"legs": "all"}.')
    return tuple(f"{part}:{_text_of(name, frames)}" for part, frames in ranges.items())


def _constraints_of(
    path: PathPlaces | None, constraints: Mapping[str, Any] | str | os.PathLike[str] | None
) -> Constraints:
    """Constraints that are given as values, not as names of files."""
    from stages.shared.inference.constraints.asked import Constraints
    from stages.shared.inference.constraints.constraint_files import constraints_of, path_of

    asked = Constraints()
    if path is not None and not isinstance(path, (str, os.PathLike)):
        rows = sorted((int(frame), [float(value) for value in place]) for frame, place in path.items())
        frames, places = [row[0] for row in rows], [row[1] for row in rows]
        asked = Constraints(path=path_of({"frames": frames, "places": places}, "path"))
    if constraints is not None and not isinstance(constraints, (str, os.PathLike)):
        asked = asked.joined(constraints_of(dict(constraints)))
    return asked


def _range_of(transition: str | tuple[int, int] | None) -> str | None:
    """(30, 60) as the command line takes it. Raises UsageError for what is not two whole numbers."""
    if transition is None or isinstance(transition, str):
        return transition
    bounds = (_text_of("transition", transition) or "").split(",")
    if len(bounds) != 2:
        raise UsageError("transition must be two frame numbers.", "Give (30, 60) for a gap of frames 30 to 59.")
    return ":".join(bounds)
