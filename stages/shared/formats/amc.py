"""The motion file of Acclaim's ASF/AMC: for each frame its number, then one line of values per moving bone."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from data_schemas.errors import InputError
from data_schemas.notes import Flag, Note, note
from stages.shared.formats import euler
from stages.shared.formats.asf import AsfBone, AsfSkeleton, read_asf
from stages.shared.formats.recording import Asked, Recording, recording_of
from stages.shared.formats.source_body import SourcePoses, SourceRig
from stages.shared.humanoid.reference_pose import PLAUSIBLE_STATURE_M
from stages.shared.kinematics.rotations import CONJUGATE, multiply

USUAL_FPS = 120.0  # CMU's rate; few AMC files state one
_BLOCK = 1 << 20
_BONE = re.compile(rb"(?m)^[ \t]*[A-Za-z_]\S*")


@dataclass(frozen=True)
class AmcMotion:
    """values: (T, C) as written, the channels of `lines` one after another. fps: None if the file states none."""

    values: np.ndarray
    lines: tuple[AsfBone, ...]
    in_degrees: bool
    fps: float | None
    notes: list[Note] = field(default_factory=list)


def read_asf_amc(data: bytes, name: str, asked: Asked) -> list[Recording]:
    """The clip of an AMC on the skeleton of `asked.rig`, an ASF. Raises InputError naming file and line."""
    if not asked.rig:
        raise InputError(
            f"{name} has no skeleton: there is no ASF in its folder.",
            "Put its .asf into the same folder, or give --skeleton.",
        )
    skeleton = read_asf(asked.rig, asked.rig_name)
    motion = read_amc(data, name, skeleton)
    remarks = []
    fps = asked.fps_override or motion.fps
    if fps is None:
        fps = USUAL_FPS
        remarks.append(note(Flag.NO_FRAME_RATE, fps=USUAL_FPS))
    return [
        recording_of(name, _rig(skeleton), _poses(skeleton, motion, fps), asked, notes=motion.notes, remarks=remarks)
    ]


def read_amc(data: bytes, name: str, skeleton: AsfSkeleton) -> AmcMotion:
    """Parse an AMC. Raises InputError naming file, line and bone."""
    if b"\0" in data[:4096]:
        raise InputError(f"{name} is not plain text.", "Is this an AMC file?")
    if b"\n" not in data and b"\r" in data:
        data = data.replace(b"\r", b"\n")
    start, line, degrees, fps = _head(data, name, skeleton.in_degrees)
    lines, shared = _first_frame(data, start, name, line, skeleton)
    values = _even_frames(data, start, shared)
    if values is None:
        values = _frame_by_frame(data, start, name, line, lines)
    notes = []
    steps = np.diff(values[:, 0])
    if (steps != 1).any():
        at = int(np.argmax(steps != 1))
        notes.append(note(Flag.FRAMES_MISSING, frame=float(values[at, 0]), following=float(values[at + 1, 0])))
    if any(channel not in ("rx", "ry", "rz") for bone in lines for channel in bone.channels if bone.parent >= 0):
        notes.append(note(Flag.BONES_STRETCH))
    return AmcMotion(values[:, 1:], lines, degrees, fps, notes)


def _head(data: bytes, name: str, degrees: bool) -> tuple[int, int, bool, float | None]:
    """Offset and line of the first frame's number, whether angles are in degrees, and the rate if it is stated."""
    fps, at, line = None, 0, 0
    while at < len(data) and line < 1000:
        end = data.find(b"\n", at)
        end = len(data) if end < 0 else end
        text = data[at : min(end, at + 200)].strip()
        line += 1
        if text.isdigit():
            return at, line, degrees, fps
        words = text.lower().split()
        if text and not text.startswith((b"#", b":")):
            break
        if words[:1] in ([b":degrees"], [b":radians"]):
            degrees = words[0] == b":degrees"
        if words[:1] == [b":samples-per-second"] and len(words) > 1:
            fps = _number(words[1])
            if not 0 < fps <= 10_000:
                raise InputError(f"{name}, line {line}: the rate is not a number of samples per second.")
        at = end + 1
    raise InputError(f"{name}, line {line}: expected the number of the first frame.", "Is this an AMC file?")


def _number(word: bytes) -> float:
    try:
        return float(word) if b"_" not in word else float("nan")
    except ValueError:
        return float("nan")


def _first_frame(
    data: bytes, start: int, name: str, line: int, skeleton: AsfSkeleton
) -> tuple[tuple[AsfBone, ...], list[bytes]]:
    """The bones in the order of the first frame's lines, and its words with b"" in place of each number."""
    bones = {bone.name.lower(): bone for bone in skeleton.bones}
    listed: list[AsfBone] = []
    pattern = [b""]
    for number, words in enumerate(_lines(data, start), start=line):
        if not words or number == line:
            continue
        if words[0].isdigit():
            break
        bone = _bone_of(words, bones, name, number)
        if bone in listed:
            raise InputError(f"{name}, line {number}: bone '{bone.name}' occurs twice in a frame.")
        listed.append(bone)
        pattern += [words[0], *[b""] * len(bone.channels)]
    if not listed or "root" not in (bone.name for bone in listed):
        raise InputError(f"{name}, line {line}: the first frame has no line for the root.", "Is the file truncated?")
    return tuple(listed), pattern


def _bone_of(words: list[bytes], bones: dict[str, AsfBone], name: str, line: int) -> AsfBone:
    bone = bones.get(words[0].decode("latin-1").lower())
    if bone is None:
        shown = words[0].decode("latin-1")[:60]
        raise InputError(f"{name}, line {line}: the skeleton has no bone '{shown}'.", "Is it another subject's ASF?")
    if len(words) != 1 + len(bone.channels):
        raise InputError(
            f"{name}, line {line}: bone '{bone.name}' has {len(words) - 1} values for {len(bone.channels)} channels"
            f" ({' '.join(bone.channels)}).",
            "Is the file truncated?",
        )
    return bone


def _lines(data: bytes, start: int) -> Iterator[list[bytes]]:
    """The words of one line after another."""
    for block in _blocks(data, start):
        for line in block.splitlines():
            yield line.split()


def _blocks(data: bytes, start: int) -> Iterator[bytes]:
    """The text from `start` on in blocks of whole lines, so that only one block at a time is split into words."""
    while start < len(data):
        end = data.rfind(b"\n", start, start + _BLOCK) + 1
        if end <= start:
            end = min(start + _BLOCK, len(data))
        yield data[start:end]
        start = end


def _even_frames(data: bytes, start: int, pattern: list[bytes]) -> np.ndarray | None:
    """(T, 1 + C) frame numbers and values if all frames have the same lines in the same order; else None."""
    width, names = len(pattern), [(i, word) for i, word in enumerate(pattern) if word]
    found, phase = [], 0
    parse = np.fromstring  # text mode: the fastest number parser at hand, exact to the last bit
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # NumPy's sign that a word was not a number
        for block in _blocks(data, start):
            words = block.split()
            for index, word in names:
                column = words[(index - phase) % width :: width]
                if column.count(word) != len(column):
                    return None
            phase = (phase + len(words)) % width
            bare = _BONE.sub(b"", block)
            if not bare or bare.isspace():
                continue
            try:
                found.append(parse(bare, dtype=np.float64, sep=" "))
            except (ValueError, DeprecationWarning):
                return None
    values = np.concatenate(found)
    columns = width - len(names)
    if phase or len(values) % columns or not np.isfinite(values).all():
        return None
    return values.reshape(-1, columns)


def _frame_by_frame(data: bytes, start: int, name: str, line: int, lines: Sequence[AsfBone]) -> np.ndarray:
    """The same for bones in any order, slower, line by line. Raises InputError naming line and bone."""
    bones = {bone.name.lower(): bone for bone in lines}
    starts = np.cumsum([1, *(len(bone.channels) for bone in lines)])
    place = {bone.name: int(start) for bone, start in zip(lines, starts, strict=False)}
    frames: list[np.ndarray] = []
    row, seen = np.zeros(0), set()
    for number, words in enumerate(_lines(data, start), start=line):
        if not words:
            continue
        if len(words) == 1 and words[0].isdigit():
            if frames:
                _check_whole(name, number, frames, seen, bones)
            row, seen = np.zeros(starts[-1]), set()
            row[0] = _number(words[0][:15])
            frames.append(row)
            continue
        bone = _bone_of(words, bones, name, number)
        if bone.name in seen:
            raise InputError(f"{name}, line {number}: bone '{bone.name}' occurs twice in a frame.")
        seen.add(bone.name)
        values = [_number(word) for word in words[1:]]
        if not np.isfinite(values).all():
            raise InputError(f"{name}, line {number}: a value of bone '{bone.name}' is not a finite number.")
        row[place[bone.name] : place[bone.name] + len(values)] = values
    _check_whole(name, number, frames, seen, bones)
    return np.stack(frames)


def _check_whole(name: str, line: int, frames: list[np.ndarray], seen: set[str], bones: dict[str, AsfBone]) -> None:
    missing = [bone.name for bone in bones.values() if bone.name not in seen]
    if missing:
        raise InputError(
            f"{name}, line {line}: frame {frames[-1][0]:g} has no line for bone '{missing[0]}'.",
            "Is the file truncated?",
        )


def _rig(skeleton: AsfSkeleton) -> SourceRig:
    """A joint at each bone's head. A bone's vector is the offset of its children, or the end site of a leaf."""
    bones = skeleton.bones
    parents = tuple(bone.parent for bone in bones)
    nowhere = (0.0, 0.0, 0.0)
    leaves = set(range(len(bones))) - set(parents)
    offsets = tuple(bones[bone.parent].vector if bone.parent > 0 else nowhere for bone in bones)
    size = sum(np.linalg.norm(bone.vector) for bone in bones if bone.name.lower().startswith(("lfem", "ltib")))
    low, high = PLAUSIBLE_STATURE_M
    return SourceRig(
        names=tuple(bone.name for bone in bones),
        parents=parents,
        offsets=offsets,
        end_sites=tuple(bone.vector if index in leaves else nowhere for index, bone in enumerate(bones)),
        placed=tuple(index == 0 for index in range(len(bones))),
        unit_m=skeleton.unit_m if low < 2 * size * skeleton.unit_m < high else None,
    )


def _poses(skeleton: AsfSkeleton, motion: AmcMotion, fps: float) -> SourcePoses:
    frames = len(motion.values)
    place = {bone.name: index for index, bone in enumerate(skeleton.bones)}
    local = np.zeros((frames, len(place), 4))
    local[..., 3] = 1.0
    root = np.tile(np.array(skeleton.root_position), (frames, 1))
    first = 0
    for bone in motion.lines:
        columns = motion.values[:, first : first + len(bone.channels)]
        first += len(bone.channels)
        turning = [i for i, channel in enumerate(bone.channels) if channel.startswith("r")]
        angles = columns[:, turning] if motion.in_degrees else np.degrees(columns[:, turning])
        moved = _about_fixed_axes(angles, "".join(bone.channels[i][1] for i in turning))
        tilt = _about_fixed_axes(np.array([[bone.axis["xyz".index(a)] for a in bone.axis_order]]), bone.axis_order)
        if bone.parent < 0:
            local[:, 0] = multiply(moved, tilt)
            for i, channel in enumerate(bone.channels):
                if channel.startswith("t"):
                    root[:, "xyz".index(channel[1])] += columns[:, i]
        else:
            back = tilt * CONJUGATE
            local[:, place[bone.name]] = multiply(multiply(tilt, moved), back)
    return SourcePoses(local, root, fps)


def _about_fixed_axes(angles: np.ndarray, order: str) -> np.ndarray:
    """Quaternions (T, 4) of degrees (T, n) about world axes, applied in the order of `order`."""
    return euler.to_quaternions(angles[:, ::-1], order[::-1].upper())
