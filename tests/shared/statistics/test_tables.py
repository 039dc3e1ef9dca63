"""Averages over clips and their printed form."""

from __future__ import annotations

from dataclasses import replace

import pytest

from data_schemas.metrics import MetricRow
from stages.shared.statistics.tables import ALL, cell_text, cells, overview, scopes_of, task_tables, terminal_lines

ROW = MetricRow("c", "s", "set-1", "slerp", "interpolation", 15, "l2p_m", 0.5)


def rows() -> list[MetricRow]:
    out = []
    for clip, windows, value in (("a", 1, 0.4), ("b", 3, 0.8)):
        out.append(replace(ROW, clip=clip, windows=windows, value=value))
        out.append(replace(ROW, clip=clip, windows=windows, value=value / 2, method="ours"))
        out.append(replace(ROW, clip=clip, windows=windows, value=value, metric="npss", weight=windows * 10.0))
    out.append(replace(ROW, clip="a", archive="set-2", value=2.0))
    out.append(replace(ROW, clip="a", archive="set-2", value=3.0, method="ours"))
    out.append(replace(ROW, task="prediction", method="zero-velocity", value=1.0))
    out.append(replace(ROW, task="prediction", method="ours", value=0.9))
    return out


def test_clips_weigh_as_many_windows_as_they_have_and_npss_its_power() -> None:
    found = cells(rows())
    cell = found["set-1", "interpolation", 15, "l2p_m", "slerp"]
    assert cell.mean.value == pytest.approx((0.4 + 3 * 0.8) / 4)
    assert (cell.windows, cell.clips) == (4, 2)
    assert found["set-1", "interpolation", 15, "npss", "slerp"].mean.value == pytest.approx((0.4 + 3 * 0.8) / 4)


def test_ratios_are_to_slerp_and_in_prediction_to_zero_velocity() -> None:
    found = cells(rows())
    ours = found["set-1", "interpolation", 15, "l2p_m", "ours"]
    assert ours.ratio is not None and ours.ratio.value == pytest.approx(0.5)
    assert found["set-1", "interpolation", 15, "l2p_m", "slerp"].ratio is None
    predicted = found["set-1", "prediction", 15, "l2p_m", "ours"]
    assert predicted.ratio is not None and predicted.ratio.value == pytest.approx(0.9)


def test_clips_of_one_name_in_two_archives_stay_apart() -> None:
    found = cells(rows())
    assert found[ALL, "interpolation", 15, "l2p_m", "slerp"].clips == 3
    assert scopes_of(found) == ["set-1", "set-2", ALL]


def test_one_archive_needs_no_overall_scope() -> None:
    assert scopes_of(cells([ROW])) == ["set-1"]


def test_a_ratio_is_not_given_where_the_baseline_has_other_clips() -> None:
    found = cells([ROW, replace(ROW, clip="other", method="ours")])
    assert found["set-1", "interpolation", 15, "l2p_m", "ours"].ratio is None


def test_printed_forms() -> None:
    found = cells(rows())
    text = task_tables(found)
    assert "## set-1" in text and "| L2P (m) | slerp |" in text and "15 (4 windows of 2 clips)" in text
    assert "×0.50*" in text
    assert cell_text(None) == ""
    assert cell_text(cells([ROW])["set-1", "interpolation", 15, "l2p_m", "slerp"]) == "0.500"
    assert "| set-1 | ours | 0.50 [0.50, 0.50] |" in overview(found)
    lines = terminal_lines(found)
    assert lines[0].startswith("Interpolation") and any("ours" in line for line in lines)


def test_figures_without_a_baseline_tell_their_windows_once() -> None:
    rows = [
        replace(ROW, task="retargeting", method=method, metric="knn_cm", interval=spread)
        for method in ("original motion", "ours")
        for spread in (0, 10, 50)
    ]
    assert terminal_lines(cells(rows))[-1] == "(set-1: 1 window of 1 clip)"
    assert terminal_lines(cells([ROW]))[-1] == "(set-1: 1 window of 1 clip at 15; ×: share of slerp's)"
