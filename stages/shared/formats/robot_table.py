"""The text of a robot's joint angles: rows of numbers, with or without a line of names before them.

Lines are kept verbatim, so that a table can be written back with only some of its rows changed.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from data_schemas.errors import InputError
from stages.shared.formats.robot_rig import RobotRig
from stages.shared.formats.table_columns import decimal_commas_hint
from stages.shared.formats.text_cells import safe_line, text_of_cell

ROOT_COLUMNS = ("root_x", "root_y", "root_z", "root_qx", "root_qy", "root_qz", "root_qw")
_MOST_COLUMNS = 20_000
_UNIT = 1e-2  # how far from 1 the length of a quaternion may be
_FARTHEST_M = 1e5
_MOST_TURNS = 1e4
_ROOT_NAME = re.compile(
    r"(?:root|base|pelvis|floating_base|torso)?[._ ]*"
    r"(?:(?:(?P<place>pos|position|trans|translation|t|p)[._ ]*)?(?P<axis>[xyz])"
    r"|(?P<turn>rot|rotation|quat|quaternion|orientation|orn|q|r)[._ ]*(?P<part>[xyzw]))"
)
USUAL_DECIMALS, _MOST_DECIMALS = 6, 12
_SEPARATORS = (",", ";", "\t")
_BOM = b"\xef\xbb\xbf"
_COUNTS = ("frame", "frames", "index", "frame_index", "")


@dataclass(frozen=True)
class RobotTable:
    """The content of a file.

    raw:     (T, C) numbers of all cells; rows of NaN for lines that are not numbers (if they are kept).
    columns: (7 + M,) index of the cell of x, y, z, qx, qy, qz, qw and of each of the URDF's angles.
    lines:   the T lines verbatim, without their ends. head, end: the text before and after them.
    first_line: the number, from 1, of the first row's line.
    """

    name: str
    raw: np.ndarray
    columns: np.ndarray
    lines: list[bytes] = field(repr=False)
    separator: str = ","
    newline: bytes = b"\n"
    head: bytes = b""
    end: bytes = b"\n"
    first_line: int = 1

    @property
    def values(self) -> np.ndarray:
        """(T, 7 + M) rows in the order x, y, z, qx, qy, qz, qw, then the URDF's angles."""
        return self.raw[:, self.columns]

    @property
    def frames(self) -> int:
        return len(self.lines)


def read_table(data: bytes, name: str, rig: RobotRig, *, keep_unreadable_rows: bool = False) -> RobotTable:
    """The rows of a file.

    Args:
        keep_unreadable_rows: return rows of NaN for lines that are not numbers instead of refusing the file.
    Raises: InputError naming the line, and the column by its joint.
    """
    if b"\0" in data[:4096]:
        raise InputError(f"{name} is not plain text.", "Is this a CSV file?")
    newline = b"\n" if b"\n" in data else b"\r"
    mark = _BOM if data.startswith(_BOM) else b""
    lines = data.removeprefix(mark).split(newline)
    after = len(lines)
    while after and not lines[after - 1].strip():
        after -= 1
    start = next((at for at, line in enumerate(lines[:after]) if line.strip()), after)
    if start == after:
        raise InputError(f"{name} has no rows.")
    if lines[start].count(b",") > _MOST_COLUMNS:
        raise InputError(f"{name} has {lines[start].count(b',') + 1} columns; pumps reads at most {_MOST_COLUMNS}.")
    wanted = len(ROOT_COLUMNS) + len(rig.angle_names)
    separator = _separator(lines[start:after] if keep_unreadable_rows else lines[start : start + 1], wanted)
    cells = [text_of_cell(cell) for cell in _cells(lines[start], separator)]
    begins = start
    if _are_names(cells, rig):
        columns = _columns_by_name(cells, f"{name}, line {start + 1}", rig)
        count, begins = len(cells), start + 1
    else:
        if not keep_unreadable_rows and len(cells) != wanted:
            raise _wrong_count(len(cells), name, rig)
        columns, count = np.arange(wanted), wanted
    head = mark + b"".join(line + newline for line in lines[:begins])
    end = newline.join([b"", *lines[after:]])
    lines = lines[begins:after]
    if not lines:
        raise InputError(f"{name} has no rows.")
    raw = _numbers(lines, separator, count)
    if raw is None:
        raw = _line_by_line(lines, separator, count, name, begins, keep_unreadable_rows)
    table = RobotTable(name, raw, columns, lines, separator, newline, head, end, begins + 1)
    if not keep_unreadable_rows:
        check_rows(table, rig, np.arange(len(lines)))
    return table


def check_rows(table: RobotTable, rig: RobotRig, rows: np.ndarray) -> None:
    """Raise InputError for the first of the rows (K,) that is not a pose, naming line and column."""
    names = (*ROOT_COLUMNS, *rig.angle_names)
    values = table.values[rows]
    most = np.array([_FARTHEST_M] * 3 + [2.0] * 4 + [_MOST_TURNS] * len(rig.angle_names))
    with np.errstate(invalid="ignore"):
        bad = ~(np.abs(values) <= most)
    if bad.any():
        row, column = (int(i[0]) for i in np.nonzero(bad))
        what = "is not a finite number" if not np.isfinite(values[row, column]) else f"is {values[row, column]:g}"
        raise InputError(
            f"{table.name}, line {table.first_line + int(rows[row])}: {names[column]} {what}.",
            "Correct or remove the row.",
        )
    lengths = np.linalg.norm(values[:, 3:7], axis=1)
    off = np.flatnonzero(np.abs(lengths - 1) > _UNIT)
    if len(off):
        raise InputError(
            f"{table.name}, line {table.first_line + int(rows[off[0]])}: the root's quaternion (columns 4 to 7) has"
            f" the length {lengths[off[0]]:.3g}, expected 1.",
            "Are the columns x, y, z in metres, then the quaternion x, y, z, w, then the angles?",
        )


def table_with_rows(table: RobotTable, values: np.ndarray, kept: Mapping[int, int], keys: Mapping[int, int]) -> bytes:
    """The bytes of the table with other rows.

    Args:
        values: (T, 7 + M) rows to write; those of frames in `kept` are ignored.
        kept: frame to write -> row of `table` whose line is copied byte for byte.
        keys: those of `kept` whose rows are numbers; new rows are written with as many digits.
    """
    made = np.setdiff1d(np.arange(len(values)), np.fromiter(kept, np.int64, len(kept)))
    first, last = min(keys), max(keys)
    like = table.lines[keys[first]]
    # Cells that are not part of a pose are frame numbers or times: they are continued linearly.
    begin, finish = table.raw[keys[first]], table.raw[keys[last]]
    raw = begin + (finish - begin) / max(last - first, 1) * (made[:, None] - first)
    raw[:, table.columns] = values[made]
    commas = table.separator == ";" and b"," in like
    made_lines = lines_of_rows(raw, _decimals(like, commas), table.separator)
    lines: list[bytes] = [b""] * len(values)
    for frame, line in zip(made.tolist(), made_lines, strict=True):
        lines[frame] = (line.replace(b".", b",") if commas else line) + (b"\r" if like.endswith(b"\r") else b"")
    for frame, row in kept.items():
        lines[frame] = table.lines[row]
    return _safe_head(table) + table.newline.join(lines) + table.end


def _safe_head(table: RobotTable) -> bytes:
    """The text before the rows, with names of columns that a spreadsheet takes for formulas made texts."""
    lines = table.head.decode("latin-1").split(table.newline.decode())
    return table.newline.decode().join(safe_line(line, table.separator) for line in lines).encode("latin-1")


def lines_of_rows(values: np.ndarray, decimals: int = USUAL_DECIMALS, separator: str = ",") -> list[bytes]:
    """Rows (T, C) as lines without their ends."""
    pattern = separator.join([f"%.{decimals}f"] * values.shape[1])
    rounded = np.round(values, decimals) + 0.0  # + 0.0 turns -0.0 into 0.0
    return [(pattern % tuple(row)).encode() for row in rounded.tolist()]


def _decimals(line: bytes, commas: bool) -> int:
    """The most decimals of a line's numbers; the usual count if they are written with exponents."""
    if b"e" in line.lower():
        return USUAL_DECIMALS
    found = re.findall(rb"\d,(\d+)" if commas else rb"\d\.(\d+)", line)
    return min(max(map(len, found), default=USUAL_DECIMALS), _MOST_DECIMALS)


def _separator(lines: list[bytes], wanted: int) -> str:
    """The separator of the first line that has the wanted number of cells, else of the first line."""
    for line in lines:
        for separator in _SEPARATORS:
            if line.count(separator.encode()) == wanted - 1:
                return separator
    return max(_SEPARATORS, key=lambda each: lines[0].count(each.encode()))


def _cells(line: bytes, separator: str) -> list[str]:
    return [cell.strip().strip('"') for cell in line.decode("utf-8", errors="replace").split(separator)]


def _are_names(cells: list[str], rig: RobotRig) -> bool:
    """Whether a line holds column names: some name a part of a pose, and most are not numbers."""
    joints = {_key(joint) for joint in rig.angle_names}
    named = sum(_root_column(cell) is not None or _key(cell) in joints for cell in cells)
    return named > 0 and 2 * sum(map(_is_number, cells)) < len(cells)


def _wrong_count(count: int, name: str, rig: RobotRig) -> InputError:
    wanted = len(ROOT_COLUMNS) + len(rig.angle_names)
    return InputError(
        f"{name} has {count} columns, expected {wanted}: place, quaternion and the {len(rig.angle_names)} angles"
        f" of {rig.source}.",
        "Is it the URDF of another model of the robot?",
    )


def _columns_by_name(cells: list[str], where: str, rig: RobotRig) -> np.ndarray:
    """The cell of each value, by the names in the first line. Raises InputError for unknown names."""
    found: dict[str, int] = {}
    joints = {_key(joint): joint for joint in rig.angle_names}
    for index, cell in enumerate(cells):
        name = joints.get(_key(cell)) or _root_column(cell)
        if name is None:
            if cell.lower() in _COUNTS:
                continue
            raise InputError(
                f"{where}: '{cell[:60]}' is neither a joint of {rig.source} nor a part of the root's pose."
            )
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
    """The cell with a decimal point instead of a spreadsheet's decimal comma."""
    return cell.replace(",", ".") if separator == ";" else cell


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _numbers(lines: list[bytes], separator: str, count: int) -> np.ndarray | None:
    """(T, count) numbers of the lines; None if a line is not plain numbers."""
    mark = separator.encode()
    if any(line.count(mark) != count - 1 for line in lines):
        return None
    text = b",".join(lines)
    if mark != b",":
        text = text.replace(mark, b",")
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # NumPy's sign that a word was not a number
        try:
            values = np.fromstring(text, dtype=np.float64, sep=",")
        except (ValueError, DeprecationWarning):
            return None
    return values.reshape(-1, count) if len(values) == count * len(lines) else None


def _line_by_line(
    lines: list[bytes], separator: str, count: int, name: str, begins: int, keep_unreadable: bool
) -> np.ndarray:
    """The same, slower, line by line. Raises InputError naming line and fault."""
    values = np.full((len(lines), count), np.nan)
    for row, line in enumerate(lines):
        cells = [_with_point(cell, separator) for cell in _cells(line, separator)]
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
            raise InputError(
                f"{name}, line {begins + row + 1}: '{(bad or '')[:40]}' is not a number.",
                decimal_commas_hint(bad or ""),
            )
    return values
