"""Presets: named TOML files with a table for each stage; `extends` names the preset that one builds on."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

from data_schemas.errors import UsageError
from data_schemas.old_names import tell_old_name
from stages.registry import NAMES, OLD_NAMES, PIPELINE, stage_named
from stages.shared.settings.layers import Layer, settle_file_part
from stages.shared.toml import read_toml

# Settings that every stage had in 0.1.0. A file may still hold them for a stage that they do not apply to.
_FORMER = ("seed",)


def preset_names() -> list[str]:
    """The presets that ship with pumps, in alphabetical order."""
    return sorted(path.stem for path in _folder().glob("*.toml"))


def preset_path(name: str) -> Path:
    """The file of a preset. Raises UsageError when there is none of this name."""
    if name not in preset_names():
        raise UsageError(f"There is no preset {name!r}.", f"Take one of {', '.join(preset_names())}.")
    return _folder() / f"{name}.toml"


def is_in_presets(stage: str) -> bool:
    """Whether any preset has settings of this stage."""
    return any(stage in _tables(preset_path(name)) for name in preset_names())


def preset_layers(name: str, stage: str) -> list[Layer]:
    """What a preset, and those it builds on, say of a stage; the one named comes last."""
    chain: list[tuple[str, dict[str, Any]]] = []
    following: str | None = name
    while following is not None:
        if following in (seen for seen, _ in chain):
            raise UsageError(f"Preset {name!r} extends itself.")
        tables = _tables(preset_path(following))
        chain.append((following, tables))
        following = tables.get("extends")
    return [Layer(f"preset {each}", tables.get(stage, {})) for each, tables in reversed(chain)]


def file_layer(path: Path, stage: str) -> Layer:
    """What a settings file says of a stage: its table of that name, or else all its top-level keys.

    A file whose top level holds only tables named after stages is read as a preset is.
    """
    values = _tables(path)
    if stage in values:
        values = values[stage]
    elif values and all(key in NAMES for key in values if key != "extends"):
        values = {}
    known = stage_named(stage).config_type().model_fields
    return Layer(str(path), {key: value for key, value in values.items() if key in known or key not in _FORMER})


def check_preset(name: str) -> None:
    """Raises UsageError when the preset names a stage that is not, or a setting that a stage does not have."""
    unknown = [key for key in _tables(preset_path(name)) if key not in NAMES and key != "extends"]
    if unknown:
        raise UsageError(f"Preset {name!r} has a table for no stage: {', '.join(unknown)}.")
    for stage in PIPELINE:
        settle_file_part(stage.config_type(), preset_layers(name, stage.name), what=f"preset {name}, [{stage.name}]")


def _tables(path: Path) -> dict[str, Any]:
    """A file's tables and keys; a table that has a stage's old name is the stage's, if none has its new one."""
    values = read_toml(path)
    old = {key: OLD_NAMES[key] for key, table in values.items() if key in OLD_NAMES and isinstance(table, dict)}
    for key, new in old.items():
        tell_old_name(f"The table [{key}] of {path}", f"[{new}]")
    return {old.get(key, key): table for key, table in values.items() if old.get(key) not in values}


def _folder() -> Path:
    return Path(str(files("stages.shared.presets")))
