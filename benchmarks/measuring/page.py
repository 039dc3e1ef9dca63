"""The figures of a benchmark as markdown, and their place in a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from measuring.section import replace_section


def report(figures: dict[str, Any]) -> str:
    """All tables and the sentences beside them."""
    limits, gpu = figures["limits"], figures["device"] != "cpu"
    lines = [
        f"`{figures['preset']}`: {figures['sequences']} sequences of {figures['frames']} frames of "
        f"{figures['points']} points. {figures['machine']}, "
        + ("" if gpu else f"{figures['threads']} threads (OMP_WAIT_POLICY={figures['wait_policy'] or 'unset'}), ")
        + f"PyTorch {figures['torch']}; the least of {figures['rounds']} rounds, "
        f"{figures['seconds']:.0f} s for the whole benchmark.",
        "",
        "| measured in the same rounds | |",
        "|---|---:|",
        *(f"| {_limit(name)} | {value:,.0f} |" for name, value in limits.items()),
        "",
        "| step | s | CPU s | authors' | ratio | GFLOP | GB moved | GFLOP/s | in products | peak MB |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    lines += [_row(case) for case in figures["cases"]]
    lines += ["", *_sentences(figures)]
    if gpu:
        lines += [
            "",
            *(f"- {case['name']}: waits for the GPU {len(case['waits'])} times" for case in figures["cases"]),
        ]
    return "\n".join(lines)


def _row(case: dict[str, Any]) -> str:
    seconds, authors = case["least_s"], case["authors_s"]
    cells = [case["name"], f"{seconds:.3f}", f"{case['least_cpu_s']:.3f}"]
    cells += [f"{authors:.2f}", f"{authors / seconds:.1f}x"] if authors else ["", ""]
    counted = case["gflop"]
    cells += [f"{counted:.0f}", f"{case['gb']:.1f}", f"{counted / seconds:.0f}"] if counted else ["", "", ""]
    cells += [f"{100 * case['in_products']:.0f} %" if counted else "", f"{case['peak_mb']:.0f}"]
    return f"| {' | '.join(cells)} |"


def _limit(name: str) -> str:
    what, _, unit = name.partition("_g")
    kind = {"matrix": "matrix product, ", "memory": "copy in main memory", "cache": "copy within the caches"}
    word, _, dtype = what.partition("_")
    return f"{kind[word]}{dtype}, {'GFLOP/s' if unit.startswith('flop') else 'GB/s, read and written'}"


def _sentences(figures: dict[str, Any]) -> list[str]:
    """How far the first case is from the machine's limits."""
    case, limits = figures["cases"][0], figures["limits"]
    if not case["gflop"]:
        return []
    product = limits["matrix_bfloat16_gflop_per_s" if case["mixed"] else "matrix_float32_gflop_per_s"]
    near = limits.get("cache_gb_per_s", limits["memory_gb_per_s"])
    by_products, by_moving = case["gflop"] / product, case["gb"] / near
    where = "the caches" if "cache_gb_per_s" in limits else "memory"
    return [
        f"The first row's products alone would take {by_products:.2f} s at the measured rate, and what its "
        f"operations read and write {by_moving:.2f} s at that of {where}; together {by_products + by_moving:.2f} s "
        f"of its {case['least_s']:.2f} s."
    ]


def write_page(path: Path, figures: dict[str, Any]) -> None:
    """Put the report between the page's markers for this device.

    Raises: SystemExit where the page has no such markers.
    """
    replace_section(path, f"bench-train {figures['device']}", report(figures))
