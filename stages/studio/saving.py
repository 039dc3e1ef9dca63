"""Saving a motion of a session: the file, the constraints of its fills, and the commands that make it again."""

from __future__ import annotations

import shlex
from typing import Any

from data_schemas.errors import UsageError
from data_schemas.whole_file import write_whole
from stages.registry import stage_named
from stages.studio.folder import SESSIONS, Folder
from stages.studio.session import Session, Sessions
from stages.studio.steps import FILL, as_argument, command_line, constraints_bytes, steps_to
from stages.studio.worker import config_of


def save(
    folder: Folder, sessions: Sessions, session: Session, motion: str, name: str, overwrite: bool
) -> dict[str, Any]:
    """Write a motion of a session into the folder.

    Beside NAME.bvh, NAME.json has the constraints of its last fill, and NAME.sh every command from the recording to
    it, where there are any. The BVH has the bytes that these commands write.

    Args:
        name: of the file; its suffix says the format.
        overwrite: whether files of these names may be replaced.

    Returns: files (names) and commands (lines).
    Raises: UsageError for a name that is not possible or taken.
    """
    target = folder.new_file(name, overwrite)
    stem, suffix = target.stem, target.suffix.lower()
    if suffix in (".json", ".sh"):
        raise UsageError(f"{name} has a suffix for constraints and commands.", "Give it .bvh or .glb, for example.")
    bvh = sessions.bvh(session, motion)
    lines, constraints = _commands(session, motion, stem)
    opened = [record.opened for record in session.motions.values() if record.opened]
    written = [name, *constraints]
    if suffix != ".bvh":
        lines.append(shlex.join(["pumps", "export", f"{stem}.bvh", "-o", name]) if lines else "")
        written.append(f"{stem}.bvh")
    lines = [line for line in lines if line]
    if lines:
        written.append(f"{stem}.sh")
    for each in written:
        path = folder.new_file(each, overwrite)
        if any((folder.path / other.partition("!")[0]).resolve() == path for other in opened):
            raise UsageError(f"{each} is a recording that this session reads.", "Choose another name.")
    write_whole(folder.path / f"{stem}.bvh", bvh.read_bytes())
    if suffix != ".bvh":
        export = stage_named("export")
        values = {"input": str(bvh), "output": target, "overwrite": overwrite}
        export.runner()(config_of("export", values))
    for each, data in constraints.items():
        write_whole(folder.path / each, data)
    if lines:
        write_whole(folder.path / f"{stem}.sh", _script(lines))
    return {"files": written, "commands": lines}


def _commands(session: Session, motion: str, stem: str) -> tuple[list[str], dict[str, bytes]]:
    """The commands to a motion, run in the folder, and the files of constraints that they read."""
    order = steps_to(session, motion)
    lines: list[str] = []
    files: dict[str, bytes] = {}
    names: dict[str, str] = {}
    for number, each in enumerate(order, 1):
        record = session.record(each)
        output = f"{stem}.bvh" if each == motion else f"{stem}.step{number}.bvh"
        if not record.stage:
            names[each] = record.opened if record.opened and not record.converted else output
            if record.converted and record.opened:
                lines.append(shlex.join(["pumps", "export", as_argument(record.opened), "-o", output]))
            elif not record.opened:  # it was dropped on the page, and lies with the session alone
                names[each] = f"{SESSIONS}/{session.id}/{each}.bvh"
            continue
        constraints = ""
        if record.stage == FILL and record.constraints is not None:
            constraints = f"{stem}.json" if each == motion else f"{stem}.step{number}.json"
            files[constraints] = constraints_bytes(record.constraints)
        names[each] = output
        other = names.get(record.other, "")
        lines.append(command_line(record, names[record.source], output, other, constraints))
    return lines, files


def _script(lines: list[str]) -> bytes:
    advice = "# Run it in the folder of this file. Files that exist stay: add --overwrite."
    return "\n".join(["#!/bin/sh", advice, "set -e", *lines, ""]).encode()
