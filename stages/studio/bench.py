"""All that the page can do: open files, change settings, fill and edit motions, save results."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

from data_schemas.errors import PumpsError, UsageError
from data_schemas.whole_file import write_whole
from stages.shared.contract import StageReport
from stages.shared.file_names import is_file_name
from stages.shared.formats.archives import archive_suffix
from stages.shared.formats.sources import source_named
from stages.shared.inference.constraints.asked import Constraints
from stages.shared.weights.shipped import shipped_weights
from stages.studio.fills import fills_of
from stages.studio.folder import Folder
from stages.studio.jobs import Job, Jobs
from stages.studio.opening import dropped, inside, member_of, write_as_bvh
from stages.studio.saving import save
from stages.studio.scene import Scene, plain_scene_of, scene_of
from stages.studio.scratch import remove_left
from stages.studio.session import FillSettings, MotionRecord, Session, Sessions, State
from stages.studio.steps import FILL, VERBS, constraints_bytes, fill_options, first_keys, settings_after, verb_options
from stages.studio.worker import CancelledError, Told, Worker

MOST_SAMPLES = 8


class Bench:
    """A folder with its sessions, and the process that computes."""

    def __init__(self, folder: Folder, weights: str, device: str) -> None:
        self.folder = folder
        self.sessions = Sessions(folder.sessions())
        remove_left(folder.sessions())
        self.weights = list(dict.fromkeys([weights, *shipped_weights()]))
        self._device = device
        self._worker = Worker(weights, device)
        self.jobs = Jobs(self._worker)
        self._scene_of = lru_cache(maxsize=16)(scene_of)  # the file of a motion never changes
        self._plain_scene_of = lru_cache(maxsize=2)(plain_scene_of)  # asked for twice: description and points

    def warm(self) -> None:
        """Begin to load the models, so that the first fill need not; once, and without waiting for them.

        The page asks for it with the first motion that it shows, since loading would slow its opening down.
        """
        self._worker.start()

    def close(self) -> None:
        """End what runs."""
        self.jobs.close()
        self._worker.close()

    def shown(self, session: Session) -> dict[str, Any]:
        """A session as the page gets it."""
        state = session.state
        motions = {k: v.model_dump(mode="json", exclude={"constraints"}) for k, v in session.motions.items()}
        return {
            "id": session.id,
            "revision": session.revision,
            "undo": session.state.label if session.cursor else "",
            "redo": session.history[session.cursor + 1].label if session.cursor + 1 < len(session.history) else "",
            "state": state.model_dump(mode="json"),
            "motions": motions,
            "jobs": [job.plain() for job in self.jobs.of(session.id) if not job.ended],
        }

    def scene(self, session: str, motion: str) -> Scene:
        """What the page draws of a motion."""
        return self._scene_of(self.sessions.bvh(self.sessions.load(session), motion))

    def plain_scene(self, session: str) -> Scene:
        """What the page draws of the plain interpolation between the keys of the motion on the timeline.

        Raises: UsageError where there are no keys; InputError for parts and frames that are not there.
        """
        found = self.sessions.load(session)
        asked = found.state.settings.constraints
        kept = Constraints(keyframes=asked.keyframes, parts=asked.parts, keep=asked.keep)
        return self._plain_scene_of(self.sessions.bvh(found, found.state.motion), kept.model_dump_json())

    def surface(self, session: str, motion: str) -> bytes:
        """The surface of a body that moves as a motion does, as `stages.studio.surface` packs it."""
        from stages.studio.surface import surface_of  # it needs torch

        return surface_of(self.sessions.bvh(self.sessions.load(session), motion))

    def open_file(self, name: str, session: str | None, revision: int | None, aside: bool, clip: str = "") -> Session:
        """Open a recording of the folder, in a session or a new one.

        Args:
            aside: hold it ready as a second motion, and leave the timeline as it is.
            clip: the one to open of several; of an archive, the file.

        Raises: InputError, UsageError; SeveralClipsError where there are several clips, and none of that name.
        """
        path = self.folder.recording(name)
        if isinstance(path, Path) and archive_suffix(path.name):
            member, clip = member_of(path, name, clip)
            with inside(member):
                return self.open_file(f"{name}!{member}", session, revision, aside, clip)
        data = source_named(str(path)).read()
        return self._opened(data, path, name, name, session, revision, aside, clip)

    def open_bytes(
        self, name: str, data: bytes, session: str | None, revision: int | None, aside: bool, clip: str = ""
    ) -> Session:
        """Open a file that was dropped on the page. Raises as `open_file` does."""
        if not is_file_name(name):
            raise UsageError(f"{name!r} cannot be the name of a file.", "Rename it.")
        with dropped(name, data, clip, self.folder.sessions()) as (data, path, name, clip):
            return self._opened(data, path, name, "", session, revision, aside, clip)

    def set_settings(self, session: str, revision: int, label: str, settings: Mapping[str, Any]) -> Session:
        """Change how the motion is filled. Raises UsageError for weights that the studio does not offer."""
        raw = dict(settings)
        checked = FillSettings.model_validate(
            {**raw, "constraints": Constraints.model_validate(raw.get("constraints"))}
        )
        self._check_offered(checked.weights)

        def change(old: Session) -> Session:
            return old.with_state(old.state.model_copy(update={"label": label[:80], "settings": checked}))

        return self.sessions.change(session, change, revision, beside_results=True)

    def move(self, session: str, revision: int, steps: int) -> Session:
        """Undo (-1) or redo (1)."""
        return self.sessions.change(session, lambda old: old.moved(steps), revision)

    def choose(self, session: str, revision: int, motion: str) -> Session:
        """Go on from another motion of the session: it comes onto the timeline."""

        def change(old: Session) -> Session:
            label = f"Went on from {old.record(motion).name}"
            same_length = old.record(motion).frames == old.record(old.state.motion).frames
            asked = old.state.settings.constraints if same_length else self._first_constraints(old.record(motion))
            settings = old.state.settings.model_copy(update={"constraints": asked})
            return old.with_state(State(label=label, motion=motion, settings=settings))

        return self.sessions.change(session, change, revision)

    def discard(self, session: str, revision: int, motion: str) -> Session:
        """Take a result away; undo brings it back."""

        def change(old: Session) -> Session:
            left = tuple(each for each in old.state.results if each != motion)
            label = f"Took {old.record(motion).name} away"
            return old.with_state(old.state.model_copy(update={"label": label, "results": left}))

        return self.sessions.change(session, change, revision)

    def fill(self, session: str, samples: int) -> Job:
        """Fill the motion on the timeline as the settings say, once or in several plausible ways."""
        found = self.sessions.load(session)
        state = found.state
        self._check_offered(state.settings.weights)  # the session's file may be somebody else's
        source = self.sessions.bvh(found, state.motion)
        if not 1 <= samples <= MOST_SAMPLES:
            raise UsageError(f"{samples} samples are asked for.", f"Ask for 1 to {MOST_SAMPLES}.")

        def work(told: Told) -> dict[str, Any]:
            settings = state.settings
            options = fill_options(settings, self._device)
            motions = [self.sessions.take_motion_name(session) for _ in range(samples)]
            output = source.with_name(f"{motions[0]}.{'bvh' if samples == 1 else 'tries.bvh'}")
            asked = source.with_name(f"{motions[0]}.json")
            write_whole(asked, constraints_bytes(settings.constraints))
            values = {**options, "input": source, "constraints": asked, "samples": samples}
            report = self._run(FILL, values, output, told)
            for fill in fills_of(report, output, motions):
                made = fill.file.replace(source.with_name(f"{fill.motion}.bvh"))
                words = [settings.weights, *([f"seed {settings.seed}"] if settings.seed else [])]
                words += [f"sample {fill.sample}"] if fill.sample > 1 else []
                record = MotionRecord(
                    name=f"fill {fill.motion[1:]}: {', '.join(words)}", stage=FILL,
                    options={**options, **fill.options}, constraints=settings.constraints, source=state.motion,
                    **self._length(made), told=fill.told, gist=fill.gist,
                )  # fmt: skip
                self._keep(session, fill.motion, record, _with_result)
            return {"motions": motions}

        return self.jobs.add(session, work)

    def edit(self, session: str, name: str, asked: Mapping[str, Any], other: str) -> Job:
        """Change the whole motion on the timeline by a verb."""
        found = self.sessions.load(session)
        state = found.state
        source = self.sessions.bvh(found, state.motion)
        options = verb_options(name, asked, state.settings, self._device)
        verb = VERBS[name]
        if verb.fills:
            self._check_offered(state.settings.weights)
        if bool(verb.other) != bool(other):
            raise UsageError(f"{name} {'needs' if verb.other else 'takes no'} second motion.", "Choose one.")
        values: dict[str, Any] = {**options, "input": source}
        if verb.other:
            values[verb.other] = self.sessions.bvh(found, other)
        before = found.record(state.motion)

        def work(told: Told) -> dict[str, Any]:
            motion = self.sessions.take_motion_name(session)
            output = source.with_name(f"{motion}.bvh")
            report = self._run(verb.stage, values, output, told)
            record = MotionRecord(
                name=f"{before.name}, {name}", stage=verb.stage, options=options, source=state.motion,
                other=other, **self._length(output), told=tuple(report.lines),
                gist=tuple(report.gist),
            )  # fmt: skip
            settings = settings_after(name, options, state.settings, before.frames)
            if settings.constraints.keyframes is None and not settings.constraints.parts:
                settings = settings.model_copy(update={"constraints": self._first_constraints(record)})

            def on_timeline(held: Session, motion: str) -> Session:
                return held.with_state(State(label=name.capitalize(), motion=motion, settings=settings))

            self._keep(session, motion, record, on_timeline)
            return {"motions": [motion]}

        return self.jobs.add(session, work)

    def save(self, session: str, motion: str, name: str, overwrite: bool) -> dict[str, Any]:
        """Write a motion into the folder, with its constraints and commands."""
        return save(self.folder, self.sessions, self.sessions.load(session), motion, name, overwrite)

    def _check_offered(self, weights: str) -> None:
        if weights not in self.weights:
            raise UsageError(f"The studio offers no weights {weights!r}.", f"Choose {', '.join(self.weights)}.")

    def _keep(
        self, session: str, motion: str, record: MotionRecord, shown: Callable[[Session, str], Session]
    ) -> None:
        """Add what a job made to its session and show it there.

        Raises: UsageError where the session does not hold any more what it was made from, which is then removed.
        """

        def change(old: Session) -> Session:
            if not {record.source, record.other} <= {*old.motions, ""}:
                raise UsageError("What it was made from was undone meanwhile.", "Do it again.")
            return shown(old.model_copy(update={"motions": {**old.motions, motion: record}}), motion)

        try:
            self.sessions.change(session, change)
        except PumpsError:
            self.sessions.remove_files(session, motion)
            raise

    def _run(self, stage: str, values: dict[str, Any], output: Path, told: Told) -> StageReport:
        try:
            told(f"pumps {stage}", 0, 0)
            report = self._worker.run(stage, {**values, "output": output}, told)
            told(f"pumps {stage}", 0, 0)  # it may have been cancelled when the stage was ready
            return report
        except (CancelledError, PumpsError):
            for path in output.parent.glob(f"{output.name.partition('.')[0]}.*"):
                path.unlink(missing_ok=True)
            raise

    def _opened(
        self, data: bytes, path: Path | str | None, name: str, opened: str, session: str | None,
        revision: int | None, aside: bool, clip: str,
    ) -> Session:  # fmt: skip
        fresh = session is None
        settings = FillSettings(weights=self.weights[0], seed=0)
        found = self.sessions.create(settings) if session is None else self.sessions.load(session)
        motion = self.sessions.take_motion_name(found.id)
        try:
            bvh = self.sessions.folder(found.id) / f"{motion}.bvh"
            converted = write_as_bvh(data, path, name, bvh, clip)
            clip = clip if converted else ""
            shown = PurePosixPath(name.partition("!")[2] or name).name
            record = MotionRecord(
                name=f"{clip} in {shown}" if clip else shown, opened=opened, sha256=hashlib.sha256(data).hexdigest(),
                converted=converted, clip=clip, **self._length(bvh),
            )  # fmt: skip

            def change(old: Session) -> Session:
                held = old.model_copy(update={"motions": {**old.motions, motion: record}})
                if aside:
                    return held
                kept = old.state.settings.model_copy(update={"constraints": self._first_constraints(record)})
                return held.with_state(State(label=f"Opened {shown}", motion=motion, settings=kept))

            return self.sessions.change(found.id, change, None if fresh else revision)
        except BaseException:
            if fresh:
                self.sessions.remove(found.id)
            else:
                self.sessions.remove_files(found.id, motion)
            raise

    def _length(self, bvh: Path) -> dict[str, Any]:
        found = self._scene_of(bvh).description  # the page asks for it next
        return {"frames": found["frames"], "fps": found["fps"]}

    def _first_constraints(self, record: MotionRecord) -> Constraints:
        return Constraints(keyframes=first_keys(record.frames, record.fps))


def _with_result(held: Session, motion: str) -> Session:
    """A session that shows one of its motions as one more result."""
    results = (*held.state.results, motion)
    return held.with_state(held.state.model_copy(update={"label": "Filled", "results": results}))
