"""The clips that are segmented: of a file, a motion artefact, or a folder of a data set of joint positions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from data_schemas.clips import ClipRow
from data_schemas.concepts import StoredBody
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact, names_artefact, sha256_of_file
from data_schemas.motion import MotionReader
from data_schemas.notes import sentences_of
from data_schemas.skeleton import Motion, Skeleton
from stages.segment.config import Config
from stages.shared.concepts.actions import action_of, action_pattern
from stages.shared.concepts.body_positions import body_of, body_positions
from stages.shared.concepts.data_sets import LabelledPositions, positions_of_data_set
from stages.shared.concepts.generated_samples import positions_of_samples
from stages.shared.formats.archives import archive_and_member
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.rig_option import rig_named
from stages.shared.formats.skeleton_map import choose_map, read_skeleton_map
from stages.shared.formats.sources import source_named
from stages.shared.kinematics.resampling import resample


@dataclass(frozen=True)
class Given:
    """What is segmented: how many clips, the clips, and the artefact or files that they come from."""

    count: int
    clips: Iterator[LabelledPositions]
    inputs: tuple[Path | Artefact, ...]


def given(config: Config) -> Given:
    """The clips of the input.

    Raises: UsageError where options do not belong to the input; InputError for a file or artefact that is bad.
    """
    pattern = action_pattern(config.actions)
    if config.data_set is not None:
        if config.data_set == "action2motion":
            found = positions_of_samples(config.input)
            return Given(len(found), iter(found), (Path(archive_and_member(str(config.input))[0] or config.input),))
        found = positions_of_data_set(config.data_set, config.input)
        return Given(len(found), iter(found), (config.input,))
    if names_artefact(config.input):
        reader = MotionReader(config.input)

        def clips_of_artefact() -> Iterator[LabelledPositions]:
            with reader:
                for row in reader.clips:
                    skeleton, motion = reader.skeleton(row.skeleton), reader.motion(row.clip)
                    yield _of_motion(row, skeleton, motion, config.fps, action_of(row, pattern))

        return Given(len(reader.clips), clips_of_artefact(), (reader.artefact,))
    return _of_file(config, pattern)


def _of_file(config: Config, pattern) -> Given:
    source = source_named(str(config.input))
    maps = (read_skeleton_map(config.skeleton_map),) if config.skeleton_map else ()
    rig, rig_name = rig_named(config.skeleton) if config.skeleton else (b"", "")
    asked = Asked(fps_override=config.fps_override, rig=rig, rig_name=rig_name, skeleton_maps=maps)
    recordings = list(recordings_in(source, asked))
    if not recordings:
        raise InputError(f"{source.name} holds no motion.")
    path = Path(source.archive or source.name)
    digest = sha256_of_file(path)

    def clips() -> Iterator[LabelledPositions]:
        for recording in recordings:
            choose_map(maps, recording.skeleton.names, must_fit=bool(maps))
            stem = Path(source.member).stem
            motion = recording.motion
            row = ClipRow(
                clip=f"{stem}.{recording.part}" if recording.part else stem, source=source.name, sha256=digest,
                skeleton="", frames=motion.frames, fps=motion.fps, seconds=motion.frames / motion.fps,
                split="train", licence="unknown",
            )  # fmt: skip
            notes = tuple(sentences_of(recording.notes))
            yield _of_motion(row, recording.skeleton, motion, config.fps, action_of(row, pattern), notes)

    return Given(len(recordings), clips(), (path,))


def _of_motion(
    row: ClipRow, skeleton: Skeleton, motion: Motion, fps: float | None, action: str, notes: tuple[str, ...] = ()
) -> LabelledPositions:
    if fps is not None:
        motion = resample(motion, fps)
    body = body_of(skeleton)
    stored = StoredBody(body.names, body.parents, body.groups)
    seconds = motion.frames / motion.fps
    row = replace(row, skeleton=stored.id, frames=motion.frames, fps=motion.fps, seconds=seconds)
    return LabelledPositions(row, stored, body_positions(skeleton, motion, body), body.scale, action, notes)
