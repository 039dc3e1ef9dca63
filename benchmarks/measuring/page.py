"""The figures of a benchmark as markdown, and their place in a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from measuring.section import replace_section


def report(figures: dict[str, Any]) -> str:
    """All tables and the sentences beside them."""
    limits, gpu = figures["limits"], figures["device"] != "cpu"
    others = any(case["authors_s"] for case in figures["cases"])
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
        "| step | s | CPU s | GFLOP | GB moved | limit | at the limit, s | reached | peak MB |"
        + (" other's s | ratio |" if others else ""),
        "|---|---:|---:|---:|---:|---|---:|---:|---:|" + ("---:|---:|" if others else ""),
    ]
    alone = not gpu and figures["threads"] == 1  # the limits are then in the processor's seconds too
    lines += [_row(case, limits, "least_cpu_s" if alone else "least_s", others) for case in figures["cases"]]
    if gpu:
        lines += [
            "",
            *(f"- {case['name']}: waits for the GPU {len(case['waits'])} times" for case in figures["cases"]),
        ]
    return "\n".join(lines)


def _row(case: dict[str, Any], limits: dict[str, float], seconds: str, others: bool) -> str:
    cells = [case["name"], f"{case['least_s']:.3f}", f"{case['least_cpu_s']:.3f}"]
    if case["gflop"]:
        limit = limit_of(case["gflop"], case["gb"], limits, bfloat16=case["mixed"])
        cells += [f"{case['gflop']:.0f}", f"{case['gb']:.1f}", *limit_cells(limit, case[seconds])]
    else:
        cells += [""] * 5
    cells += [f"{case['peak_mb']:.0f}"]
    if others:
        other = case["authors_s"]
        cells += [f"{other:.2f}", f"{other / case['least_s']:.1f}x"] if other else ["", ""]
    return f"| {' | '.join(cells)} |"


def limit_of(gflop: float, gb: float, limits: dict[str, float], *, bfloat16: bool) -> tuple[str, float]:
    """What limits a piece of work, and the seconds that it takes at this limit (the roofline).

    gflop: operations of its products, 1e9. gb: bytes that its operations read and write, 1e9; on a CPU most of them
    are in the caches. limits: rates from `machine.limits`.
    """
    kind = "bfloat16" if bfloat16 and "matrix_bfloat16_gflop_per_s" in limits else "float32"
    near = "cache" if "cache_gb_per_s" in limits else "memory"
    times = {"products": gflop / limits[f"matrix_{kind}_gflop_per_s"], "moving": gb / limits[f"{near}_gb_per_s"]}
    return max(times.items(), key=lambda item: item[1])


def limit_cells(limit: tuple[str, float], seconds: float) -> list[str]:
    """The cells `limit`, `at the limit, s` and `reached` of a table's row."""
    return [limit[0], f"{limit[1]:.3f}", f"{100 * limit[1] / seconds:.0f} %"]


def _limit(name: str) -> str:
    what, _, unit = name.partition("_g")
    kind = {"matrix": "matrix product, ", "memory": "copy in main memory", "cache": "copy within the caches"}
    word, _, dtype = what.partition("_")
    return f"{kind[word]}{dtype}, {'GFLOP/s' if unit.startswith('flop') else 'GB/s, read and written'}"


def write_page(path: Path, figures: dict[str, Any]) -> None:
    """Put the report between the page's markers for this device.

    Raises: SystemExit where the page has no such markers.
    """
    replace_section(path, f"bench-train {figures['device']}", report(figures))
