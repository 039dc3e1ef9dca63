"""A session of the studio as it lies on disk: its motions, and the history of states for undo and redo."""

from __future__ import annotations

import json
import re
import secrets
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from data_schemas.errors import InputError, UsageError
from data_schemas.own_folders import make_own_folder, remove_own_folder
from data_schemas.whole_file import write_whole
from stages.shared.contract import StageConfig
from stages.shared.inference.constraints.asked import Constraints

MOST_CHANGES = 200  # that undo can go back
_FILE = "session.json"
_ID = re.compile(r"[0-9a-f]{16}")
_MOTION = re.compile(r"m[0-9]{1,9}")


class FillSettings(StageConfig):
    """How a motion is filled: what `pumps infill` is given beside the file."""

    constraints: Constraints = Constraints()
    weights: str = Field(min_length=1)
    seed: int = Field(0, ge=0, lt=2**31)
    foot_lock: bool = True


class MotionRecord(StageConfig):
    """One motion of a session, whose BVH is a file beside the session's.

    name: what the page calls it. stage: the stage that made it, "" for a recording that was opened.
    options, constraints: what that stage was given, besides files. source, other: the motions that it read.
    opened: the recording's name in the folder, or "" where it was dropped on the page. sha256: of its bytes, in
        hexadecimal digits. converted: whether it had another format, so that `pumps export` made a BVH of it.
    clip: the one that was chosen of a file that holds several, else "".
    told, gist: what the stage said, a line each, and the few of these that the page shows when the motion comes.
    """

    name: str
    stage: str = ""
    options: dict[str, Any] = Field(default_factory=dict)
    constraints: Constraints | None = None
    source: str = ""
    other: str = ""
    opened: str = ""
    sha256: str = ""
    converted: bool = False
    clip: str = ""
    frames: int = 0
    fps: float = 0.0
    told: tuple[str, ...] = ()
    gist: tuple[str, ...] = ()


class State(StageConfig):
    """What undo goes back to.

    label: what was done to come here. motion: the one on the timeline, "" before a file is opened. results: motions
    that were filled from it.
    """

    label: str
    motion: str = ""
    settings: FillSettings
    results: tuple[str, ...] = ()


class Session(StageConfig):
    """All of a session.

    revision: grows with every change, so that a page can see that it is out of date. settled: the revision at which
    the motion on the timeline or the settings changed last; later changes are results of fills alone.
    """

    version: Literal[1] = 1
    id: str
    revision: int = 0
    settled: int = 0
    next_motion: int = 1
    cursor: int = 0
    history: tuple[State, ...] = Field(min_length=1)
    motions: dict[str, MotionRecord] = Field(default_factory=dict)

    @property
    def state(self) -> State:
        """The state at the cursor."""
        return self.history[self.cursor]

    def with_state(self, state: State) -> Session:
        """After one more change; what was undone is dropped, and so are motions that no state needs any more."""
        history = (*self.history[: self.cursor + 1], state)[-MOST_CHANGES - 1 :]
        changed = self.model_copy(update={"history": history, "cursor": len(history) - 1})
        return changed.model_copy(
            update={"motions": {k: v for k, v in self.motions.items() if k in changed.needed()}}
        )

    def moved(self, steps: int) -> Session:
        """Undone (-1) or redone (1). Raises UsageError where there is nothing to undo or redo."""
        cursor = self.cursor + steps
        if not 0 <= cursor < len(self.history):
            raise UsageError("There is nothing to undo." if steps < 0 else "There is nothing to redo.")
        return self.model_copy(update={"cursor": cursor})

    def needed(self) -> set[str]:
        """Motions of the states, recordings that were opened, and those that these were made from."""
        found: set[str] = set()
        opened = (motion for motion, record in self.motions.items() if not record.stage)
        waiting = [*opened, *(m for state in self.history for m in (state.motion, *state.results))]
        while waiting:
            motion = waiting.pop()
            if motion in self.motions and motion not in found:
                found.add(motion)
                waiting += [self.motions[motion].source, self.motions[motion].other]
        return found

    def in_order(self) -> bool:
        """Whether every motion was made from motions of lower numbers, and none from itself."""
        return all(
            not made_from or _number(made_from) < _number(motion)
            for motion, record in self.motions.items()
            for made_from in (record.source, record.other)
        )

    def record(self, motion: str) -> MotionRecord:
        """Raises InputError for a motion that the session does not hold."""
        if motion not in self.motions:
            raise InputError("The session holds no such motion.", "Load the page again.")
        return self.motions[motion]


class Sessions:
    """The sessions of a folder. Every change is on the disk, whole, before it is answered."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, Session] = {}
        self._lock = threading.RLock()

    def folder(self, name: str) -> Path:
        """The folder of a session's files. Raises InputError for a name that is none of a session."""
        if not _ID.fullmatch(name) or (self._folder / name).is_symlink():  # a link may lead out of the folder
            raise InputError("There is no such session.", "Open a file to begin one.")
        return self._folder / name

    def bvh(self, session: Session, motion: str) -> Path:
        """The BVH of a motion. Raises InputError for a motion that the session does not hold, or a link."""
        session.record(motion)
        path = self.folder(session.id) / f"{motion}.bvh"
        if path.is_symlink():
            raise InputError(f"{path.name} of the session is a link, which may lead out of the folder.")
        return path

    def create(self, settings: FillSettings) -> Session:
        """A new, empty session."""
        session = Session(id=secrets.token_hex(8), history=(State(label="Began", settings=settings),))
        make_own_folder(self.folder(session.id))
        return self._store(session)

    def remove(self, name: str) -> None:
        """Remove a session with its files."""
        with self._lock:
            self._known.pop(name, None)
            remove_own_folder(self.folder(name))

    def load(self, name: str) -> Session:
        """Raises InputError where there is none, or its file is damaged."""
        with self._lock:
            if name not in self._known:
                path = self.folder(name) / _FILE
                try:
                    session = Session.model_validate_json(path.read_bytes())
                except OSError:
                    raise InputError("There is no such session.", "Open a file to begin one.") from None
                except (ValidationError, ValueError):
                    raise InputError(f"The session {name} is damaged.", "Open the file again.") from None
                whole = session.id == name and 0 <= session.cursor < len(session.history)
                names = (n for m, r in session.motions.items() for n in (m, r.source or m, r.other or m))
                if not whole or not all(map(_MOTION.fullmatch, names)) or not session.in_order():
                    raise InputError(f"The session {name} is damaged.", "Open the file again.")
                self._known[name] = session
            return self._known[name]

    def change(
        self,
        name: str,
        change: Callable[[Session], Session],
        revision: int | None = None,
        *,
        beside_results: bool = False,
    ) -> Session:
        """The session after a change.

        Args:
            revision: the session's as the page knows it; None for changes that fit any.
            beside_results: whether the change also fits where fills have added results since that revision.

        Raises: UsageError where another page has changed the session since.
        """
        with self._lock:
            session = self.load(name)
            oldest = session.settled if beside_results else session.revision
            if revision is not None and not oldest <= revision <= session.revision:
                raise OutOfDateError("Another page changed this session.", "The page shows it as it is now.")
            changed = change(session)
            now, before, next_revision = changed.state, session.state, session.revision + 1
            same = (now.motion, now.settings) == (before.motion, before.settings)
            settled = session.settled if same else next_revision
            stored = self._store(changed.model_copy(update={"revision": next_revision, "settled": settled}))
            for motion in session.motions.keys() - stored.motions.keys():
                self.remove_files(name, motion)
            return stored

    def remove_files(self, name: str, motion: str) -> None:
        """Remove the files of a motion that the session does not hold."""
        for path in self.folder(name).glob(f"{motion}.*"):
            path.unlink(missing_ok=True)

    def take_motion_name(self, name: str) -> str:
        """An id for a motion that is being made, which no other gets."""
        with self._lock:
            session = self.load(name)
            self._store(session.model_copy(update={"next_motion": session.next_motion + 1}))
            return f"m{session.next_motion}"

    def recent(self, most: int = 20) -> list[dict[str, Any]]:
        """Sessions with a motion, the latest first: id, name of the motion, label, time (s since 1970)."""
        found = []
        for path in self._files():
            try:
                session = self.load(path.parent.name)
                changed_s = path.stat().st_mtime
            except (InputError, OSError):
                continue
            if session.state.motion in session.motions:
                name = session.motions[session.state.motion].name
                found.append({"id": session.id, "name": name, "label": session.state.label, "time": changed_s})
        return sorted(found, key=lambda each: -each["time"])[:most]

    def _files(self) -> Iterator[Path]:
        return (path for path in self._folder.glob(f"*/{_FILE}") if _ID.fullmatch(path.parent.name))

    def _store(self, session: Session) -> Session:
        text = json.dumps(
            session.model_dump(mode="json", exclude_defaults=True, exclude={"version"}) | {"version": 1}
        )
        with self._lock:
            write_whole(self.folder(session.id) / _FILE, text.encode())
            self._known[session.id] = session
        return session


def _number(motion: str) -> int:
    return int(motion[1:])


class OutOfDateError(UsageError):
    """A page asked for a change of a session that another page has changed."""
