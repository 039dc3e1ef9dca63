"""Several fills of one gap: a scene of the player, how far they are from each other by frame, and a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError, UsageError
from stages.report.chart_axes import even_ticks
from stages.report.config import Config
from stages.report.drawings import Heading
from stages.report.line_charts import line_chart
from stages.report.results import table_html
from stages.report.scenes import SLERP, Played, played_file, played_scene, slerped
from stages.shared.formats.sources import find_sources
from stages.shared.inference.keyframes import parse_keyframes
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.markup import Markup, joined, markup
from stages.shared.statistics.feel import jerk_mps3
from stages.shared.statistics.measurements import TRUTH
from stages.shared.statistics.table import Entry, Row, Table

TITLE = "Several fills"
LEGEND = (
    "Distances are means over the body's joints, in millimetres; in the table also over the frames between keys. "
    "Where the truth is farther from the fills' mean than the fills are, the fills do not reach it. A "
    "fill with less jerk than the truth is too smooth; a fill with more jerk than the truth shakes."
)
_MILLIMETRES = 1000.0
_CLEAR = 0.08  # share of the axis that a tick keeps from its ends


@dataclass(frozen=True)
class SeveralFills:
    """Fills of one motion and, if it is known, the true one.

    fills: two or more, with joints, frames and rate of the first. keys: (K,) frames that were known, rising.
    """

    fills: tuple[Played, ...]
    truth: Played | None
    keys: np.ndarray

    @property
    def names(self) -> list[str]:
        """Those of the fills."""
        return [fill.name for fill in self.fills]

    @property
    def filled(self) -> np.ndarray:
        """(M,) frames between the first and the last key that are none."""
        return np.setdiff1d(np.arange(self.keys[0], self.keys[-1]), self.keys)

    def places(self) -> np.ndarray:
        """(N, T, J, 3) joints of the body of each fill, metres; those of the truth last, where there is one."""
        body = self.fills[0].skeleton.groups >= 0
        motions = [*self.fills, *([self.truth] if self.truth else [])]
        return np.stack([positions_of(each.skeleton, each.motion)[:, body] for each in motions])

    def scene(self, config: Config) -> dict:
        """The truth, or else plain interpolation, and the fills, laid over each other at first."""
        first = self.fills[0]
        plain = Played(SLERP, first.skeleton, slerped(first.skeleton, first.motion, self.keys))
        motions = [self.truth or plain, *self.fills]
        return played_scene(Heading(TITLE), motions, self.keys, config.max_seconds) | {"overlay": True}


def several_fills(config: Config) -> SeveralFills:
    """The fills that the config names.

    Raises: UsageError for fewer than two fills, and keyframes that leave nothing between them; InputError for files
        that cannot be read or do not hold the same frames of the same rig.
    """
    paths = [source.name for source in find_sources(config.samples)]
    if len(paths) < 2:
        raise UsageError("Fills are compared with each other, and --samples names one.", "Name two or more.")
    fills = tuple(played_file(name, path) for name, path in zip(_names(paths), paths, strict=True))
    truth = played_file(TRUTH, str(config.truth)) if config.truth else None
    for path, other in zip(paths[1:], fills[1:], strict=True):
        _check_alike(fills[0], other, paths[0], path)
    if truth is not None:
        _check_alike(fills[0], truth, paths[0], str(config.truth))
    keys = parse_keyframes(config.keyframes, fills[0].motion.frames)
    found = SeveralFills(fills, truth, keys)
    if not len(found.filled):
        raise UsageError(f"No frame lies between the keyframes {config.keyframes}.", "Give those of the fill.")
    return found


def several_fills_html(fills: SeveralFills) -> Markup:
    """Two charts over the frames, and the table."""
    places, count = fills.places(), len(fills.fills)
    mean = places[:count].mean(axis=0)
    from_mean = _apart(places, mean)
    pairs = np.stack([_apart(places[:count], each) for each in places[:count]])  # (N, N, T)
    between = pairs.sum(axis=(0, 1)) / (count * (count - 1))
    lines = dict(zip([*fills.names, TRUTH], from_mean, strict=False))
    spread = {"two fills": between}
    if fills.truth:
        errors = _apart(places[:count], places[-1])
        spread |= {"nearest fill from the truth": errors.min(axis=0), f"{fills.names[0]} from the truth": errors[0]}
    charts = [
        _chart("Distance from the fills' mean, mm, by frame", lines, fills.names, fills.keys),
        _chart("Distance between two fills, mean over pairs, mm, by frame", spread, [*spread][::-1], fills.keys),
    ]
    table = table_html(_table(fills, places, pairs))
    return markup(
        '<section id="several-fills"><h2>{}</h2><p>{}</p><div class="curves">{}</div>{}</section>',
        TITLE, LEGEND, joined(charts), table,
    )  # fmt: skip


def _apart(places: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(N, T) mean distance of joints (N, T, J, 3) from others (T, J, 3), millimetres."""
    return _MILLIMETRES * np.linalg.norm(places - other, axis=-1).mean(axis=-1)


def _chart(caption: str, lines: dict[str, np.ndarray], methods: Sequence[str], keys: np.ndarray) -> Markup:
    first, last = int(keys[0]), int(keys[-1])
    clear = _CLEAR * (last - first)
    inner = [tick for tick in even_ticks(first, last, 5) if first + clear < tick < last - clear]
    points = {
        name: [(float(frame), float(line[frame])) for frame in range(first, last + 1)] for name, line in lines.items()
    }
    return line_chart(caption, points, [first, *inner, last], methods, levels=(0.0,))


def _table(fills: SeveralFills, places: np.ndarray, pairs: np.ndarray) -> Table:
    filled, count = fills.filled, len(fills.fills)
    missing = np.isin(np.arange(places.shape[1]), filled)
    others = pairs[..., filled].sum(axis=(1, 2)) / (len(filled) * (count - 1))
    faster = (fills.fills[0].motion.fps / MODEL_FPS) ** 3
    jerks = jerk_mps3(places, missing) * faster if len(missing) > 3 else np.full(len(places), np.nan)
    errors = _apart(places[:count], places[-1])[:, filled].mean(axis=1)
    rows = []
    for number, name in enumerate(fills.names):
        error = [Entry(f"{errors[number]:.1f}")] if fills.truth else []
        rows.append(Row((name,), (Entry(f"{others[number]:.1f}"), *error, Entry(f"{jerks[number]:.0f}"))))
    if fills.truth:
        rows.append(Row((TRUTH,), (Entry(), Entry(), Entry(f"{jerks[-1]:.0f}"))))
    columns = ("from the other fills, mm", *(("from the truth, mm",) if fills.truth else ()), "jerk, m/s³")
    return Table(("fill",), columns, tuple(rows))


def _names(paths: Sequence[str]) -> list[str]:
    """The files' names without suffix, where these differ; else the paths."""
    stems = [Path(path).stem for path in paths]
    return stems if len({*stems, TRUTH, SLERP}) == len(stems) + 2 else list(paths)


def _check_alike(first: Played, other: Played, path: str, other_path: str) -> None:
    """Raises InputError where two files do not hold the same frames of the same rig."""
    if other.skeleton.names != first.skeleton.names:
        raise InputError(f"{other_path} has another rig than {path}.", "Compare fills of one file.")
    mine, theirs = (f"{each.frames} frames at {each.fps:g} a second" for each in (first.motion, other.motion))
    if mine != theirs:
        raise InputError(f"{other_path} has {theirs}, and {path} has {mine}.", "Compare fills of one file.")
