"""A table before it is Markdown, text or HTML."""

from stages.shared.statistics.table import Entry, Row, Table, without_repeats


def test_a_table_as_markdown():
    rows = (Row(("L2P", "ours"), (Entry("0.4", "[0.3, 0.5]", "×0.80*", "better"), Entry())),)
    assert Table(("metric", "method"), ("15", "30"), rows).markdown() == [
        "| metric | method | 15 | 30 |",
        "|---|---|---:|---:|",
        "| L2P | ours | 0.4 [0.3, 0.5] ×0.80* |  |",
    ]


def test_a_bar_in_a_name_ends_no_column():
    assert Row(("a | b",), (Entry("1"),)).markdown() == "| a \\| b | 1 |"


def test_labels_that_repeat_the_row_above_are_empty():
    rows = [Row(labels, (Entry("1"),)) for labels in (("a", "5"), ("a", "5"), ("a", "15"), ("b", "15"), ("a", "15"))]
    shown = [row.labels for row in without_repeats(rows)]
    assert shown == [("a", "5"), ("", ""), ("", "15"), ("b", "15"), ("a", "15")]
