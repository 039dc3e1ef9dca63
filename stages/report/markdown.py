"""The little Markdown that summaries are written in, to HTML: headings, tables, lists, code, paragraphs."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator

_INLINE_CODE = re.compile(r"`([^`]+)`")
_BOLD = re.compile(r"\*\*([^*]+)\*\*")
_SPAN = re.compile(r" (\[[^\]]*\])")
_RATIO = re.compile(r"×([0-9.]+)(\*?)")


def markdown_html(text: str) -> str:
    """HTML of a summary. Second-level sections fold, the last of them open; its first heading is left out."""
    parts = re.split(r"^## (.+)$", text, flags=re.MULTILINE)
    out = ["".join(_blocks(parts[0]))]
    sections = list(zip(parts[1::2], parts[2::2], strict=True))
    for number, (title, body) in enumerate(sections):
        is_open = " open" if number == len(sections) - 1 else ""
        out.append(f"<details{is_open}><summary>{_inline(title)}</summary>{''.join(_blocks(body))}</details>")
    return "".join(out)


def _blocks(text: str) -> Iterator[str]:
    lines = iter(text.split("\n"))
    gathered: list[str] = []
    for line in lines:
        if line.startswith("```"):
            yield from _flush(gathered)
            code = []
            for inner in lines:
                if inner.startswith("```"):
                    break
                code.append(inner)
            yield f"<pre>{html.escape(chr(10).join(code))}</pre>"
        elif line.startswith("#"):
            yield from _flush(gathered)
            level = len(line) - len(line.lstrip("#"))
            if level > 1:
                yield f"<h{level}>{_inline(line.lstrip('# '))}</h{level}>"
        elif line.strip():
            if gathered and line.startswith("|") != gathered[-1].startswith("|"):
                yield from _flush(gathered)
            gathered.append(line)
        else:
            yield from _flush(gathered)
    yield from _flush(gathered)


def _flush(gathered: list[str]) -> Iterator[str]:
    lines = list(gathered)
    gathered.clear()
    if not lines:
        return
    if lines[0].startswith("|") and len(lines) > 1:
        yield _table(lines)
    elif lines[0].startswith("- "):
        items = "\n".join(lines).removeprefix("- ").split("\n- ")
        yield "<ul>" + "".join(f"<li>{_inline(item)}</li>" for item in items) + "</ul>"
    else:
        yield f"<p>{_inline(' '.join(lines))}</p>"


def _table(lines: list[str]) -> str:
    grid = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]
    numeric = [mark.endswith(":") for mark in grid[1]]
    rows = [_row("th", grid[0], numeric)]
    for number, cells in enumerate(grid[2:]):
        starts_group = number > 0 and cells[0] and cells[0] != grid[number + 1][0]
        rows.append(_row("td", cells, numeric, ' class="group"' if starts_group else ""))
    return f'<div class="scroll"><table>{"".join(rows)}</table></div>'


def _row(tag: str, cells: list[str], numeric: list[bool], attributes: str = "") -> str:
    out = []
    for number, cell in enumerate(cells):
        is_number = number < len(numeric) and numeric[number]
        text = _inline(cell)
        if is_number and tag == "td":
            text = _RATIO.sub(_marked, _SPAN.sub(r" <small>\1</small>", text))
        attribute = ' class="number"' if is_number else ""
        out.append(f"<{tag}{attribute}>{text}</{tag}>")
    return f"<tr{attributes}>{''.join(out)}</tr>"


def _marked(match: re.Match[str]) -> str:
    """A ratio to the baseline, in colour where it is starred: it is then more than chance."""
    kind = "same" if not match[2] else "better" if float(match[1]) < 1 else "worse"
    return f'<span class="{kind}">×{match[1]}{match[2]}</span>'


def _inline(text: str) -> str:
    text = html.escape(text.strip(), quote=False)
    return _BOLD.sub(r"<b>\1</b>", _INLINE_CODE.sub(r"<code>\1</code>", text))
