"""The page of a measurement: one table with intervals, the order of the rows compared with the paper's, and the
settings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from data_schemas.metrics import MetricRow
from data_schemas.skeleton import BODY_GROUPS
from stages.measure.ae.config import Config
from stages.measure.ae.methods import PAPER, Method
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.bootstrap import Estimate, mean_interval, ratio_interval

REFERENCE = "two true draws"
SPREADS = tuple(f"spread_{name}" for name in BODY_GROUPS)
_COLUMNS = (
    ("rec_mm", "L_rec, mm", 1),
    ("rec_m2", "L_rec, m²", 4),
    ("moving_mm", "varies over time, mm", 1),
    ("chamfer_mm", "Chamfer, mm", 1),
    ("spread", "spread ratio", 2),
    ("jerk_ratio", "jerk ratio", 2),
)
_LEGEND = (
    "Means over clips with a 95% bootstrap interval over clips. **L_rec**: mean distance of pairs after the "
    "assignment of whole trajectories within body groups, and their mean squared distance. **Varies over time**: "
    "the same after each pair's mean difference over the window is taken off. **Chamfer**: root-mean-square distance "
    "over time to the nearest trajectory of the group, both ways. **Spread ratio**: standard deviation of the points "
    "about their group's mean, decoded over true; 1 is right, less is drawn in. **Jerk ratio**: mean norm of the "
    f"third derivative, decoded over true; 1 is right. `{REFERENCE}`: another draw of the true cloud's points "
    "measured the same way, the level of a perfect decoder. It is not a lower bound: a cloud drawn in towards its "
    "groups' means has a lower L_rec and a spread ratio below 1."
)


@dataclass(frozen=True)
class AutoencoderResults:
    """All measurements."""

    config: Config
    methods: Sequence[Method]
    rows: Sequence[MetricRow]
    frames: int
    points: int
    windows: int

    def names(self) -> list[str]:
        """The reference, then the methods, as given."""
        return [REFERENCE, *(method.name for method in self.methods)]

    def column(self, method: str, metric: str, archive: str = "") -> tuple[np.ndarray, np.ndarray]:
        """(C,) values of the clips, in one order for all methods, and (C,) their windows."""
        found = sorted(
            (row.archive, row.clip, row.value, row.windows)
            for row in self.rows
            if row.method == method and row.metric == metric and archive in ("", row.archive)
        )
        return np.array([row[2] for row in found]), np.array([row[3] for row in found], np.float64)

    def mean(self, method: str, metric: str, archive: str = "") -> Estimate:
        """Mean over clips, weighted by their windows."""
        return mean_interval(*self.column(method, metric, archive), self.config.seed)


class Pair(NamedTuple):
    """Two rows of the paper's table, the better one of it first, and the ratio of our L_rec, second over first."""

    better: Method
    worse: Method
    ratio: Estimate

    @property
    def verdict(self) -> str:
        """Whether the rows have the paper's order; by the ratio's interval if there is one."""
        low = self.ratio.value if self.ratio.low is None else self.ratio.low
        high = self.ratio.value if self.ratio.high is None else self.ratio.high
        if low > 1:
            return "as in the paper"
        return "the other way round" if high < 1 else "not told apart"


def paper_pairs(measured: AutoencoderResults) -> list[Pair]:
    """Every pair of measured rows that the paper also has."""
    known = sorted((m for m in measured.methods if m.change in PAPER), key=lambda method: PAPER[method.change])
    pairs = []
    for better, worse in combinations(known, 2):
        columns = (*measured.column(worse.name, "rec_m2"), *measured.column(better.name, "rec_m2"))
        pairs.append(Pair(better, worse, ratio_interval(*columns, measured.config.seed)))
    return pairs


def summary_md(measured: AutoencoderResults, pictures: Sequence[str]) -> str:
    """The whole page."""
    archives = list(dict.fromkeys(row.archive for row in measured.rows))
    clips = len({(row.archive, row.clip) for row in measured.rows})
    config = measured.config
    parts = [
        "# Autoencoders on held-out clouds\n",
        f"{measured.windows} windows of {measured.frames} frames from {clips} clips "
        f"({', '.join(config.splits)} split) of {', '.join(archives)}; {measured.points} points a cloud, sigma "
        f"{config.sigma_m} m, seed {config.seed}; the same windows and points for every row.\n",
        *_budgets(measured.methods),
        "",
        *_table(measured),
        "",
        _LEGEND + "\n",
        *_order(measured),
        "## Spread ratio by body group\n",
        *_grid(measured, [(metric, metric.removeprefix("spread_").replace("_", " "), "") for metric in SPREADS], 2),
        "",
        "## L_rec by data set, mm\n",
        *_grid(measured, [("rec_mm", archive, archive) for archive in archives], 1),
        "",
        f"Made by:\n\n```\n{command_line('pumps measure ae', config)}\n```\n",
    ]
    if pictures:
        parts.append("## Reconstructed clouds\n")
        parts += [f"![True and reconstructed clouds]({name})\n" for name in pictures]
    return "\n".join(parts)


def terminal_lines(measured: AutoencoderResults) -> list[str]:
    """The main table as aligned text, and the number of pairs in the paper's order."""
    width = max(map(len, measured.names()))
    lines = [f"{'':<{width}}  " + "  ".join(f"{title:>22}" for _, title, _ in _COLUMNS)]
    for name in measured.names():
        cells = (_text(measured.mean(name, metric), digits) for metric, _, digits in _COLUMNS)
        lines.append(f"{name:<{width}}  " + "  ".join(f"{cell:>22}" for cell in cells))
    pairs = paper_pairs(measured)
    return [*lines, _verdict_sentence(pairs)] if pairs else lines


def _table(measured: AutoencoderResults) -> Iterator[str]:
    yield f"| row | what is changed | {' | '.join(title for _, title, _ in _COLUMNS)} | L_rec of the paper |"
    yield f"|---|---|{'---:|' * (len(_COLUMNS) + 1)}"
    changes = {method.name: method.change for method in measured.methods}
    for name in measured.names():
        cells = [_text(measured.mean(name, metric), digits) for metric, _, digits in _COLUMNS]
        change = changes.get(name, "")
        paper = f"{PAPER[change]:.4f}" if change in PAPER else ""
        yield f"| {name} | {change} | {' | '.join(cells)} | {paper} |"


def _grid(measured: AutoencoderResults, columns: Sequence[tuple[str, str, str]], digits: int) -> Iterator[str]:
    """A table of (metric, title, archive) columns."""
    yield f"| row | {' | '.join(title for _, title, _ in columns)} |"
    yield f"|---|{'---:|' * len(columns)}"
    for name in measured.names():
        cells = (_text(measured.mean(name, metric, archive), digits) for metric, _, archive in columns)
        yield f"| {name} | {' | '.join(cells)} |"


def _budgets(methods: Sequence[Method]) -> Iterator[str]:
    yield "| row | steps | windows × frames × points | parameters | minutes of training | seed |"
    yield "|---|---:|---:|---:|---:|---:|"
    for method in methods:
        known = method.training
        size = " × ".join(str(known.get(key, "?")) for key in ("batch", "window", "points"))
        yield (
            f"| {method.name} | {known.get('steps', '?')} | {size} | {method.parameters / 1e6:.2f} M | "
            f"{method.minutes:.1f} | {known.get('seed', '?')} |"
        )


def _order(measured: AutoencoderResults) -> Iterator[str]:
    pairs = paper_pairs(measured)
    if not pairs:
        return
    here = sorted({m.name: m for pair in pairs for m in pair[:2]}.values(), key=lambda m: _level(measured, m))
    paper = sorted(here, key=lambda m: PAPER[m.change])
    yield "## Does the paper's order of rows hold?\n"
    yield _verdict_sentence(pairs) + "\n"
    yield f"- Here, best first: {', '.join(m.name for m in here)}."
    yield f"- PUMPS Table 2, best first: {', '.join(m.name for m in paper)}.\n"
    yield "| better in the paper | worse in the paper | ratio there | ratio of L_rec (m²) here | here |"
    yield "|---|---|---:|---:|---|"
    for pair in pairs:
        there = PAPER[pair.worse.change] / PAPER[pair.better.change]
        yield f"| {pair.better.name} | {pair.worse.name} | {there:.1f} | {_text(pair.ratio, 2)} | {pair.verdict} |"
    yield ""


def _level(measured: AutoencoderResults, method: Method) -> float:
    return measured.mean(method.name, "rec_m2").value


def _verdict_sentence(pairs: Sequence[Pair]) -> str:
    counts = {verdict: 0 for verdict in ("as in the paper", "the other way round", "not told apart")}
    for pair in pairs:
        counts[pair.verdict] += 1
    whole = "The paper's order of rows holds." if counts["as in the paper"] == len(pairs) else (
        "The paper's order of rows does not hold as a whole."
    )  # fmt: skip
    parts = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    return f"{whole} Of {len(pairs)} pairs of rows, by squared L_rec and its ratio's interval: {parts}."


def _text(estimate: Estimate, digits: int) -> str:
    if not np.isfinite(estimate.value):
        return ""
    text = f"{estimate.value:.{digits}f}"
    if estimate.low is None or estimate.high is None:
        return text
    return f"{text} [{estimate.low:.{digits}f}, {estimate.high:.{digits}f}]"
