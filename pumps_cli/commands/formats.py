"""`pumps formats`: what is read, and the page of the documentation that says so."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from data_schemas.errors import InputError
from data_schemas.whole_file import write_whole
from pumps_cli.outcome import Manner, errors_reported, show
from pumps_cli.stage_command import AsJson, Quiet
from stages.shared.formats.readers import FORMATS, Format

EXAMPLE = "Example: pumps formats"
BEGIN, END = "<!-- made by `pumps formats --page` -->", "<!-- end of what `pumps formats --page` makes -->"

_Page = Annotated[
    Path | None, typer.Option("--page", metavar="FILE.md", help="Write the table into this page, between its marks.")
]


def command(page: _Page = None, quiet: Quiet = False, as_json: AsJson = False) -> None:
    """List the formats that `pumps ingest` reads, what it takes of each, and their traps."""
    manner = Manner(quiet=quiet, json=as_json)
    with errors_reported(manner, "pumps formats"):
        if page is not None:
            text = page.read_text(encoding="utf-8")
            write_whole(page, with_table(text, str(page)).encode())
            return
        show(manner, _lines, lambda: [_plain(each) for each in FORMATS])


def with_table(text: str, name: str) -> str:
    """A page's text with today's table between its marks. Raises InputError where it has no marks."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError(
            f"{name} has no place for the table.", f"Put {BEGIN} and {END} into it, on lines of their own."
        )
    rows = ["| command | files | what is read | traps |", "|---|---|---|---|"]
    for each in FORMATS:
        files = ", ".join(f"`{suffix}`" for suffix in each.suffixes)
        rows.append(f"| `pumps ingest {each.name}` | {files} | {each.reads} | {each.traps} |")
    return "\n".join([before + begin, *rows, end + after])


def _lines() -> list[str]:
    lines = []
    for each in FORMATS:
        lines += [f"{each.name}  ({', '.join(each.suffixes)})", f"  reads: {each.reads}", f"  traps: {each.traps}"]
    return lines


def _plain(each: Format) -> dict[str, object]:
    return {"name": each.name, "suffixes": list(each.suffixes), "reads": each.reads, "traps": each.traps}
