"""Reading and writing motions: files of any format, members of archives, motion artefacts."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath

from data_schemas.errors import InputError, UsageError
from data_schemas.notes import sentences_of
from pumps.motion import Motion

PathLike = str | os.PathLike[str]


def load(
    path: PathLike, *, fps: float | None = None, skeleton: PathLike | None = None, up_axis: str | None = None
) -> Motion:
    """Read the one motion of a file.

    Args:
        path: a file of any format that pumps reads (`pumps formats`), or ARCHIVE.zip!MEMBER.
        fps: true frames per second, where the file states none or a wrong one.
        skeleton: the file that holds the skeleton, for formats that keep it apart (ASF, a robot's URDF).
        up_axis: "y" or "z", the up axis of the file's world, where it is not the one that the body's poses show.

    Raises:
        InputError: the file cannot be read, is not a humanoid's, or holds several motions.
        UsageError: `fps` is not above 0, or `up_axis` is neither "y" nor "z".
    """
    found = load_clips(path, fps=fps, skeleton=skeleton, up_axis=up_axis)
    if len(found) != 1:
        names = ", ".join(motion.name for motion in found[:5])
        raise InputError(f"{os.fspath(path)} holds {len(found)} motions ({names}).", "Use pumps.load_clips.")
    return found[0]


def load_clips(
    path: PathLike, *, fps: float | None = None, skeleton: PathLike | None = None, up_axis: str | None = None
) -> list[Motion]:
    """Read all motions of a file, such as the animations of a GLB. Arguments and errors as of `load`."""
    from stages.shared.formats.readers import recordings_in
    from stages.shared.formats.recording import Asked
    from stages.shared.formats.rig_option import rig_named
    from stages.shared.formats.sources import source_named

    if fps is not None and not 0 < fps < 1e6:
        raise UsageError(f"fps is {fps}.", "Give frames per second, above 0.")
    if up_axis not in (None, "y", "z"):
        raise UsageError(f"up_axis is {up_axis!r}.", 'Give "y" or "z", or None to find it from the poses.')
    source = source_named(os.fspath(path))
    rig, rig_name = rig_named(os.fspath(skeleton)) if skeleton is not None else (b"", "")
    recordings = recordings_in(source, Asked(fps_override=fps, rig=rig, rig_name=rig_name, up_axis=up_axis))
    stem = PurePosixPath(source.member.replace("\\", "/")).stem
    verbatim = source.read() if source.suffix == ".bvh" and fps is None else b""
    return [
        Motion(
            each.skeleton,
            each.motion,
            f"{stem}.{each.part}" if each.part else stem,
            tuple(sentences_of((*each.notes, *each.remarks))),
            up_axis=up_axis,
            source=verbatim,
        )
        for each in recordings
    ]


def save(motion: Motion, path: PathLike, *, overwrite: bool = False) -> tuple[str, ...]:
    """Write a motion to a file; the suffix says the format: .bvh, .glb, .npz, .csv or .parquet.

    A motion that was read from a BVH, or filled into one, is written back with its own header, rows and numbers.

    Returns:
        Notes on what the format does not hold, one sentence each.

    Raises:
        UsageError: the file exists, or pumps does not write its suffix.
        InputError: the format is BVH, and the skeleton has no header.
    """
    from stages.shared.formats.writers import bytes_of_motion, written_format
    from stages.shared.outputs import write_output

    target = Path(path)
    chosen = written_format(target)
    if os.path.lexists(target) and not overwrite:
        raise UsageError(f"{target} exists.", "Give overwrite=True to replace it.")
    if chosen == "bvh" and motion.source:
        data, notes = motion.source, []
    else:
        data, notes = bytes_of_motion(chosen, motion.skeleton, motion.record, motion.name, licence=motion.licence)
    write_output(target, data)
    return tuple(notes)


def read_clips(artefact: PathLike) -> Iterator[Motion]:
    """The motions of a `motion` artefact, as `pumps ingest` and `pumps decode` write it, one after another.

    Raises:
        InputError: the artefact is not there, damaged or of another kind.
    """
    from data_schemas.artefact import open_artefact
    from data_schemas.motion import MotionReader

    with MotionReader(open_artefact(artefact, "motion")) as reader:
        for row in reader.clips:
            yield Motion(reader.skeleton(row.skeleton), reader.motion(row.clip), row.clip, licence=row.licence)


def write_clips(motions: Iterable[Motion], folder: PathLike, *, split: str = "train", overwrite: bool = False) -> int:
    """Write motions as a `motion` artefact, which every command that reads one takes. Returns how many there were.

    Args:
        split: "train", "val" or "test", of all of them.

    Raises:
        UsageError: the folder exists, or there are no motions.
        InputError: a motion is not finite, or two have one name.
    """
    from data_schemas.artefact import write_artefact
    from data_schemas.clips import ClipRow
    from data_schemas.motion import MotionWriter

    if Path(folder).exists() and not overwrite:
        raise UsageError(f"{os.fspath(folder)} exists.", "Give overwrite=True to replace it.")
    chosen = list(motions)
    if not chosen:
        raise UsageError("No motions were given to write.", "Give at least one.")
    licences = sorted({motion.licence for motion in chosen if motion.licence})
    with (
        write_artefact(folder, "motion", stage="python", config={"split": split}, licences=licences) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for motion in chosen:
            row = ClipRow(
                motion.name,
                motion.name,
                hashlib.sha256(motion.source or motion.record.rotations.tobytes()).hexdigest(),
                writer.add_skeleton(motion.skeleton),
                motion.frames,
                motion.fps,
                motion.seconds,
                split,
                motion.licence,
            )
            writer.add_clip(row, motion.record)
    return len(chosen)
