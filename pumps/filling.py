"""Filling a motion between its keyframes, and giving it to another rig."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from data_schemas.errors import UsageError
from pumps.motion import Motion

Keyframes = str | Iterable[int]


def infill(
    motion: Motion,
    keyframes: Keyframes | None = None,
    *,
    transition: tuple[int, int] | None = None,
    predict: int | None = None,
    weights: str | os.PathLike[str] | None = None,
    foot_lock: bool = True,
    points: int = 256,
    seed: int = 0,
    device: str = "auto",
) -> Motion:
    """Fill the frames between keyframes, as `pumps infill` does; frames that are neither are never read.

    Args:
        keyframes: frame numbers (a list, a range, an array), or a text such as "every:15" or "0:10,40:".
        transition: (A, B): frames A to B - 1 are missing, all others are keys.
        predict: frames to append after the last.
        weights: a shipped name (`pumps weights list`) or a folder; None for the default. They are loaded once.
        foot_lock: hold feet that stand.
        points: of the cloud. seed: of its points; the same seed gives the same motion.
        device: "auto", "cpu", "cuda" or "mps".

    Returns: the filled motion. Saved as a BVH, its key rows are those of the file, byte for byte.
    Raises: UsageError where it is not said which frames are keys; InputError for frames that are not in the motion.
    """
    from stages.infill.config import Config
    from stages.infill.row_files import row_file
    from stages.infill.run import fill_file
    from stages.shared.formats.bvh_of_motion import bvh_of_motion
    from stages.shared.formats.sources import Source
    from stages.shared.weights.shipped import default_weights

    data = motion.source or bvh_of_motion(motion.skeleton, motion.record, motion.name)
    here = Path(f"{motion.name}.bvh")
    settings = {
        "input": here,
        "output": here,
        "keyframes": _text_of(keyframes),
        "transition": None if transition is None else f"{transition[0]}:{transition[1]}",
        "predict": predict,
        "weights": os.fspath(weights or default_weights()),
        "foot_lock": foot_lock,
        "points": points,
        "seed": seed,
        "device": device,
    }
    config = Config.model_validate(settings)
    models = _models(config.weights, device)
    file = row_file(Source(here.name, "", here.name, len(data)), config, data)
    made = fill_file(file, config, models)
    skeleton, record = file.motion_in(made.data)
    return replace(motion, skeleton=skeleton, record=record, notes=made.notes, source=made.data)


def retarget(motion: Motion, to: Motion, *, points: int = 256, seed: int = 0, device: str = "auto") -> Motion:
    """Give a motion to another rig, as `pumps retarget` does; no mapping of joints is needed.

    Args:
        to: a motion of the rig: its rest pose, or one of its frames, is the pose that the two rigs share.
        points: of the cloud that draws hands and feet to their places. seed: of its points. device: as of `infill`.

    Returns: the motion on the rig's skeleton.
    Raises: InputError for a rig without a pose to start from.
    """
    from stages.retarget.config import Config
    from stages.retarget.run import retargeted
    from stages.retarget.targets import target_of_bvh
    from stages.shared.formats.bvh import read_bvh

    here = Path(f"{motion.name}.bvh")
    settings = {"input": here, "to": Path(f"{to.name}.bvh"), "output": here}
    config = Config.model_validate(settings | {"points": points, "seed": seed, "device": device})
    record, _ = retargeted(motion.skeleton, motion.record, to.skeleton, to.record, config)
    verbatim = target_of_bvh(read_bvh(to.source, to.name)).written(record)[0] if to.source else b""
    return Motion(to.skeleton, record, motion.name, licence=motion.licence, source=verbatim)


@lru_cache(maxsize=2)
def _models(weights: str, device: str) -> Any:
    from stages.shared.inference.models import load_weights

    return load_weights(weights, device)


def _text_of(keyframes: Keyframes | None) -> str | None:
    """Keyframes as the command line takes them. Raises UsageError for what is not whole numbers."""
    if keyframes is None or isinstance(keyframes, str):
        return keyframes
    frames = list(keyframes)
    if not frames or any(int(frame) != frame for frame in frames):
        raise UsageError("keyframes must be whole frame numbers.", "Give a list such as [0, 15, 40].")
    return ",".join(str(int(frame)) for frame in frames)
