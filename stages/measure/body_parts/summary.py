"""The page of a measurement: the paper's three tables, and which part harms which."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from data_schemas.metrics import MetricRow
from data_schemas.skeleton import BODY_GROUPS
from stages.measure.body_parts import paper
from stages.measure.body_parts.config import Config
from stages.measure.body_parts.lost_tables import lost_tables
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.table import Entry, Row, Table

INPUT, LATENT = "input", "latent"
PLAIN = "plain"
SCENARIOS: Mapping[str, tuple[str, ...]] = {
    PLAIN: (),
    "input noise": (INPUT,),
    "latent noise": (LATENT,),
    "input and latent noise": (INPUT, LATENT),
}
METRICS = ("mpjpe_180_cm", "mpjae_deg")
_TITLES = {"mpjpe_180_cm": "MPJPE, cm at 1.80 m", "mpjae_deg": "MPJAE, degrees"}
_TAMPER = "tampered "


@dataclass(frozen=True)
class Measured:
    """bodies: name -> (column of the tables, kinds of its networks, parameters). sets: the data sets' names, the seen
    one first. pieces: name -> what is tampered with."""

    bodies: Mapping[str, tuple[str, str, int]]
    sets: Sequence[str]
    pieces: Mapping[str, tuple[str, ...]]

    @property
    def columns(self) -> list[str]:
        return sorted({column for column, *_ in self.bodies.values()})

    @property
    def kinds(self) -> list[str]:
        return list(dict.fromkeys(kind for _, kind, _ in self.bodies.values()))


def tamper_task(piece: str) -> str:
    """The task of rows in which this piece's latent is tampered with."""
    return f"{_TAMPER}{piece}"


def harms_of(rows: Sequence[MetricRow], name: str, pieces: Sequence[str], metric: str = "cm") -> np.ndarray:
    """(pieces, 5) how far each body group moves when each piece is tampered with."""
    found = {(row.task, row.metric): row.value for row in rows if row.method == name}
    return np.array([[found[tamper_task(piece), f"{group}_{metric}"] for group in BODY_GROUPS] for piece in pieces])


def summary_md(config: Config, rows: Sequence[MetricRow], measured: Measured, notes: Sequence[str]) -> str:
    """The whole page."""
    seen, *unseen = measured.sets
    parts = [
        "# Body parts\n",
        f"Made by:\n\n```\n{command_line('pumps measure body-parts', config)}\n```\n",
        f"Errors of joints with the pelvis at the origin, on a body of 1.80 m. Means over windows; ± the standard "
        f"deviation over clips, of means over {config.seeds} seeds. Input noise turns each joint of each frame by "
        f"{config.noise_deg:g} degrees about each axis (one standard deviation); latent noise sets "
        f"{100 * config.zeroed:g} % of the latent to zero. Seen: {seen}. Unseen: {', '.join(unseen) or 'none'}.\n",
        "\n".join(f"- {note}" for note in notes),
        "\n## Parameters\n",
        *_parameters(measured).markdown(),
        f"\n## Table 1: {seen}\n",
        *_table_1(rows, measured, [seen], paper.SEEN),
    ]
    if unseen:
        parts += [f"\n## Table 1: {', '.join(unseen)}\n", *_table_1(rows, measured, unseen, paper.UNSEEN)]
        parts += ["\n## Table 2\n", *_by_set(rows, measured, PLAIN, unseen, paper.BY_SET[""])]
    parts.append("\n## Table 3\n")
    for scenario in list(SCENARIOS)[1:]:
        parts += [f"\n### {scenario}\n", *_by_set(rows, measured, scenario, measured.sets, paper.BY_SET[scenario])]
    parts += ["\n## Best decomposition of each data set\n", *findings(rows, measured)]
    parts += [*lost_tables(config, rows, measured.sets), *_locality(rows, measured)]
    return "\n".join(parts) + "\n"


def means(
    rows: Sequence[MetricRow], measured: Measured, metric: str, scenario: str, sets: Sequence[str]
) -> dict[tuple[str, str], tuple[float, float]]:
    """(kind, column) -> mean over windows, and deviation over clips, of one metric."""
    found: dict[tuple[str, str], list[tuple[float, int]]] = {}
    for row in rows:
        if row.metric == metric and row.task == scenario and row.archive in sets:
            column, kind, _ = measured.bodies[row.method]
            found.setdefault((kind, column), []).append((row.value, row.windows))
    out = {}
    for key, pairs in found.items():
        values, counts = np.array(pairs, float).T
        out[key] = (float(np.average(values, weights=counts)), float(values.std()))
    return out


def over_kinds(cells: Mapping[tuple[str, str], tuple[float, float]], column: str) -> tuple[float, float]:
    """Mean and deviation over the kinds of networks of one column."""
    values = [mean for (_, other), (mean, _) in cells.items() if other == column]
    return (float(np.mean(values)), float(np.std(values))) if values else (float("nan"), float("nan"))


def _table_1(
    rows: Sequence[MetricRow], measured: Measured, sets: Sequence[str], printed: Mapping[str, Sequence[float]]
) -> Iterator[str]:
    for place, metric in enumerate(METRICS):
        cells = means(rows, measured, metric, PLAIN, sets)
        lines = [
            Row((kind,), tuple(_entry(cells.get((kind, column))) for column in measured.columns))
            for kind in measured.kinds
        ]
        lines.append(Row(("mean",), tuple(_entry(over_kinds(cells, column)) for column in measured.columns)))
        lines += [
            Row((f"paper, {kind}",), _printed(values, place, measured.columns)) for kind, values in printed.items()
        ]
        yield f"{_TITLES[metric]}:\n"
        yield from Table(("network",), tuple(measured.columns), tuple(lines)).markdown()
        yield ""
    spread = [row.value for row in rows if row.metric == f"{METRICS[0]}_over_seeds" and row.archive in sets]
    yield f"Deviation of MPJPE over the seeds, mean over clips and all kinds of noise: {np.mean(spread):.3f} cm.\n"


def _by_set(
    rows: Sequence[MetricRow],
    measured: Measured,
    scenario: str,
    sets: Sequence[str],
    printed: Mapping[str, Sequence[float]],
) -> Iterator[str]:
    for place, metric in enumerate(METRICS):
        lines = []
        for label in sets:
            cells = means(rows, measured, metric, scenario, [label])
            lines.append(Row((label,), tuple(_entry(over_kinds(cells, each)) for each in measured.columns)))
        lines += [
            Row((f"paper, {label}",), _printed(values, place, measured.columns)) for label, values in printed.items()
        ]
        yield f"{_TITLES[metric]}, mean and deviation over the kinds of networks:\n"
        yield from Table(("data",), tuple(measured.columns), tuple(lines)).markdown()
        yield ""


def findings(rows: Sequence[MetricRow], measured: Measured) -> list[str]:
    """For each data set and metric the decomposition that is best, and by how much."""
    out = []
    for label in measured.sets:
        for metric in METRICS:
            cells = means(rows, measured, metric, PLAIN, [label])
            values = {column: over_kinds(cells, column)[0] for column in measured.columns}
            best, *others = sorted(values, key=lambda column: values[column])
            if not others:
                continue
            beside = ", ".join(f"{column} {values[column]:.2f}" for column in others)
            out.append(f"- {label}, {_TITLES[metric]}: {best} is best with {values[best]:.2f} ({beside}).")
    return out


def terminal_lines(rows: Sequence[MetricRow], measured: Measured) -> list[str]:
    """One line a body and data set, then the findings."""
    lines = []
    for name, (column, kind, _) in measured.bodies.items():
        own = [row for row in rows if row.method == name]
        for label in measured.sets:
            found = [means(own, measured, metric, PLAIN, [label]).get((kind, column)) for metric in METRICS]
            texts = [f"{cell[0]:.2f}" if cell else "-" for cell in found]
            lines.append(f"{name:12} {label:14} MPJPE {texts[0]} cm, MPJAE {texts[1]} degrees")
    return lines + [line.removeprefix("- ") for line in findings(rows, measured)]


def _parameters(measured: Measured) -> Table:
    columns = measured.columns
    lines = []
    for kind in measured.kinds:
        own = {column: count for column, other, count in measured.bodies.values() if other == kind}
        lines.append(Row((kind,), tuple(Entry(f"{own[c]:,}" if c in own else "") for c in columns)))
    lines.append(
        Row(("paper",), tuple(Entry(f"{paper.PARAMETERS[c]:,}" if c in paper.PARAMETERS else "") for c in columns))
    )
    return Table(("network",), tuple(columns), tuple(lines))


def _locality(rows: Sequence[MetricRow], measured: Measured) -> Iterator[str]:
    if not any(row.task.startswith(_TAMPER) for row in rows):
        return
    yield "\n## Locality\n"
    yield (
        "Noise is added to the latent of one part, or to a fifth of the latent of the whole body, and each body "
        "group's change is measured: its joints' distance in cm, and in brackets its angles to the parents' joints "
        "in degrees.\n"
    )
    for name, (column, _, _) in measured.bodies.items():
        pieces = measured.pieces[name]
        far, turned = (harms_of(rows, name, pieces, metric) for metric in ("cm", "local_deg"))
        lines = [
            Row((piece,), tuple(Entry(f"{a:.2f}", f"({b:.2f})") for a, b in zip(*each, strict=True)))
            for piece, *each in zip(pieces, far, turned, strict=True)
        ]
        heads = tuple(group.replace("_", " ") for group in BODY_GROUPS)
        yield f"\n{name} ({column}):\n"
        yield from Table(("tampered",), heads, tuple(lines)).markdown()


def _entry(cell: tuple[float, float] | None) -> Entry:
    return Entry(f"{cell[0]:.2f}", f"± {cell[1]:.2f}") if cell else Entry()


def _printed(values: Sequence[float], metric: int, columns: Sequence[str]) -> tuple[Entry, ...]:
    half = dict(zip(paper.COLUMNS, values[4 * metric : 4 * metric + 4], strict=True))
    return tuple(Entry(f"{half[column]:.2f}" if column in half else "") for column in columns)
