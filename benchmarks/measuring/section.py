"""The part of a page that a command writes: what stands between `<!-- NAME: begin -->` and `<!-- NAME: end -->`."""

from __future__ import annotations

import re
from pathlib import Path


def replace_section(page: Path, name: str, text: str) -> None:
    """Put `text` between the page's markers of this name.

    Raises: SystemExit where the page has no such markers.
    """
    begin, end = (f"<!-- {name}: {word} -->" for word in ("begin", "end"))
    old = page.read_text(encoding="utf-8")
    if begin not in old or end not in old:
        raise SystemExit(f"{page} has no markers {begin} and {end}.")
    fresh = f"{begin}\n\n{text}\n\n{end}"
    page.write_text(re.sub(f"{re.escape(begin)}.*?{re.escape(end)}", lambda _: fresh, old, flags=re.S), "utf-8")
