"""Flags made from a stage's Config: one for each field, with its description as help and its default.

The values remain text here: the Config validates them, so that flags, files and presets have the same rules.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from inspect import Parameter
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import typer
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from data_schemas.errors import UsageError
from pumps_cli.completion import completion_of
from pumps_cli.help_page import ShownAs
from stages.shared.contract import OFTEN_SET

_LONGEST_LIST = 256 << 20
_METAVARS = {int: "INT", float: "NUMBER", Path: "PATH", str: "TEXT"}
_JOINT = "__"  # between a table and its field in a Python name
_LAST = ("points", "seed", "device", "shard", "overwrite")  # options that many stages have come last
_LONGEST_CHOICES = 26  # characters; longer ones are listed in the help text instead
_SHORT: dict[str, tuple[str, ...]] = {"output": ("-o",)}


def parameters_of(
    config_type: type[BaseModel], arguments: tuple[str, ...], without: tuple[str, ...] = ()
) -> list[Parameter]:
    """A command's parameters: `arguments` by position, all other fields as flags, nested ones as --table.field.

    Fields named in `without` get no flag.
    """
    ordered = [(name, config_type.model_fields[name]) for name in arguments]
    placed = [_argument(name, field) for name, field in ordered]
    flagged = [(path, field) for path, field in _fields(config_type) if ".".join(path) not in (*arguments, *without)]
    flagged.sort(key=lambda item: _rank(*item))
    return placed + [_flag(path, field) for path, field in flagged]


def shown_as(config_type: type[BaseModel]) -> ShownAs:
    """How help shows the parameters. Where fields are marked as often set, all others but `_LAST` are rare."""
    fields = {_JOINT.join(path): field for path, field in _fields(config_type)}
    needed = frozenset(name for name, field in fields.items() if field.is_required())
    often = frozenset(name for name, field in fields.items() if _extra(field).get(OFTEN_SET))
    return ShownAs(
        needed=needed,
        rare=frozenset(fields.keys() - often - needed - {*_LAST}) if often else frozenset(),
        on=frozenset(name for name, field in fields.items() if field.default is True),
    )


def values_given(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The nested settings that the user gave, out of the command's parameters."""
    values: dict[str, Any] = {}
    for name, value in parameters.items():
        if value is None or (isinstance(value, (list, tuple)) and not value):
            continue
        *tables, key = name.split(_JOINT)
        inner = values
        for table in tables:
            inner = inner.setdefault(table, {})
        inner[key] = tuple(value) if isinstance(value, list) else value
    return values


def listed_on_standard_input(values: dict[str, Any], arguments: tuple[str, ...]) -> dict[str, Any]:
    """The same values, with "-" among an argument's values replaced by the names on standard input.

    Names are separated by newlines or zero bytes (`find -print0`). Raises UsageError if there are none.
    """
    read = dict(values)
    for name in arguments:
        given = read.get(name)
        if isinstance(given, tuple) and "-" in given:
            text = sys.stdin.read(_LONGEST_LIST + 1)
            listed = [line.strip("\r") for line in text.split("\0" if "\0" in text else "\n")]
            listed = [line for line in listed if line.strip()]
            if not listed or len(text) > _LONGEST_LIST:
                wrong = "is longer than a list of files can be" if listed else "names no files"
                raise UsageError(f"{name.upper()} is -, and standard input {wrong}.", "Give one name per line.")
            at = given.index("-")
            read[name] = tuple(each for each in (*given[:at], *listed, *given[at + 1 :]) if each != "-")
    return read


def _fields(config_type: type[BaseModel], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], FieldInfo]]:
    for name, field in config_type.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from _fields(field.annotation, (*path, name))
        else:
            yield (*path, name), field


def _rank(path: tuple[str, ...], field: FieldInfo) -> int:
    """The place of a flag: what must be given, what the stage itself has, then what many stages have."""
    name = ".".join(path)
    if field.is_required():
        return 1 if name == "output" else 0
    return 3 + _LAST.index(name) if name in _LAST else 2


def _extra(field: FieldInfo) -> dict[str, Any]:
    return field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}


def _argument(name: str, field: FieldInfo) -> Parameter:
    several, _ = _shape(field.annotation)
    kind = list[str] if several else str
    detail = typer.Argument(
        help=_help_text(field, []), metavar=name.upper(), show_default=False, autocompletion=completion_of(field)
    )
    return Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[kind | None, detail])


def _flag(path: tuple[str, ...], field: FieldInfo) -> Parameter:
    several, inner = _shape(field.annotation)
    *tables, name = path
    flag = "--" + ".".join(path).rstrip("_").replace("_", "-")  # `from_` is --from, a word that Python reserves
    panel = f"Settings of the {tables[0]}" if tables else None
    remarks = [*(["repeatable"] if several else []), *(["required"] if field.is_required() else [])]
    help_text = _help_text(field, remarks)
    if inner is bool:
        off = "--" + ".".join((*tables, f"no-{name}")).replace("_", "-")
        detail = typer.Option(f"{flag}/{off}", help=help_text, show_default=False, rich_help_panel=panel)
        annotation: Any = Annotated[bool | None, detail]
    else:
        detail = typer.Option(
            flag, *_SHORT.get(".".join(path), ()), help=help_text, metavar=_metavar(inner), show_default=False,
            rich_help_panel=panel, autocompletion=completion_of(field),
        )  # fmt: skip
        annotation = Annotated[list[str] | None, detail] if several else Annotated[str | None, detail]
    return Parameter(_JOINT.join(path), Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


def _shape(annotation: Any) -> tuple[bool, Any]:
    """Whether the field takes several values, and the type of one (None taken off)."""
    if get_origin(annotation) in (Union, UnionType):
        annotation = next(part for part in get_args(annotation) if part is not type(None))
    if get_origin(annotation) is tuple:
        return True, get_args(annotation)[0]
    return False, annotation


def _metavar(inner: Any) -> str:
    if get_origin(inner) is Literal:
        choices = "|".join(str(choice) for choice in get_args(inner))
        return choices if len(choices) <= _LONGEST_CHOICES else "NAME"
    return _METAVARS.get(inner, "TEXT")


def _help_text(field: FieldInfo, remarks: list[str]) -> str:
    """The description, and in brackets the remarks, choices that are too long for the metavar, and the default."""
    remarks = list(remarks)
    _, inner = _shape(field.annotation)
    if get_origin(inner) is Literal and _metavar(inner) == "NAME":
        remarks.append(f"one of {', '.join(str(choice) for choice in get_args(inner))}")
    if not field.is_required():
        default = field.get_default(call_default_factory=True)
        if isinstance(default, bool):
            remarks += ["default: yes"] if default else []
        elif default not in (None, (), ""):
            shown = " ".join(str(item) for item in default) if isinstance(default, tuple) else default
            remarks.append(f"default: {shown}")
    return f"{field.description or ''} ({'; '.join(remarks)})" if remarks else field.description or ""
