"""Texts in the cells of a CSV: none is a formula to a spreadsheet, and each is read back as it was.

A spreadsheet takes a cell that begins with `=`, `+`, `-` or `@`, or with a tab or carriage return before those, for a
formula, and may run it. Such a text is written with an apostrophe before it, which makes it text.
"""

from __future__ import annotations

import csv
import re

_TAKEN_FOR_FORMULA = re.compile(r"'*[=+\-@\t\r\uff1d\uff0b\uff0d\uff20]")  # the last four: the same signs, full width


def text_cell(text: str) -> str:
    """The text as a cell. One that begins with apostrophes and such a sign gets another, so that none is lost."""
    return f"'{text}" if _TAKEN_FOR_FORMULA.match(text) else text


def text_of_cell(cell: str) -> str:
    """The text that `text_cell` wrote."""
    return cell[1:] if cell.startswith("'") and _TAKEN_FOR_FORMULA.match(cell) else cell


def texts_of_line(line: str, separator: str) -> list[str]:
    """The texts of a line of cells, some of them in quotes."""
    try:
        (cells,) = csv.reader([line.strip("\r\n")], delimiter=separator, skipinitialspace=True)
    except csv.Error:  # such as a quote that never ends, before a very long rest
        cells = [cell.strip().strip('"') for cell in line.split(separator)]
    return [text_of_cell(cell.strip()) for cell in cells]


def safe_line(line: str, separator: str) -> str:
    """The line, with cells that a spreadsheet takes for formulas made texts. Other cells are unchanged.

    `texts_of_line` reads the same texts from both.
    """
    cells = line.split(separator)
    for at, cell in enumerate(cells):
        text = cell.strip().strip('"')
        if text_cell(text) != text:
            start = cell.index(text)
            cells[at] = f"{cell[:start]}'{cell[start:]}"
    return separator.join(cells)
