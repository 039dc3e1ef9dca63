"""The file that is cleaned: its motion with missing rows marked, and the result as bytes of a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import sentences_of
from data_schemas.skeleton import Motion, Skeleton
from stages.denoise.config import Config
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_motion import motion_of, rate_of
from stages.shared.formats.bvh_rows import layout_of, values_of
from stages.shared.formats.bvh_write import write_bvh
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.skeleton_map import choose_map, read_skeleton_map
from stages.shared.formats.sources import source_named
from stages.shared.formats.writers import bytes_of_motion, written_format


@dataclass(frozen=True)
class MotionFile:
    """A file's motion. empty: (T,) True for rows that hold no pose; the motion's frames there mean nothing."""

    name: str
    skeleton: Skeleton
    motion: Motion
    empty: np.ndarray
    notes: tuple[str, ...] = ()
    bvh: BvhFile | None = None
    stated_fps: bool = True

    def written(
        self, output: Path, motion: Motion, changed: np.ndarray, moved: np.ndarray
    ) -> tuple[bytes, list[str]]:
        """The cleaned file. A BVH that is written as BVH keeps the bytes of frames in which nothing changed, and the
        numbers of joints that did not change.

        Args:
            changed: (T, J) True where a joint's rotation changed. moved: (T,) True where a position did.
        """
        if self.bvh is None or output.suffix.lower() != ".bvh":
            return bytes_of_motion(written_format(output), self.skeleton, motion, output.stem)
        touched = changed.any(axis=1) | moved
        near = np.where(self.empty[:, None], np.nan, self.bvh.values)
        values = values_of(self.bvh, self.skeleton, motion, near)
        layout = layout_of(self.bvh.joints)
        keep = np.zeros(values.shape, bool)
        for _, joints, columns in layout.rotations:
            for joint, at in zip(joints, columns, strict=True):
                keep[:, at] = ~changed[:, joint, None]
        keep[:, layout.position_columns] = ~moved[:, None]
        values = np.where(keep & ~self.empty[:, None], self.bvh.values, values)
        kept = {int(frame): int(frame) for frame in np.flatnonzero(~touched)}
        frame_time = None if self.stated_fps else 1.0 / motion.fps
        return write_bvh(self.bvh, values, kept, frame_time=frame_time), []


def motion_file(config: Config) -> MotionFile:
    """Read the input. Rows of a BVH that are not numbers, or hold zeros only, are empty.

    Raises: InputError naming the file if it holds no humanoid, several clips, or no frame.
    """
    source = source_named(str(config.input))
    maps = (read_skeleton_map(config.skeleton_map),) if config.skeleton_map else ()
    if source.suffix == ".bvh":
        bvh = read_bvh(source.read(), source.name, keep_unreadable_rows=True)
        choose_map(maps, [joint.name for joint in bvh.joints], must_fit=bool(maps))
        there = np.asarray(np.isfinite(bvh.values).all(axis=1))
        zero = there & np.asarray((bvh.values == 0).all(axis=1))
        if (there & ~zero).sum() >= 1:
            there &= ~zero
        if not there.any():
            raise InputError(f"{source.name} has no frame with numbers in it.", "Is the file truncated?")
        rows = np.flatnonzero(there)
        skeleton, motion, notes = motion_of(bvh.select(rows), fps_override=config.fps_override, skeleton_maps=maps)
        last_before = np.maximum(np.searchsorted(rows, np.arange(bvh.frames), side="right") - 1, 0)
        stated = config.fps_override is None or config.fps_override == rate_of(bvh.frame_time)
        return MotionFile(source.name, skeleton, motion.at(last_before), ~there, tuple(notes), bvh, stated)
    asked = Asked(fps_override=config.fps_override, skeleton_maps=maps)
    found = list(recordings_in(source, asked))
    if len(found) != 1:
        raise InputError(
            f"{source.name} holds {len(found)} clips, and one is cleaned at a time.",
            "Export the clip first: pumps export FILE --clip NAME -o clip.bvh.",
        )
    recording = found[0]
    choose_map(maps, recording.skeleton.names, must_fit=bool(maps))
    notes = sentences_of(recording.notes)
    return MotionFile(
        source.name, recording.skeleton, recording.motion, np.zeros(recording.motion.frames, bool), tuple(notes)
    )
