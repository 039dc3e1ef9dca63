"""A run's config folder: one settings file for each stage, and the list of source files with their digests.

Files are rewritten only where their content changed, so that their times tell make what is out of date.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import sha256_of_file
from data_schemas.whole_file import write_whole
from stages.registry import NAMES, OLD_NAMES, PIPELINE
from stages.shared.settings.layers import COMMAND_LINE, Layer, settle_file_part
from stages.shared.settings.presets import preset_layers
from stages.shared.toml import parse_value, toml_text

CONFIG_FOLDER = "config"
SOURCE_LIST = "sources.txt"
_DIGEST_CACHE = ".digests.json"


def write_run_config(
    run: Path, presets: Sequence[str], settings: Sequence[str], sources: Sequence[str] = ()
) -> list[Path]:
    """Write RUN/config: `<stage>.toml` for every stage and, where sources are given, `sources.txt`.

    Args:
        run:      the run's folder.
        presets:  names, the later wins.
        settings: "stage.field=value" each; they win over presets.
        sources:  files, folders, globs or archives that the run ingests.

    Returns:
        The files whose content changed.

    Raises:
        UsageError: an unknown preset, stage or setting, or a wrong value.
        InputError: a source is missing.
    """
    overrides = [_parse_setting(text) for text in settings]
    if sources:
        overrides.append(("ingest", Layer(COMMAND_LINE, {"sources": tuple(sources)})))
    contents: dict[str, str] = {}
    splits: str | None = None
    faults: list[UsageError] = []
    for stage in PIPELINE:
        layers = [layer for preset in presets for layer in preset_layers(preset, stage.name)]
        layers += [layer for name, layer in overrides if name == stage.name]
        try:
            values = settle_file_part(stage.config_type(), layers, what=f"pumps {' '.join(stage.command)}")
        except UsageError as error:
            faults.append(error)
            continue
        if stage.name == "ingest":
            splits = values["splits"]
        contents[f"{stage.name}.toml"] = f"# Settings of `pumps {' '.join(stage.command)}`.\n{toml_text(values)}"
    if faults:
        raise UsageError("\n".join(fault.message for fault in faults), faults[0].hint)
    folder = run / CONFIG_FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    if sources:
        listed = [*source_files(sources), *([Path(splits)] if splits else [])]
        contents[SOURCE_LIST] = _source_list(listed, folder / _DIGEST_CACHE)
    return [folder / name for name, text in contents.items() if _write_if_changed(folder / name, text)]


def source_files(sources: Iterable[str]) -> list[Path]:
    """The files on disk that the sources stand for: archives and plain files, folders and globs followed.

    Raises:
        InputError: a source names nothing.
    """
    from stages.shared.formats.readers import AUTO, rig_suffixes, suffixes_of
    from stages.shared.formats.sources import find_sources

    found = find_sources(list(sources), (*suffixes_of(AUTO), *rig_suffixes()))
    return sorted({Path(source.archive or source.name) for source in found})


def _parse_setting(text: str) -> tuple[str, Layer]:
    """ "train-ae.encoder.width=16" as the stage and a layer."""
    name, equals, value = text.partition("=")
    stage, *path = name.strip().split(".")
    stage = OLD_NAMES.get(stage, stage)
    if not equals or not path or stage not in NAMES:
        raise UsageError(
            f"--set {text!r} is no STAGE.FIELD=VALUE, as train-ae.steps=100 is.", f"Stages are {', '.join(NAMES)}."
        )
    values: dict = {}
    inner = values
    for key in path[:-1]:
        inner[key] = inner = {}
    inner[path[-1]] = parse_value(value)
    return stage, Layer("--set", values)


def _source_list(paths: Iterable[Path], cache_path: Path) -> str:
    """Path and sha256 of every file, one a line. Files whose size and time did not change are not read again."""
    try:
        cache = json.loads(cache_path.read_text())
    except (OSError, ValueError):
        cache = {}
    fresh: dict[str, list] = {}
    for path in paths:
        try:
            stat = path.stat()
            known = cache.get(str(path))
            if not known or known[:2] != [stat.st_size, stat.st_mtime_ns]:
                known = [stat.st_size, stat.st_mtime_ns, sha256_of_file(path)]
        except OSError as error:
            raise InputError(f"The source {path} cannot be read: {error.strerror}.", "Check the path.") from None
        fresh[str(path)] = known
    _write_if_changed(cache_path, json.dumps(fresh, indent=0))
    return "".join(f"{entry[2]}  {name}\n" for name, entry in fresh.items())


def _write_if_changed(path: Path, text: str) -> bool:
    try:
        if path.read_text(encoding="utf-8") == text:
            return False
    except (OSError, UnicodeDecodeError):
        pass
    write_whole(path, text.encode("utf-8"))
    return True
