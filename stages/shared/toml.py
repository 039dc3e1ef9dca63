"""TOML in and out: plain data, with errors that name the file."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from data_schemas.errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports]

MAX_BYTES = 4 << 20
MAX_DEPTH = 32  # brackets inside brackets, or dots in a key
TOMLDecodeError = tomllib.TOMLDecodeError
# Strings, comments and structure. Strings that are never closed match up to where they must end, so that no part of
# the text is looked at twice.
_TOKEN = re.compile(
    r'"""(?:[^\\]|\\.)*?(?:"""|\Z)'
    r"|\'\'\'.*?(?:\'\'\'|\Z)"
    r'|"(?:[^"\\\n]|\\[^\n])*"?'
    r"|'[^'\n]*'?|#[^\n]*|[\[\]{}.=,\n]",
    re.DOTALL,
)
_DEPTHS = {"[": 1, "{": 1, "]": -1, "}": -1}


def toml_values(text: str) -> dict[str, Any]:
    """The values of a TOML text, as `tomllib.loads` gives them.

    Deep nesting is refused before the text is parsed: the parser takes time that grows with the square of the parts
    of a key, and a level of Python's stack for every bracket.

    Raises: TOMLDecodeError if the text is not TOML, is longer than MAX_BYTES, or is nested deeper than MAX_DEPTH.
    """
    _check_length(text.encode("utf-8", errors="surrogatepass"))
    depth = dots = 0
    for token in _TOKEN.finditer(text):
        mark = token[0]
        depth = max(depth + _DEPTHS.get(mark, 0), 0)
        if mark == ".":
            dots += 1
        elif mark[0] not in "\"'":
            dots = 0
        if depth > MAX_DEPTH or dots > MAX_DEPTH:
            line = text.count("\n", 0, token.start()) + 1
            raise TOMLDecodeError(f"it is nested more than {MAX_DEPTH} levels deep (at line {line})")
    try:
        return tomllib.loads(text)
    except TOMLDecodeError:
        raise
    except ValueError:  # a whole number of thousands of digits
        raise TOMLDecodeError("a number has too many digits") from None


def _check_length(data: bytes) -> None:
    if len(data) > MAX_BYTES:
        raise TOMLDecodeError(f"it is longer than {MAX_BYTES >> 20} MB")


def read_toml(path: Path, *, what: str = "settings file", option: str = "--config") -> dict[str, Any]:
    """The tables and keys of a TOML file. Raises InputError when it is missing or not TOML."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        _check_length(data)  # first: what is read of a longer file may end within a letter
        return toml_values(data.decode("utf-8"))
    except FileNotFoundError:
        raise InputError(f"The {what} {path} does not exist.", f"Check the path given to {option}.") from None
    except TOMLDecodeError as error:
        raise InputError(f"The {what} {path} is not valid TOML: {error}.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"The {what} {path} cannot be read: {error}.") from None


def parse_value(text: str) -> Any:
    """`text` as a TOML value where it is one (a number, true, a list, a quoted string), else as it stands."""
    try:
        return toml_values(f"value = {text}")["value"]
    except (TOMLDecodeError, KeyError):
        return text


def toml_text(values: Mapping[str, Any]) -> str:
    """Plain data as TOML: keys first, then tables. None is left out, since TOML has no such value."""
    return "\n".join(_lines(values, ())) + "\n"


def _lines(values: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = [
        f"{_key(key)} = {_value(value)}"
        for key, value in values.items()
        if value is not None and not isinstance(value, Mapping)
    ]
    for key, value in values.items():
        if isinstance(value, Mapping):
            here = (*path, key)
            lines += ["", f"[{'.'.join(_key(part) for part in here)}]", *_lines(value, here)]
    return lines


def _key(key: str) -> str:
    return key if key and all(c.isascii() and (c.isalnum() or c in "-_") for c in key) else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value)  # "inf" and "nan" are TOML too
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_value(item) for item in value)}]"
    if isinstance(value, (str, Path)):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    raise TypeError(f"no TOML value: {value!r}")
