"""Saving a motion of a session: the file, the constraints of its fills, and the commands that make it again."""

from __future__ import annotations

import hashlib
import shlex
from pathlib import Path
from typing import Any

from data_schemas.errors import InputError, UsageError
from data_schemas.whole_file import write_whole
from stages.registry import stage_named
from stages.shared.formats.sources import source_named
from stages.shared.outputs import paths_in
from stages.studio.folder import SESSIONS, Folder
from stages.studio.opening import clip_name
from stages.studio.scratch import scratch_folder
from stages.studio.session import MotionRecord, Session, Sessions
from stages.studio.steps import FILL, as_argument, command_line, constraints_bytes, steps_to
from stages.studio.worker import config_of


def save(
    folder: Folder, sessions: Sessions, session: Session, motion: str, name: str, overwrite: bool
) -> dict[str, Any]:
    """Write a motion of a session into the folder.

    Beside NAME.bvh, NAME.json has the constraints of its last fill, and NAME.sh every command from the recording to
    it, where there are any. Every file has the bytes that these commands write.

    Args:
        name: of the file; its suffix says the format, and is written in lower case.
        overwrite: whether files of these names may be replaced.

    Returns: files (names) and commands (lines).
    Raises: UsageError for a name that is not possible or taken.
    """
    stem, suffix = Path(name).stem, Path(name).suffix.lower()
    if suffix in (".json", ".sh"):
        raise UsageError(f"{name} has a suffix for constraints and commands.", "Give it .bvh or .glb, for example.")
    folder.new_file(name, overwrite)
    target = f"{stem}{suffix}"
    lines, constraints, made = _commands(folder, session, motion, stem)
    written = {f"{stem}.bvh": sessions.bvh(session, motion).read_bytes()} if lines or suffix == ".bvh" else {}
    written |= constraints
    if suffix != ".bvh":
        lines.append(shlex.join(["pumps", "export", as_argument(made), "-o", target]))
    if lines:
        written[f"{stem}.sh"] = _script(lines)
    names = list(dict.fromkeys([target, *written]))
    opened = [folder.path / path for record in session.motions.values() for path in paths_in(record.opened)]
    for each in names:
        path = folder.new_file(each, overwrite)
        if path.exists() and any(other.exists() and path.samefile(other) for other in opened):
            raise UsageError(f"{each} is a recording that this session reads.", "Choose another name.")
    if suffix != ".bvh":
        written[target] = _exported(folder, made, written.get(made), target)  # before anything is written
    for each, data in written.items():
        write_whole(folder.path / each, data)
    return {"files": names, "commands": lines}


def _exported(folder: Folder, made: str, data: bytes | None, target: str) -> bytes:
    """What `pumps export` writes of a BVH of the folder, whose `data` are given if it is not written yet. Its name
    counts, as some formats hold the name of the clip. Raises as the stage does."""
    with scratch_folder(folder.sessions()) as place:
        source, output = folder.path / made, place / target
        if data is not None:
            source = place / made
            write_whole(source, data)
        stage_named("export").runner()(config_of("export", {"input": str(source), "output": output}))
        return output.read_bytes()


def _commands(folder: Folder, session: Session, motion: str, stem: str) -> tuple[list[str], dict[str, bytes], str]:
    """The commands to a motion, run in the folder; the files of constraints that they read; the BVH they end with."""
    order = steps_to(session, motion)
    lines: list[str] = []
    files: dict[str, bytes] = {}
    names: dict[str, str] = {}
    for number, each in enumerate(order, 1):
        record = session.record(each)
        output = f"{stem}.bvh" if each == motion else f"{stem}.step{number}.bvh"
        if not record.stage and not _is_there(folder, record):
            names[each] = f"{SESSIONS}/{session.id}/{each}.bvh"
            continue
        if not record.stage and not record.converted:
            names[each] = record.opened
            continue
        names[each] = output
        if not record.stage:
            source = source_named(str(folder.path / record.opened))
            chosen = [f"--clip={clip_name(source, record.clip)}"] if record.clip else []
            lines.append(shlex.join(["pumps", "export", as_argument(record.opened), *chosen, "-o", output]))
            continue
        constraints = ""
        if record.stage == FILL and record.constraints is not None:
            constraints = f"{stem}.json" if each == motion else f"{stem}.step{number}.json"
            files[constraints] = constraints_bytes(record.constraints)
        other = names.get(record.other, "")
        lines.append(command_line(record, names[record.source], output, other, constraints))
    return lines, files, names[motion]


def _is_there(folder: Folder, record: MotionRecord) -> bool:
    """Whether the folder holds a recording as it was when it was opened; one that was dropped on the page it never
    holds. Of any other, the session alone has a copy."""
    if not record.opened:
        return False
    try:
        data = source_named(str(folder.recording(record.opened))).read()
    except InputError:
        return False
    return hashlib.sha256(data).hexdigest() == record.sha256


def _script(lines: list[str]) -> bytes:
    advice = "# Run it in the folder of this file. Files that exist stay: add --overwrite."
    return "\n".join(["#!/bin/sh", advice, "set -e", *lines, ""]).encode()
