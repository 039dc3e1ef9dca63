"""TOML of any nesting is read or refused in time in proportion to its length."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from data_schemas.errors import InputError
from stages.shared.formats.skeleton_map import read_skeleton_map
from stages.shared.toml import MAX_BYTES, MAX_DEPTH, TOMLDecodeError, parse_value, read_toml, toml_values

DEEP = {
    "arrays": "x = " + "[" * 6000 + "]" * 6000,
    "arrays never closed": "x = " + "[" * 12000,
    "tables in a line": "x = " + "{a = " * 3000 + "1" + "}" * 3000,
    "a dotted key": "a." * 60_000 + "a = 1",
    "a dotted key in quotes": '"a".' * 3000 + "a = 1",
    "a dotted header": "[" + "a." * 6000 + "a]",
    "tables of arrays": "\n".join(f"[[{'a.' * i}a]]" for i in range(100)),
    "quotes never closed": "x = " + '"\\"' * 200_000,
    "many quotes": "x = " + "'\"" * 200_000,
    "long text never closed": 'x = """' + '\\"""' * 100_000,
    "a number of many digits": "x = " + "9" * 100_000,
}


@pytest.mark.parametrize("kind", DEEP)
def test_deep_nesting_is_refused_at_once(kind: str, tmp_path: Path) -> None:
    begun = time.process_time()
    with pytest.raises(TOMLDecodeError):
        toml_values(DEEP[kind])
    path = tmp_path / "deep.toml"
    path.write_text(DEEP[kind])
    for read in (read_toml, read_skeleton_map):
        with pytest.raises(InputError, match="is not valid TOML"):
            read(path)
    assert parse_value(DEEP[kind].removeprefix("x = ")) == DEEP[kind].removeprefix("x = ")
    assert time.process_time() - begun < 2.0


def test_brackets_in_text_and_comments_do_not_count() -> None:
    marks = "[{" * 50
    text = f'a = \'{marks}\'\nb = "{marks}\\"{marks}"\nc = \'\'\'\n{marks}\n\'\'\'\nd = """\n{marks}""" # {marks}\n'
    assert toml_values(text) == {"a": marks, "b": f'{marks}"{marks}', "c": f"{marks}\n", "d": marks}
    assert toml_values("x = " + "[" * MAX_DEPTH + "]" * MAX_DEPTH)
    assert toml_values("\n".join(f"a{i}.b.c = 1.5" for i in range(100)))


def test_a_file_that_is_too_long_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "long.toml"
    path.write_bytes(b"#" * (5 << 20))
    with pytest.raises(InputError, match="longer than 4 MB"):
        read_toml(path)


def test_a_map_of_many_unknown_joints_is_refused_soon(tmp_path: Path) -> None:
    from stages.shared.formats.skeleton_map import choose_map

    path = tmp_path / "map.toml"
    names = [f"joint{i}" for i in range(500)]
    groups = [f"{group} = {['joint0', *(f'none{i}' for i in range(2000))]}" for group in ("spine", "left_arm")]
    path.write_text("[chains]\n" + "\n".join(groups))
    begun = time.process_time()
    with pytest.raises(InputError, match="the rig lacks 1980 more"):
        choose_map([read_skeleton_map(path)], names)
    assert time.process_time() - begun < 3.0


def test_a_file_that_is_too_long_in_bytes_is_not_cut(tmp_path: Path) -> None:
    """Its bound is in bytes: a text with accents has fewer characters than bytes."""
    long = tmp_path / "long.toml"
    long.write_text("# " + "é" * (MAX_BYTES // 2) + "\na = 1\nb = 2\n", encoding="utf-8")
    with pytest.raises(InputError, match="longer than"):
        read_toml(long)
