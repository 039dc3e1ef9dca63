"""Joint angles of a robot as text (Unitree's and many others' layout), on the skeleton of its URDF.

A line a frame: the root's place x, y, z in metres, Z up; its rotation as a quaternion x, y, z, w; then the angle of
every joint that turns, radians, in the URDF's order. A line of column names may come first; then it gives the order.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field

import numpy as np

from data_schemas.errors import InputError
from stages.shared.formats import euler
from stages.shared.formats.figure import Poses
from stages.shared.formats.recording import Asked, Recording, check_room, recording_of
from stages.shared.formats.robot_rig import TO_FIGURE, RobotRig, robot_rig
from stages.shared.formats.urdf import looks_urdf

USUAL_FPS = 30.0
ROOT_COLUMNS = ("root_x", "root_y", "root_z", "root_qx", "root_qy", "root_qz", "root_qw")
_MOST_COLUMNS = 20_000
_UNIT = 1e-2  # how far from 1 the length of a quaternion may be
_FARTHEST_M = 1e5
_MOST_TURNS = 1e4
_ROOT_NAME = re.compile(
    r"(?:root|base|pelvis|floating_base|torso)?[._ ]*"
    r"(?:(?P<place>pos|position|trans|translation|t|p)?[._ ]*(?P<axis>[xyz])"
    r"|(?P<turn>rot|rotation|quat|quaternion|orientation|orn|q|r)[._ ]*(?P<part>[xyzw]))"
)
_COUNTS = ("frame", "frames", "index", "frame_index", "")


@dataclass(frozen=True)
class RobotTable:
    """What a file holds: rows (T, 7 + M) in the order x, y, z, qx, qy, qz, qw, then the URDF's angles.

    lines: the T lines as they stand. heads: lines before the first row, with their ends.
    columns: (7 + M,) of which cell of a line each value is; cells: how many cells a line has.
    """

    name: str
    values: np.ndarray
    columns: np.ndarray
    cells: int
    separator: str
    lines: list[bytes] = field(repr=False)
    heads: bytes = b""


def read_robot_csv(data: bytes, name: str, asked: Asked) -> list[Recording]:
    """The one clip of a robot's joint angles, on the URDF `asked.rig`. Raises InputError naming line and column."""
    rig = rig_asked(name, asked)
    table = read_table(data, name, rig)
    check_room(name, len(data), len(table.values), len(rig.names))
    notes: list[str] = []
    if _written_w_first(table.values[:, 3:7]):
        notes.append("The robot is upside down; the quaternions seem to be w x y z where x y z w is read.")
    remarks = []
    fps = asked.fps_override
    if fps is None:
        fps = USUAL_FPS
        remarks.append(f"It tells no frame rate; taken as {USUAL_FPS:g} frames a second.")
    return [recording_of(name, rig.figure(), poses_of(table.values, rig, fps), asked, notes=notes, remarks=remarks)]


def rig_asked(name: str, asked: Asked) -> RobotRig:
    """The robot that a file's angles are of. Raises InputError where no URDF was given."""
    if not looks_urdf(asked.rig):
        given = f"{asked.rig_name} is no URDF" if asked.rig_name else "no URDF lies beside it"
        raise InputError(
            f"{name} holds angles of joints and no skeleton: {given}.",
            "Give the robot's URDF with --skeleton robot.urdf ('archive.zip!robot.urdf' too).",
        )
    return robot_rig(asked.rig, asked.rig_name)


def poses_of(values: np.ndarray, rig: RobotRig, fps: float) -> Poses:
    """What rows say, in a figure's axes.

    Args:
        values: (T, 7 + M) rows of a RobotTable.
    """
    angles = np.zeros((len(values), len(rig.names)))
    moved = rig.columns >= 0
    angles[:, moved] = values[:, 7 + rig.columns[moved]] * rig.factors[moved] + rig.shifts[moved]
    local = np.empty((*angles.shape, 4))
    local[..., :3] = np.sin(angles / 2)[..., None] * rig.axes
    local[..., 3] = np.cos(angles / 2)
    local = euler.multiply(rig.at_zero, local)
    root = values[:, 3:7][:, (*TO_FIGURE, 3)]
    local[:, 0] = root / np.linalg.norm(root, axis=1, keepdims=True)
    return Poses(local, values[:, :3][:, TO_FIGURE].copy(), fps)


def read_table(data: bytes, name: str, rig: RobotRig, *, keep_unreadable_rows: bool = False) -> RobotTable:
    """The rows of a file.

    Args:
        keep_unreadable_rows: True to take rows that hold anything else than numbers as rows of NaN.
    Raises: InputError naming the line, and the column by its joint.
    """
    if b"\0" in data[:4096]:
        raise InputError(f"{name} is not plain text.", "Is this a CSV file?")
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    lines = data.removeprefix(b"\xef\xbb\xbf").split(b"\n")
    while lines and not lines[-1].strip():
        lines.pop()
    start = next((at for at, line in enumerate(lines) if line.strip()), len(lines))
    if start == len(lines):
        raise InputError(f"{name} has no rows.")
    first = lines[start].decode("utf-8", errors="replace").strip()
    separator = max((";", "\t", ","), key=first.count)
    cells = [cell.strip().strip('"') for cell in first.split(separator)]
    if len(cells) > _MOST_COLUMNS:
        raise InputError(f"{name} has {len(cells)} columns, and {_MOST_COLUMNS} are the most.")
    begins = start
    if 2 * sum(_is_number(_with_point(cell, separator)) for cell in cells) > len(cells):  # else a line of names
        columns = _columns_by_count(len(cells), name, rig)
    else:
        columns = _columns_by_name(cells, f"{name}, line {start + 1}", rig)
        begins = start + 1
    heads = b"".join(line + b"\n" for line in lines[:begins])
    lines = lines[begins:]
    if not lines:
        raise InputError(f"{name} has no rows.")
    raw = _numbers(lines, separator, len(cells))
    if raw is None:
        raw = _line_by_line(lines, separator, len(cells), name, begins, keep_unreadable_rows)
    values = raw[:, columns]
    table = RobotTable(name, values, columns, len(cells), separator, lines, heads)
    if not keep_unreadable_rows:
        check_rows(table, rig, np.arange(len(values)), begins)
    return table


def check_rows(table: RobotTable, rig: RobotRig, rows: np.ndarray, begins: int = 0) -> None:
    """Raise InputError for the first of the rows that is no pose, naming line and column. begins: lines before."""
    names = (*ROOT_COLUMNS, *rig.angle_names)
    values = table.values[rows]
    most = np.array([_FARTHEST_M] * 3 + [2.0] * 4 + [_MOST_TURNS] * len(rig.angle_names))
    with np.errstate(invalid="ignore"):
        bad = ~(np.abs(values) <= most)
    if bad.any():
        row, column = (int(i[0]) for i in np.nonzero(bad))
        what = "is no finite number" if not np.isfinite(values[row, column]) else f"is {values[row, column]:g}"
        raise InputError(
            f"{table.name}, line {begins + int(rows[row]) + 1}: {names[column]} {what}.", "Mend or leave out the row."
        )
    lengths = np.linalg.norm(values[:, 3:7], axis=1)
    off = np.flatnonzero(np.abs(lengths - 1) > _UNIT)
    if len(off):
        raise InputError(
            f"{table.name}, line {begins + int(rows[off[0]]) + 1}: the root's quaternion (columns 4 to 7) has the"
            f" length {lengths[off[0]]:.3g}, expected 1.",
            "Are the columns x, y, z in metres, then the quaternion x, y, z, w, then the angles?",
        )


def _columns_by_count(count: int, name: str, rig: RobotRig) -> np.ndarray:
    wanted = len(ROOT_COLUMNS) + len(rig.angle_names)
    if count != wanted:
        raise InputError(
            f"{name} has {count} columns, expected {wanted}: place, quaternion and the {len(rig.angle_names)} angles"
            f" of {rig.source}.",
            "Is it the URDF of another model of the robot?",
        )
    return np.arange(wanted)


def _columns_by_name(cells: list[str], where: str, rig: RobotRig) -> np.ndarray:
    """The cell of each value by the names in the first line. Raises InputError for names that are none."""
    found: dict[str, int] = {}
    joints = {_key(joint): joint for joint in rig.angle_names}
    for index, cell in enumerate(cells):
        name = joints.get(_key(cell)) or _root_column(cell)
        if name is None:
            if cell.lower() in _COUNTS:
                continue
            raise InputError(f"{where}: '{cell[:60]}' is no joint of {rig.source} and no part of the root's pose.")
        if name in found:
            raise InputError(f"{where}: the column '{cell[:60]}' stands twice.")
        found[name] = index
    wanted = (*ROOT_COLUMNS, *rig.angle_names)
    missing = [name for name in wanted if name not in found]
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise InputError(f"{where}: there is no column for {missing[0]}{more}.", f"{rig.source} has that joint.")
    return np.array([found[name] for name in wanted])


def _key(name: str) -> str:
    name = name.lower().removesuffix("_pos").removesuffix("_dof")
    return name.removesuffix("_joint")


def _root_column(cell: str) -> str | None:
    match = _ROOT_NAME.fullmatch(cell.lower())
    if match is None:
        return None
    return f"root_q{match['part']}" if match["turn"] else f"root_{match['axis']}"


def _with_point(cell: str, separator: str) -> str:
    """The cell with a decimal point where spreadsheets write a comma."""
    return cell.replace(",", ".") if separator == ";" else cell


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _numbers(lines: list[bytes], separator: str, count: int) -> np.ndarray | None:
    """(T, count) of lines that hold plain numbers, None where one does not."""
    mark = separator.encode()
    if any(line.count(mark) != count - 1 for line in lines):
        return None
    text = b",".join(lines)
    if mark != b",":
        text = text.replace(mark, b",")
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # how NumPy says that a word was no number
        try:
            values = np.fromstring(text, dtype=np.float64, sep=",")
        except (ValueError, DeprecationWarning):
            return None
    return values.reshape(-1, count) if len(values) == count * len(lines) else None


def _line_by_line(
    lines: list[bytes], separator: str, count: int, name: str, begins: int, keep_unreadable: bool
) -> np.ndarray:
    """The same, one line after another: says what is wrong and where."""
    values = np.full((len(lines), count), np.nan)
    for row, line in enumerate(lines):
        text = line.decode("utf-8", errors="replace")
        cells = [_with_point(cell.strip().strip('"'), separator) for cell in text.split(separator)]
        bad = next((cell for cell in cells if not _is_number(cell)), None)
        if len(cells) == count and bad is None:
            values[row] = [float(cell) for cell in cells]
        elif keep_unreadable:
            continue
        elif len(cells) != count:
            raise InputError(
                f"{name}, line {begins + row + 1}: {len(cells)} cells where there are {count} columns.",
                "Is the file truncated?",
            )
        else:
            raise InputError(f"{name}, line {begins + row + 1}: '{(bad or '')[:40]}' is no number.")
    return values


def _written_w_first(quaternions: np.ndarray) -> bool:
    """Whether the root stands on its head as x y z w and upright as w x y z, in most frames."""
    x, y, z, w = quaternions.T
    as_read = np.median(1 - 2 * (x * x + y * y))
    w_first = np.median(1 - 2 * (y * y + z * z))
    return bool(as_read < -0.5 and w_first > 0.5) and abs(float(np.median(w))) < 0.5
