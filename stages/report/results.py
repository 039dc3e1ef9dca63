"""The section of results: tables from the rows of a metrics artefact, and what its manifest says of them, as HTML."""

from __future__ import annotations

import html
import json
from collections.abc import Iterator, Mapping
from typing import Any

from data_schemas.damaged_files import reading
from data_schemas.manifest import MANIFEST_NAME, Artefact
from data_schemas.metrics import MetricRow, read_metrics
from stages.shared.statistics import feel_tables, pop_tables, tables
from stages.shared.statistics.measurements import TRUTH
from stages.shared.statistics.method_notes import MethodFacts, Sentence, borrowed_note, method_notes
from stages.shared.statistics.table import Entry, Table
from stages.shared.statistics.tables import Cell, Key


def results_html(artefact: Artefact) -> str:
    """The section: what was measured, the overview, and for each archive its tables, folded except for the last.

    Raises: InputError where the artefact is damaged.
    """
    rows, _ = read_metrics(artefact)
    manifest = artefact.manifest
    with reading(artefact.path / MANIFEST_NAME):
        facts = MethodFacts.model_validate(manifest.summary)
    seed = manifest.config.get("seed", 0)
    found = tables.cells(rows, seed if isinstance(seed, int) else 0)
    notes = "".join(f"<li>{_sentence(note)}</li>" for note in method_notes(facts))
    parts = [
        f"<p>{html.escape(_measured(rows, manifest.stage))}</p>",
        f"<ul>{notes}</ul>" if notes else "",
        _paragraph(borrowed_note(facts)),
        *_overviews(found),
        *_scopes(found, rows),
        f"<details><summary>Settings</summary>{_settings(manifest.config)}</details>",
    ]
    return f'<section id="results"><h2>Results</h2>{"".join(parts)}</section>'


def table_html(table: Table) -> str:
    """A table that scrolls sideways; a rule stands above each row that begins a group."""
    heads = [f"<th>{html.escape(text)}</th>" for text in table.labels]
    heads += [f'<th class="number">{html.escape(text)}</th>' for text in table.columns]
    rows = [f"<tr>{''.join(heads)}</tr>"]
    for number, row in enumerate(table.rows):
        cells = [f"<td>{html.escape(text)}</td>" for text in row.labels]
        cells += [f'<td class="number">{_entry(entry)}</td>' for entry in row.entries]
        group = ' class="group"' if number > 0 and row.labels[0] else ""
        rows.append(f"<tr{group}>{''.join(cells)}</tr>")
    return f'<div class="scroll"><table>{"".join(rows)}</table></div>'


def _entry(entry: Entry) -> str:
    """Value, interval in small letters, ratio in the colour of its verdict."""
    parts = [html.escape(entry.value)]
    if entry.span:
        parts.append(f"<small>{html.escape(entry.span)}</small>")
    if entry.ratio:
        parts.append(f'<span class="{entry.verdict}">{html.escape(entry.ratio)}</span>')
    return " ".join(part for part in parts if part)


def _sentence(sentence: Sentence) -> str:
    texts = ((html.escape(part.text, quote=False), part.is_name) for part in sentence)
    return "".join(f"<code>{text}</code>" if is_name else text for text, is_name in texts)


def _measured(rows: list[MetricRow], stage: str) -> str:
    clips = tables.counted(len({(row.archive, row.clip) for row in rows}), "clip")
    skeletons = tables.counted(len({row.skeleton for row in rows}), "skeleton")
    methods = list(dict.fromkeys(row.method for row in rows if row.method != TRUTH))
    return f"{clips} on {skeletons}, measured by {stage}. Methods: {', '.join(methods)}."


def _overviews(found: Mapping[Key, Cell]) -> Iterator[str]:
    for caption, table in tables.overview_tables(dict(found)):
        if table.rows:
            yield f"<p>{html.escape(caption)}:</p>{table_html(table)}"


def _scopes(found: dict[Key, Cell], rows: list[MetricRow]) -> Iterator[str]:
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
        body = "".join(
            f"<h3>{html.escape(section.title)}</h3>{''.join(map(table_html, section.tables))}"
            for section in tables.tables_of_scope(found, scope)
        )
        for title, table in ((feel_tables.TITLE, felt[scope]), (pop_tables.TITLE, popped[scope])):
            body += f"<h3>{title}</h3>{table_html(table)}" if table else ""
        is_open = " open" if scope == scopes[-1] else ""
        yield f"<details{is_open}><summary>{html.escape(scope)}</summary>{body}</details>"


def _settings(config: Mapping[str, Any]) -> str:
    pairs = (f"<dt>{html.escape(name)}</dt><dd>{html.escape(_value(value))}</dd>" for name, value in config.items())
    return f"<dl>{''.join(pairs)}</dl>"


def _value(value: Any) -> str:
    if value is None or value == []:
        return "none"
    if isinstance(value, list):
        return ", ".join(map(_value, value))
    return value if isinstance(value, str) else json.dumps(value)


def _paragraph(text: str) -> str:
    return f"<p>{html.escape(text)}</p>" if text else ""
