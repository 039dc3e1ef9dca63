"""The section of results: tables from the rows of a metrics artefact, and what its manifest says of them, as HTML."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from data_schemas.damaged_files import reading
from data_schemas.manifest import MANIFEST_NAME, Artefact
from data_schemas.metrics import MetricRow, read_metrics
from stages.report.gap_curves import gap_charts_html
from stages.shared.markup import Markup, joined, markup
from stages.shared.statistics import feel_tables, pop_tables, tables
from stages.shared.statistics.measurements import TRUTH
from stages.shared.statistics.method_notes import MethodFacts, Sentence, borrowed_note, method_notes
from stages.shared.statistics.table import Entry, Table
from stages.shared.statistics.tables import Cell, Key


def results_html(artefact: Artefact) -> Markup:
    """The section: what was measured, the overview, and for each archive its tables, folded except for the last.

    Raises: InputError where the artefact is damaged.
    """
    rows, _ = read_metrics(artefact)
    manifest = artefact.manifest
    with reading(artefact.path / MANIFEST_NAME):
        facts = MethodFacts.model_validate(manifest.summary)
    seed = manifest.config.get("seed", 0)
    found = tables.cells(rows, seed if isinstance(seed, int) else 0)
    notes = joined(markup("<li>{}</li>", _sentence(note)) for note in method_notes(facts))
    parts = [
        markup("<p>{}</p>", _measured(rows, manifest.stage)),
        markup("<ul>{}</ul>", notes) if notes else "",
        _paragraph(borrowed_note(facts)),
        *_overviews(found),
        gap_charts_html(found),
        *_scopes(found, rows),
        markup("<details><summary>Settings</summary>{}</details>", _settings(manifest.config)),
    ]
    return markup('<section id="results"><h2>Results</h2>{}</section>', parts)


def table_html(table: Table) -> Markup:
    """A table that scrolls sideways; a rule stands above each row that begins a group."""
    heads = [markup("<th>{}</th>", text) for text in table.labels]
    heads += [markup('<th class="number">{}</th>', text) for text in table.columns]
    rows = [markup("<tr>{}</tr>", heads)]
    for number, row in enumerate(table.rows):
        cells = [markup("<td>{}</td>", text) for text in row.labels]
        cells += [markup('<td class="number">{}</td>', _entry(entry)) for entry in row.entries]
        begins = number > 0 and row.labels[0]
        rows.append(markup('<tr class="group">{}</tr>', cells) if begins else markup("<tr>{}</tr>", cells))
    return markup('<div class="scroll"><table>{}</table></div>', rows)


def _entry(entry: Entry) -> Markup:
    """Value, interval in small letters, ratio in the colour of its verdict."""
    parts: list[Markup | str] = [entry.value]
    if entry.span:
        parts.append(markup("<small>{}</small>", entry.span))
    if entry.ratio:
        parts.append(markup('<span class="{}">{}</span>', entry.verdict, entry.ratio))
    return joined((part for part in parts if part), " ")


def _sentence(sentence: Sentence) -> Markup:
    return joined(markup("<code>{}</code>", part.text) if part.is_name else part.text for part in sentence)


def _measured(rows: list[MetricRow], stage: str) -> str:
    clips = tables.counted(len({(row.archive, row.clip) for row in rows}), "clip")
    skeletons = tables.counted(len({row.skeleton for row in rows}), "skeleton")
    methods = list(dict.fromkeys(row.method for row in rows if row.method != TRUTH))
    return f"{clips} on {skeletons}, measured by {stage}. Methods: {', '.join(methods)}."


def _overviews(found: Mapping[Key, Cell]) -> Iterator[Markup]:
    for caption, table in tables.overview_tables(dict(found)):
        if table.rows:
            yield markup("<p>{}:</p>{}", caption, table_html(table))


def _scopes(found: dict[Key, Cell], rows: list[MetricRow]) -> Iterator[Markup | str]:
    """The legends, then for each archive, and for all together last, a part that folds."""
    scopes = tables.scopes_of(found)
    felt = {scope: feel_tables.feel_table(found, scope) for scope in scopes}
    popped = {scope: pop_tables.pop_table(rows, scope) for scope in scopes}
    yield _paragraph(tables.LEGEND)
    if any(felt.values()):
        yield _paragraph(feel_tables.LEGEND)
    if any(popped.values()):
        yield _paragraph(pop_tables.LEGEND)
    for scope in scopes:
        body = [
            markup("<h3>{}</h3>{}", section.title, map(table_html, section.tables))
            for section in tables.tables_of_scope(found, scope)
        ]
        for title, table in ((feel_tables.TITLE, felt[scope]), (pop_tables.TITLE, popped[scope])):
            body += [markup("<h3>{}</h3>{}", title, table_html(table))] if table else []
        is_open = markup(" open") if scope == scopes[-1] else ""
        yield markup("<details{}><summary>{}</summary>{}</details>", is_open, scope, body)


def _settings(config: Mapping[str, Any]) -> Markup:
    pairs = (markup("<dt>{}</dt><dd>{}</dd>", name, _value(value)) for name, value in config.items())
    return markup("<dl>{}</dl>", pairs)


def _value(value: Any) -> str:
    if value is None or value == []:
        return "none"
    if isinstance(value, list):
        return ", ".join(map(_value, value))
    return value if isinstance(value, str) else json.dumps(value)


def _paragraph(text: str) -> Markup | str:
    return markup("<p>{}</p>", text) if text else ""
