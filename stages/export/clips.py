"""The clips that an export's input holds: a recording's own, or those of a motion artefact."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import open_artefact
from data_schemas.motion import MotionReader
from data_schemas.notes import sentences_of
from data_schemas.skeleton import Motion, Skeleton
from stages.export.config import Config
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.rig_option import rig_named
from stages.shared.formats.skeleton_map import choose_map, read_skeleton_map
from stages.shared.formats.sources import source_named


@dataclass(frozen=True)
class Clip:
    """One clip to write, by a name that may be a file's."""

    name: str
    skeleton: Skeleton
    motion: Motion
    licence: str = ""
    notes: tuple[str, ...] = ()


def names_of(config: Config) -> list[str] | None:
    """Names of the chosen clips of a motion artefact, in its order; None where the input is a recording.

    Raises: InputError where one that is asked for is not there; UsageError for options that are of recordings only.
    """
    if not Path(config.input).is_dir():
        return None
    recordings_only = ("skeleton_map", "skeleton", "body_models", "fps_override")
    given = [name for name in recordings_only if getattr(config, name) is not None]
    if given:
        flag = given[0].replace("_", "-")
        raise UsageError(f"--{flag} is for recordings; an artefact is read as it is.", "Give it to `pumps ingest`.")
    with MotionReader(open_artefact(config.input, "motion")) as reader:
        return _chosen([row.clip for row in reader.clips], config)


def clips_of(config: Config) -> Iterator[Clip]:
    """The chosen clips, one after another. Raises InputError where the input is none or a clip is not there."""
    names = names_of(config)
    if names is None:
        yield from _of_recording(config)
        return
    with MotionReader(open_artefact(config.input, "motion")) as reader:
        for name in names:
            row = reader.row(name)
            yield Clip(name, reader.skeleton(row.skeleton), reader.motion(name), row.licence)


def _of_recording(config: Config) -> Iterator[Clip]:
    source = source_named(config.input)
    maps = (read_skeleton_map(config.skeleton_map),) if config.skeleton_map else ()
    rig, rig_name = rig_named(config.skeleton) if config.skeleton else (b"", "")
    asked = Asked(
        fps_override=config.fps_override, rig=rig, rig_name=rig_name, body_models=config.body_models,
        skeleton_maps=maps, up_axis=config.up_axis,
    )  # fmt: skip
    stem = PurePosixPath(source.member.replace("\\", "/")).stem
    found = {
        f"{stem}.{recording.part}" if recording.part else stem: recording
        for recording in recordings_in(source, asked)
    }
    for name in _chosen(list(found), config):
        recording = found[name]
        choose_map(maps, recording.skeleton.names, must_fit=bool(maps))
        yield Clip(
            name,
            recording.skeleton,
            recording.motion,
            notes=(*sentences_of(recording.notes), *sentences_of(recording.remarks)),
        )


def _chosen(names: list[str], config: Config) -> list[str]:
    unknown = [name for name in config.clip if name not in names]
    if unknown:
        shown = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
        raise InputError(f"{config.input} has no clip {', '.join(unknown)}.", f"It has {shown}.")
    return [name for name in names if name in config.clip] if config.clip else names
