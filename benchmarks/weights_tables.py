"""The tables of docs/results.md about the weights that ship, from what `make weights-report` measured.

    python benchmarks/weights_tables.py runs/weights --page docs/results.md

Each table stands between `<!-- weights NAME: begin -->` and `<!-- weights NAME: end -->`, and is replaced alone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from measuring.section import replace_section

from data_schemas.manifest import open_artefact
from data_schemas.metrics import read_metrics
from stages.shared.statistics.feel_tables import feel_lines
from stages.shared.statistics.tables import Cell, Key, cells, overview, terminal_lines

Found = dict[Key, Cell]


def shares(found: Found) -> str:
    """L2P as a share of the baseline's, by archive."""
    return overview(found).strip()


def figures(found: Found) -> str:
    """All archives together, with all headline metrics."""
    return _as_printed(terminal_lines(found))


def feel(found: Found) -> str:
    """How it feels, all archives together."""
    return _as_printed(feel_lines(found))


def _as_printed(lines: list[str]) -> str:
    return "\n".join(["```", *(line.rstrip() for line in lines), "```"])


# A table's name on the page: the folder that was measured into, and what is shown of it.
TABLES: dict[str, tuple[str, Callable[[Found], str]]] = {
    "small by archive": ("own-small", shares),
    "small": ("own-small", figures),
    "small-free by archive": ("own-small-free", shares),
    "small-free": ("own-small-free", figures),
    "small, part by part": ("parts-small", figures),
    "small-free on what it never saw, by archive": ("unseen-small-free", shares),
    "small-free on what it never saw": ("unseen-small-free", figures),
    "small on a rig that it never saw, by archive": ("on-rigs/small", shares),
    "small on a rig that it never saw": ("on-rigs/small", figures),
    "small, feel": ("own-small", feel),
    "small, feel with loose feet": ("loose-small", feel),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "run",
        type=Path,
        nargs="?",
        default=Path("runs/weights"),
        help="the folder that make weights-report measured into",
    )
    parser.add_argument(
        "--page", type=Path, help="the page whose tables are to be replaced; without it they are printed"
    )
    options = parser.parse_args()
    if not options.run.is_dir():
        sys.exit(f"There is no {options.run}: `make weights-report` measures into it and then runs this.")
    found = {
        folder: cells(read_metrics(open_artefact(options.run / folder, "metrics"))[0])
        for folder in dict.fromkeys(folder for folder, _ in TABLES.values())
    }
    for name, (folder, table) in TABLES.items():
        if options.page:
            replace_section(options.page, f"weights {name}", table(found[folder]))
        else:
            print(f"{name}\n\n{table(found[folder])}\n")


if __name__ == "__main__":
    main()
