"""The tables of docs/results.md about the weights that ship, from what `make weights-report` measured.

    python benchmarks/weights_tables.py runs/weights --page docs/results.md

Each table stands between `<!-- weights NAME: begin -->` and `<!-- weights NAME: end -->`, and is replaced alone.
Tables measured by different code, or by different weights of one name, are refused: the page shows one state.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from measuring.section import replace_section

from data_schemas.manifest import Manifest, open_artefact
from data_schemas.metrics import read_metrics
from stages.shared.statistics.feel_tables import feel_lines
from stages.shared.statistics.method_notes import MethodFacts
from stages.shared.statistics.tables import Cell, Key, cells, overview, scopes_of, terminal_lines
from stages.shared.statistics.tasks import INTERPOLATION, PREDICTION, TRANSITION

Found = dict[Key, Cell]
SHOWN = 16  # hex digits of a digest


class Measured(NamedTuple):
    """An evaluation: its averages, and its manifest."""

    found: Found
    manifest: Manifest


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


# The columns of the summary: the task, and the frames between keys, missing or appended.
COLUMNS = (
    *((INTERPOLATION, interval) for interval in (5, 15, 30)),
    *((TRANSITION, missing) for missing in (15, 30, 60)),
    *((PREDICTION, appended) for appended in (15, 30)),
)
SUMMARY = (
    ("own-small-free", "small-free", "test clips of its recipe's archives"),
    ("unseen-small-free", "small-free", "archives it was not trained on"),
    ("own-small", "small", "test clips of its recipe's archives"),
    ("on-rigs/small", "small", "the same clips on rigs it was not trained on"),
)
PAPER = (0.81, 0.77, 0.81, 0.67, 0.59, 0.47)  # PUMPS, Table 1: the method's L2P as a share of SLERP's


def summary(measured: dict[str, Measured]) -> str:
    """L2P as a share of the baseline's, all archives together, and what it was measured by."""
    heads = " | ".join(f"{task} {length}" for task, length in COLUMNS)
    lines = [f"| weights | clips | {heads} |", f"|---|---|{'---:|' * len(COLUMNS)}"]
    for folder, name, clips in SUMMARY:
        found = measured[folder].found
        scope = scopes_of(found)[-1]
        shares = [found.get((scope, task, length, "l2p_m", name)) for task, length in COLUMNS]
        texts = [f"{cell.ratio.value:.2f}" if cell and cell.ratio else "" for cell in shares]
        lines.append(f"| `{name}` | {clips} | {' | '.join(texts)} |")
    paper = " | ".join(f"{value:.2f}" for value in PAPER)
    lines += [f"| PUMPS, Table 1 | its own data and test rigs | {paper} | | |", ""]
    return "\n".join(lines + stamp(measured))


def stamp(measured: dict[str, Measured]) -> list[str]:
    """The code and the weights of all tables. Raises SystemExit if two tables were measured by different ones."""
    codes = {each.manifest.summary.get("code", "unknown code") for each in measured.values()}
    if len(codes) > 1:
        sys.exit(
            "These were measured by different code. Remove the run's folder and run `make weights-report` again."
        )
    weights: dict[str, dict[str, str]] = {}
    for each in measured.values():
        for one in MethodFacts.model_validate(each.manifest.summary).weights:
            if weights.setdefault(one.name, one.digests) != one.digests:
                sys.exit(f"Two different weights {one.name} were measured. Run `make weights-report` again.")
    lines = [
        f"Measured by the code `{codes.pop()[:SHOWN]}` (SHA-256 of `data_schemas` and `stages`) with the weights",
        "",
    ]
    for name, digests in sorted(weights.items()):
        lines.append(f"- `{name}`: " + ", ".join(f"{part} `{digest[:SHOWN]}`" for part, digest in digests.items()))
    return lines


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
    measured = {}
    for folder in dict.fromkeys(folder for folder, _ in TABLES.values()):
        artefact = open_artefact(options.run / folder, "metrics")
        measured[folder] = Measured(cells(read_metrics(artefact)[0]), artefact.manifest)
    sections = {"summary": summary(measured)}
    sections |= {name: table(measured[folder].found) for name, (folder, table) in TABLES.items()}
    for name, text in sections.items():
        if options.page:
            replace_section(options.page, f"weights {name}", text)
        else:
            print(f"{name}\n\n{text}\n")


if __name__ == "__main__":
    main()
