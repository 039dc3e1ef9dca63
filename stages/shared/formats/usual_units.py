"""The unit of tables of joint positions, which state none: one for all recordings of a rig in a data set.

A single recording of a child or a giant can look like an adult in another unit. So some files of each data set are
read first, and the unit that most of them show is the usual one of their rig.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from data_schemas.errors import InputError
from data_schemas.notes import Flag
from stages.shared.formats.positions import rig_key
from stages.shared.formats.readers import AUTO, format_named, recognise
from stages.shared.formats.reading import Job, read_all

FORMAT = "positions"
_LOOKED_AT = 16  # files of each data set

Units = tuple[tuple[tuple[str, ...], float], ...]  # rigs, as `rig_key` names them, with metres in their unit


def usual_units(jobs: Sequence[Job], workers: int, cluster: str | None = None) -> Mapping[str, Units]:
    """For each data set with several files of positions: its rigs and their usual units.

    Args:
        jobs: all recordings that are ingested, in the order of their names.
        workers: processes that read, 0 for one per core. cluster: as of `read_all`.
    """
    suffixes = format_named(FORMAT).suffixes
    groups: dict[str, list[Job]] = {}
    for job in jobs:
        if job.format == FORMAT or (job.format == AUTO and job.source.suffix in suffixes):
            groups.setdefault(job.source.data_set, []).append(job)
    looked_at = [
        group[at * len(group) // min(len(group), _LOOKED_AT)]
        for group in groups.values()
        if len(group) > 1
        for at in range(min(len(group), _LOOKED_AT))
    ]
    looked_at = [job for job in looked_at if _holds_positions(job)]
    votes: dict[str, dict[tuple[str, ...], Counter[float]]] = {}
    for outcome in read_all(looked_at, workers, cluster):
        if outcome.format == FORMAT:
            rigs = votes.setdefault(outcome.source.data_set, {})
            for recording in outcome.recordings:
                sure = all(each.flag is not Flag.UNIT_UNCERTAIN for each in recording.notes)
                skeleton = recording.skeleton
                rigs.setdefault(rig_key(skeleton.names), Counter())[skeleton.unit_m] += sure
    return {
        data_set: tuple((rig, units.most_common(1)[0][0]) for rig, units in rigs.items() if any(units.values()))
        for data_set, rigs in votes.items()
    }


def with_units(job: Job, units: Mapping[str, Units]) -> Job:
    """The job with the usual units of its data set."""
    return replace(job, asked=replace(job.asked, usual_units=units.get(job.source.data_set, ())))


def _holds_positions(job: Job) -> bool:
    """Whether a file is one of positions: others have the same suffixes, and are slow to read."""
    if job.format == FORMAT:
        return True
    try:
        found = recognise(job.source.read(), job.source.name)
    except InputError:
        return False
    return found is not None and found.name == FORMAT
