"""What the page's buttons do: each is a stage of pumps with its settings, so that a command line repeats it."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from data_schemas.errors import InputError, UsageError
from stages.registry import stage_named
from stages.shared.inference.constraints.asked import Constraints, PartFrames
from stages.shared.inference.constraints.frame_ranges import parse_frames
from stages.studio.session import FillSettings, MotionRecord, Session

FILL = "infill"
_FILLING = ("weights", "seed", "foot_lock", "sample", "device")  # settings that the studio chooses for fills


@dataclass(frozen=True)
class Verb:
    """A button that changes the whole motion.

    stage: what it runs. options: settings that the page may give. other: the setting that a second motion is given
    to. fills: whether the stage takes the weights that the page chose.
    """

    stage: str
    options: tuple[str, ...] = ()
    other: str = ""
    fills: bool = False


VERBS = {
    "trim": Verb("edit-trim", ("frames",)),
    "mirror": Verb("edit-mirror"),
    "smooth": Verb("edit-smooth", ("seconds",)),
    "loop": Verb("edit-loop", ("blend",), fills=True),
    "join": Verb("edit-join", ("blend",), other="then", fills=True),
    "denoise": Verb("denoise", ("strength",)),
    "retarget": Verb("retarget", other="to"),
}


def fill_options(settings: FillSettings, device: str) -> dict[str, Any]:
    """Settings of `pumps infill` beside files and constraints, without those that have their default."""
    given = {
        "weights": settings.weights, "seed": settings.seed, "foot_lock": settings.foot_lock, "device": device,
    }  # fmt: skip
    return _without_defaults(FILL, given)


def verb_options(name: str, asked: Mapping[str, Any], settings: FillSettings, device: str) -> dict[str, Any]:
    """What a verb's stage is given beside files. Raises UsageError for another verb, setting or type."""
    if name not in VERBS:
        raise UsageError(f"The studio has no button {name!r}.")
    verb = VERBS[name]
    for key, value in asked.items():
        if key not in verb.options or not isinstance(value, (int, float, str)):
            raise UsageError(f"{name} takes no setting {key!r}.")
    filling = {"weights": settings.weights, "seed": settings.seed} if verb.fills else {}
    where = {"device": device} if "device" in stage_named(verb.stage).config_type().model_fields else {}
    return _without_defaults(verb.stage, {**filling, **asked, **where})


def constraints_bytes(constraints: Constraints) -> bytes:
    """The file that `pumps infill --constraints` reads."""
    plain = constraints.model_dump(mode="json", exclude_defaults=True)
    return (json.dumps({"version": 1, **plain}, indent=1) + "\n").encode()


def settings_after(name: str, options: Mapping[str, Any], settings: FillSettings, frames: int) -> FillSettings:
    """The settings for what a verb made of a motion of T frames.

    Keyframes stay with their poses: after `trim` they have other numbers, and after all others the same. Of the other
    constraints, those that name places or sides are dropped by verbs that move the body or exchange its sides.
    """
    asked = settings.constraints
    if name == "trim":
        asked = _trimmed(asked, str(options.get("frames", ":")), frames)
    elif name == "mirror":
        asked = Constraints(keyframes=asked.keyframes)
    elif name == "retarget":
        asked = asked.model_copy(update={"pins": (), "path": None})
    return settings.model_copy(update={"constraints": asked})


def _trimmed(asked: Constraints, text: str, frames: int) -> Constraints:
    first, stop, _ = slice(*(int(part) if part.strip() else None for part in text.split(":"))).indices(frames)

    def moved(named: str, what: str) -> str | None:
        at = parse_frames(named, frames, what)
        return ",".join(map(str, (at[(at >= first) & (at < stop)] - first).tolist())) or None

    def parts(named: tuple[PartFrames, ...], what: str) -> tuple[PartFrames, ...]:
        found = ((each.part, moved(each.frames, what)) for each in named)
        return tuple(PartFrames(part=part, frames=at) for part, at in found if at)

    return Constraints(
        keyframes=moved(asked.keyframes, "keyframes") if asked.keyframes else None,
        parts=parts(asked.parts, "keyframes"), keep=parts(asked.keep, "keep"), locks=parts(asked.locks, "lock"),
    )  # fmt: skip


def first_keys(frames: int, fps: float) -> str:
    """Keyframes for a motion that was just opened: one each half second, and its last frame."""
    step = max(round(fps / 2), 1)
    return ",".join(map(str, np.unique([*range(0, frames, step), frames - 1]).tolist()))


def steps_to(session: Session, motion: str) -> list[str]:
    """The motions that a motion was made from, itself included, each after those that it was made from."""
    order: list[str] = []

    def visit(name: str) -> None:
        if name and name not in order:
            record = session.record(name)
            visit(record.source)
            visit(record.other)
            order.append(name)

    visit(motion)
    return order


def command_line(record: MotionRecord, source: str, output: str, other: str = "", constraints: str = "") -> str:
    """The line for a shell that makes a motion again from the files named.

    Raises: InputError for a stage or an option that the studio does not use: a session that another person wrote
        could name an output, and replace a file where its command is run.
    """
    verb = next((each for each in VERBS.values() if each.stage == record.stage), None)
    known = {*_FILLING, *(verb.options if verb is not None else ())}
    if (verb is None and record.stage != FILL) or not record.options.keys() <= known:
        raise InputError(
            "The session is damaged: it holds a step that the studio does not take.", "Open the file again."
        )
    stage = stage_named(record.stage)
    source, other = as_argument(source), as_argument(other)
    words: list[str] = ["pumps", *stage.command, source]
    if other and verb is not None:
        words += [other] if verb.other in stage.arguments else [f"--{verb.other}", other]
    if constraints:
        words += ["--constraints", constraints]
    for name, value in record.options.items():
        flag = name.replace("_", "-")
        words += [f"--{'' if value else 'no-'}{flag}"] if isinstance(value, bool) else [f"--{flag}={value}"]
    return shlex.join([*words, "-o", output])


def as_argument(name: str) -> str:
    """A file's name that no command takes for an option."""
    return f"./{name}" if name.startswith("-") else name


def _without_defaults(stage: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Settings that differ from those that the stage has by itself, so that its command line is short."""
    fields = stage_named(stage).config_type().model_fields
    return {
        name: value for name, value in given.items() if value != fields[name].get_default(call_default_factory=True)
    }
