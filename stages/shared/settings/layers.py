"""One Config out of several layers of settings: defaults, presets, files, flags; the later layer wins.

All faults are reported at once, each with the place it came from.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from data_schemas.errors import UsageError
from stages.shared.contract import StageConfig

ConfigT = TypeVar("ConfigT", bound=StageConfig)

COMMAND_LINE = "command line"


@dataclass(frozen=True)
class Layer:
    """Settings from one place.

    origin: what to call the place in an error: "preset tiny", a file's path, or COMMAND_LINE.
    values: field -> value, tables of nested settings as mappings.
    """

    origin: str
    values: Mapping[str, Any]


def settle(
    config_type: type[ConfigT], layers: Sequence[Layer], *, what: str, arguments: Sequence[str] = ()
) -> ConfigT:
    """The config that the layers make together.

    Args:
        what:      what the settings are of, for the error ("pumps train ae").
        arguments: fields that the command line gives by place, not by flag.

    Raises:
        UsageError: unknown keys, wrong types, missing settings; all of them in one message.
    """
    merged, origins = _merge(config_type, layers)
    try:
        return config_type.model_validate(merged)
    except ValidationError as error:
        faults = [_fault(config_type, dict(detail), origins, arguments) for detail in error.errors()]
    raise _as_error(faults, what)


def settle_file_part(
    config_type: type[StageConfig], layers: Sequence[Layer], *, what: str, inputs: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The settings that belong in a file, defaults spelled out: all but inputs and required ones that no layer gives.

    Those are the paths that differ from run to run; they are given on the command line.

    Args:
        inputs: fields that the command line gives, with their values, so that the settings are judged together.

    Raises:
        UsageError: as `settle`, but nothing is missing.
    """
    merged, origins = _merge(config_type, [*layers, Layer(COMMAND_LINE, inputs or {})])
    absent = {name for name, field in config_type.model_fields.items() if field.is_required() and name not in merged}
    stand_ins = {name: ("-",) if _is_tuple(config_type, name) else "-" for name in absent}
    try:
        settled = config_type.model_validate({**merged, **stand_ins})
    except ValidationError as error:
        faults = [_fault(config_type, dict(detail), origins) for detail in error.errors()]
        raise _as_error(faults, what) from None
    return {
        name: value
        for name, value in settled.model_dump(mode="json").items()
        if name not in absent and name not in (inputs or {})
    }


def _as_error(faults: Sequence[str], what: str) -> UsageError:
    if len(faults) == 1:
        return UsageError(f"A setting of `{what}` is wrong: {faults[0]}.", f"See `{what} --help`.")
    listing = "".join(f"\n  - {fault}" for fault in faults)
    return UsageError(f"{len(faults)} settings of `{what}` are wrong:{listing}", f"See `{what} --help`.")


def _merge(
    config_type: type[BaseModel], layers: Sequence[Layer]
) -> tuple[dict[str, Any], dict[tuple[str, ...], str]]:
    merged: dict[str, Any] = {}
    origins: dict[tuple[str, ...], str] = {}
    for layer in layers:
        for path, value in _leaves(layer.values):
            table = merged
            for key in path[:-1]:
                inner = table.get(key)
                table[key] = table = inner if isinstance(inner, dict) else {}
            if isinstance(value, (str, int, float)) and _is_tuple(config_type, *path):
                value = (value,)
            table[path[-1]] = value
            origins[path] = layer.origin
    return merged, origins


def _leaves(values: Mapping[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for raw_key, value in values.items():
        here = (*path, raw_key.replace("-", "_"))
        if isinstance(value, Mapping):
            yield from _leaves(value, here)
        else:
            yield here, value


def _is_tuple(config_type: type[BaseModel], *path: str) -> bool:
    """Whether the field holds several values, so that a single one may be given bare."""
    for key in path[:-1]:
        field = config_type.model_fields.get(key)
        if field is None or not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
            return False
        config_type = field.annotation
    field = config_type.model_fields.get(path[-1])
    return field is not None and any(
        get_origin(part) is tuple for part in (field.annotation, *get_args(field.annotation))
    )


def _fault(
    config_type: type[BaseModel],
    detail: Mapping[str, Any],
    origins: Mapping[tuple[str, ...], str],
    arguments: Sequence[str] = (),
) -> str:
    """One fault in words: the setting as it was spelled where it came from, what it is, what it should be."""
    path = tuple(str(part) for part in detail["loc"])
    message = str(detail["msg"]).removeprefix("Value error, ")
    if not path:  # settings that do not go together, reported as they are
        return message
    origin = next((origins[path[:n]] for n in range(len(path), 0, -1) if path[:n] in origins), None)
    fields = [part for part in path if not part.isdecimal()]
    flag = fields[0].upper() if fields[0] in arguments else "--" + ".".join(fields).rstrip("_").replace("_", "-")
    name, place = (flag, "") if origin in (None, COMMAND_LINE) else (".".join(fields), f" in {origin}")
    if detail["type"] == "missing":
        return f"{flag} is missing"
    if detail["type"] == "extra_forbidden":
        near = get_close_matches(fields[-1], _known(config_type, fields[:-1]), n=1)
        return f"there is no setting {name}{place}" + (f" (did you mean {near[0]}?)" if near else "")
    return f"{name} = {_shown(detail.get('input'))}{place}: {message[0].lower()}{message[1:]}"


def _known(config_type: type[BaseModel], path: Sequence[str]) -> list[str]:
    for key in path:
        field = config_type.model_fields.get(key)
        if field is None or not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
            return []
        config_type = field.annotation
    return list(config_type.model_fields)


def _shown(value: Any) -> str:
    text = str(value) if isinstance(value, Path) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
