"""Charts of error against the length of the gap."""

from __future__ import annotations

import re

from data_schemas.metrics import MetricRow
from stages.report.gap_curves import gap_charts_html
from stages.shared.statistics.tables import cells


def rows(intervals: tuple[int, ...]) -> list[MetricRow]:
    return [
        MetricRow(clip, "s", "set", method, "interpolation", interval, "l2p_m", value * interval)
        for clip in ("a", "b")
        for interval in intervals
        for method, value in (("slerp", 1.0), ("delta", 0.5), ("<mine>", 0.8))
    ]


def test_every_method_but_the_baseline_is_a_line_at_its_share() -> None:
    drawn = str(gap_charts_html(cells(rows((5, 15, 30)))))
    lines = re.findall(r'points="([^"]*)"', drawn)
    assert len(lines) == 2 and all(line.count(",") == 3 for line in lines)
    heights = [[float(point.split(",")[1]) for point in line.split()] for line in lines]
    assert all(max(each) - min(each) < 0.2 for each in heights)  # the share is the same at every gap
    higher, lower = sorted(each[0] for each in heights)  # a larger share is drawn higher up
    assert lower > higher and "&lt;mine&gt;" in drawn and "<mine>" not in drawn


def test_one_interval_makes_no_chart() -> None:
    assert gap_charts_html(cells(rows((15,)))) == ""
