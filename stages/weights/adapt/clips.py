"""The recordings that weights are adapted to, at the networks' frame rate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from data_schemas.errors import InputError
from data_schemas.manifest import MANIFEST_NAME, open_artefact
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.clip_names import ClipNames
from stages.shared.formats.known_facts import asked_of, known_rate
from stages.shared.formats.readers import AUTO, suffixes_of
from stages.shared.formats.reading import Job, read_all
from stages.shared.formats.recording import Asked
from stages.shared.formats.rig_option import rig_named
from stages.shared.formats.sources import find_sources
from stages.shared.formats.usual_units import usual_units, with_units
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.resampling import resample
from stages.shared.progress import Progress
from stages.weights.adapt.config import Config


@dataclass(frozen=True)
class Clip:
    """One recording: its name, source, the sha256 of that, licence, skeleton, and motion at `MODEL_FPS`."""

    name: str
    source: str
    sha256: str
    licence: str
    skeleton: Skeleton
    motion: Motion


@dataclass(frozen=True)
class Read:
    """The clips that can be used, and one sentence on each file that cannot."""

    clips: list[Clip]
    left_out: list[str]


def read_clips(config: Config, progress: Progress) -> Read:
    """Read all recordings that a config names.

    Raises: InputError if none of them is a motion of a humanoid.
    """
    artefacts = [text for text in config.clips if (Path(text) / MANIFEST_NAME).is_file()]
    files = [text for text in config.clips if text not in artefacts]
    read = Read([], [])
    for path in artefacts:
        read.clips.extend(_of_artefact(path, config.licence))
    if files:
        _add_files(read, files, config, progress)
    if not read.clips:
        first = read.left_out[0] if read.left_out else f"{config.clips[0]} is empty."
        raise InputError(
            f"None of the recordings can be used. The first: {first}", "Look at one with `pumps inspect FILE`."
        )
    return read


def _of_artefact(path: str, licence: str) -> Iterator[Clip]:
    """The clips of a motion artefact; `licence` is that of clips without one."""
    with MotionReader(open_artefact(path, "motion")) as reader:
        for row in reader.clips:
            motion = resample(reader.motion(row.clip), MODEL_FPS)
            stated = row.licence or licence
            yield Clip(row.clip, row.source, row.sha256, stated, reader.skeleton(row.skeleton), motion)


def _add_files(read: Read, files: Sequence[str], config: Config, progress: Progress) -> None:
    rig, rig_name = rig_named(config.skeleton) if config.skeleton is not None else (b"", "")
    asked = Asked(trim_first=AUTO, rig=rig, rig_name=rig_name)
    sources = find_sources(files, suffixes_of(AUTO), keep_bad=True)
    jobs = [Job(source, AUTO, asked_of(source, asked, known_rate(source))) for source in sources]
    units = usual_units(jobs, 0)
    names = ClipNames()
    progress.start("Reading recordings", total=sum(source.size for source in sources) / 1e6)
    for outcome in read_all([with_units(job, units) for job in jobs], 0):
        progress.advance(outcome.source.size / 1e6, PurePosixPath(outcome.source.member).name)
        if outcome.reason and outcome.status == "skipped":
            read.left_out.append(outcome.reason)
        for recording in outcome.recordings:
            name = names.name(outcome.source, recording.part)
            if not np.any(recording.skeleton.sampled):
                read.left_out.append(f"{name} has no bone of a body that a point cloud can see.")
                continue
            motion = resample(recording.motion, MODEL_FPS)
            read.clips.append(
                Clip(name, outcome.source.name, outcome.sha256, config.licence, recording.skeleton, motion)
            )
