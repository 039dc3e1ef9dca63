"""HTML and SVG in which every field is text.

All markup of pages and pictures is made by `markup`, whose template is a literal in the code. A field is escaped
unless it is `Markup`, which this module alone makes. So a name that holds tags or quotes can only be text.
"""

from __future__ import annotations

import html
import json
import re
import string
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing_extensions import LiteralString

# What neither HTML nor XML may hold; lone surrogates, which cannot be encoded; marks that turn the text's direction.
_REPLACED = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff\u202a-\u202e\u2066-\u2069]")


class Markup(str):
    """Text that is markup already. Only this module makes it."""

    __slots__ = ()


def markup(template: LiteralString, *fields: object, **named: object) -> Markup:
    """The template with its fields, as `str.format` puts them in, each one escaped unless it is `Markup`.

    Args:
        fields, named: text, numbers, `Markup`, or several of them, which follow one another.
    """
    return Markup(_FORMATTER.vformat(template, fields, named))


def joined(parts: Iterable[Markup | str], between: LiteralString = "") -> Markup:
    """Parts one after another, each escaped unless it is `Markup`, with a literal between them."""
    return Markup(between.join(_escaped(part) for part in parts))


def filled(page: Markup, **fields: Markup | str) -> Markup:
    """A page of our own with its places `$NAME` filled, each escaped unless it is `Markup`."""
    return Markup(string.Template(page).substitute({name: _escaped(value) for name, value in fields.items()}))


def own_file(path: Path) -> Markup:
    """The text of a file of the package, which is a part of a page as it is."""
    return Markup(path.read_text(encoding="utf-8"))


def script_data(value: object) -> Markup:
    """Plain data as JSON inside a script element: no text in it ends the element or begins a comment."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)  # all but ASCII is escaped
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def _escaped(value: object) -> str:
    if isinstance(value, Markup):
        return str(value)
    if isinstance(value, str):
        return html.escape(_REPLACED.sub("\ufffd", value), quote=True)
    if isinstance(value, Iterable):
        return "".join(map(_escaped, value))
    return _escaped(str(value))


class _Escaping(string.Formatter):
    """Formats as `str.format` does, and escapes. Fields are named whole: no attributes and no items of theirs."""

    def get_field(self, field_name: str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> tuple[Any, str]:
        key = int(field_name) if field_name.isdecimal() else field_name
        return self.get_value(key, args, kwargs), field_name

    def format_field(self, value: Any, format_spec: str) -> Any:
        return _escaped(format(value, format_spec) if format_spec else value)


_FORMATTER = _Escaping()
