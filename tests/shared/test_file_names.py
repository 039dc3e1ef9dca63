"""Names that become file names: one part of a path, on every system, and never two names for one file."""

from __future__ import annotations

import unicodedata
from itertools import product

import pytest

from stages.shared.file_names import LONGEST_BYTES, FileNames, is_file_name

LEADING_OUT = (
    "../x", "/etc/x", "..", ".", "a/../../x", "..\\x", "C:\\x", "C:x", "//host/share", "a\0b", "a\nb", "", " ", "   ",
    ".hidden", "...", "x.", "x ", "\u202ex", "\x1b[31mx", "\ud800", "con", "CON", "nul.tar", "COM1", "lpt9.x", "COM¹",
    "aux .txt", "x" * 5000, "é" * 4000, "a/b", "a\\b", "a:b", "a_b", "a*b", "a?b", "~", "-rf",
)  # fmt: skip


@pytest.mark.parametrize("name", LEADING_OUT)
def test_a_name_is_one_part_that_every_system_takes(name: str) -> None:
    made = FileNames().of(name)
    assert is_file_name(made) and len(made.encode("utf-8")) <= LONGEST_BYTES
    assert not set(made) & set('/\\:*?"<>|\0') and made.isprintable()
    assert made[0] not in ". " and made[-1] not in ". "
    assert made.split(".")[0].lower() not in ("con", "nul", "com1", "lpt9", "aux", "com¹")


@pytest.mark.parametrize("name", ["walk", "walk 01", "set.walk-2", "走る", "Ünï", "a_b", "-rf", "concert", "com10"])
def test_a_name_that_can_be_a_files_stays(name: str) -> None:
    assert FileNames().of(name) == name and is_file_name(name)


def test_no_two_names_are_one_file_in_any_order() -> None:
    names = ["Walk", "walk", "WALK", "é", unicodedata.normalize("NFD", "é"), *LEADING_OUT]
    names += ["".join(each) for each in product("a/\\:_", repeat=3)]
    for order in (names, names[::-1]):
        files = FileNames()
        made = [files.of(name) for name in order]
        folded = [unicodedata.normalize("NFC", each).casefold() for each in made]
        assert len(set(folded)) == len(set(names))
        assert made == [files.of(name) for name in order]


def test_a_name_that_was_made_to_meet_another_does_not() -> None:
    meant = FileNames().of("a/b")
    files = FileNames()
    assert files.of(meant) == meant and files.of("a/b") != meant
