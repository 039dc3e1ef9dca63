"""A run's config folder and makefile: settings of each node, and the lists of source files with their digests.

Files are rewritten only where their content changed, so that their times tell make what is out of date.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import sha256_of_file
from data_schemas.old_names import tell_old_name
from data_schemas.whole_file import write_whole
from stages.registry import NAMES, OLD_NAMES
from stages.shared.formats.archives import archive_and_member
from stages.shared.settings.layers import COMMAND_LINE, Layer, settle_file_part
from stages.shared.settings.presets import preset_layers
from stages.shared.settings.recipe_data import archives_there, recipe_sources
from stages.shared.settings.recipes import DataNeeded, Node, Recipe, embedded_clips, read_recipe
from stages.shared.settings.run_makefile import MAKEFILE, makefile_text
from stages.shared.settings.run_steps import CONFIG_FOLDER, config_name, outside_inputs, source_list_name
from stages.shared.toml import parse_value, toml_text

_DIGEST_CACHE = ".digests.json"


@dataclass(frozen=True)
class RunRequest:
    """What `pumps config write` is asked for.

    run:         the run's folder.
    presets:     names, the later wins; none for the recipe's own.
    settings:    "NAME.FIELD=VALUE" each. Of a stage, they win over presets; of a node of the recipe, over all.
    sources:     files, folders, globs or archives that the run ingests, instead of the recipe's archives.
    recipe:      a recipe by name; "" for the pipeline of the registry.
    parameters:  "NAME=WORDS" each, for the recipe.
    data_folder: where the recipe's archives lie.
    """

    run: Path
    presets: Sequence[str] = ()
    settings: Sequence[str] = ()
    sources: Sequence[str] = ()
    recipe: str = ""
    parameters: Sequence[str] = ()
    data_folder: Path = Path(".")


def write_run_config(
    run: Path, presets: Sequence[str] = (), settings: Sequence[str] = (), sources: Sequence[str] = (), **more: Any
) -> list[Path]:
    """`write_run` with the fields of `RunRequest` one by one."""
    return write_run(RunRequest(run, presets, settings, sources, **more))


def write_run(request: RunRequest) -> list[Path]:
    """Write RUN/run.mk and RUN/config: settings of every node, and for each that ingests the list of its sources.

    Where a recipe keeps what is done (`done_stays`), settings files that are there stay as well, unless presets or
    settings are given; and recordings may be missing once the run's clouds are there.

    Returns:
        The files whose content changed.

    Raises:
        UsageError: an unknown preset, recipe, stage or setting, or a wrong value.
        InputError: a source is missing.
    """
    recipe = read_recipe(request.recipe, request.parameters, str(request.data_folder))
    overrides = [_parse_setting(text, recipe) for text in request.settings]
    presets = request.presets or (recipe.preset,)
    folder = request.run / CONFIG_FOLDER
    stays = recipe.done_stays and not request.presets and not request.settings
    contents: dict[Path, str] = {request.run / MAKEFILE: makefile_text(recipe, request.run)}
    listed: dict[Path, list[Path]] = {}
    faults: list[UsageError] = []
    for node in recipe.nodes.values():
        try:
            read = _sources_of(recipe, node, request)
            read_files = source_files(read)
        except InputError:
            if _may_be_missing(recipe, request.run):
                continue
            raise
        try:
            values = _values_of(node, presets, overrides, read, _reads_embedded_alone(recipe, request))
        except UsageError as error:
            faults.append(error)
            continue
        file = folder / config_name(node)
        if not (stays and file.exists()):
            given = "".join(f"# Given by the makefile: {each}\n" for each in outside_inputs(recipe, node))
            contents[file] = f"# Settings of `pumps {' '.join(node.stage.command)}`.\n{given}{toml_text(values)}"
        if read:
            splits = [Path(values["splits"])] if values["splits"] else _splits_beside(read)
            listed[folder / source_list_name(node)] = [*read_files, *splits]
    if faults:
        raise UsageError("\n".join(fault.message for fault in faults), faults[0].hint)
    for file, paths in listed.items():
        contents[file] = _source_list(paths, folder / _DIGEST_CACHE)
    return [file for file, text in contents.items() if _write_if_changed(file, text)]


def _values_of(
    node: Node, presets: Sequence[str], overrides: Sequence[tuple[str, Layer]], read: Sequence[str], embedded: bool
) -> dict[str, Any]:
    """A node's settings: presets, what is given for its stage, the recipe's, what is given for the node alone."""
    layers = [layer for preset in presets for layer in preset_layers(preset, node.stage.name)]
    layers += [layer for name, layer in overrides if name == node.stage.name]
    layers.append(Layer("the recipe", node.settings))
    if embedded:
        layers.append(Layer("the recipe", node.on_embedded))
    layers += [layer for name, layer in overrides if name == node.name]
    if read:
        layers.append(Layer(COMMAND_LINE, {"sources": tuple(read)}))
    what = f"pumps {' '.join(node.stage.command)}"
    return settle_file_part(node.stage.config_type(), layers, what=what, inputs=_inputs_of(node))


def _inputs_of(node: Node) -> dict[str, Any]:
    """What the command line gives: field -> value, or values where there are several."""
    fields: dict[str, list[str]] = {}
    for key, place in node.inputs:
        fields.setdefault(key, []).append(place)
    return {key: tuple(values) if len(values) > 1 else values[0] for key, values in fields.items()}


def _sources_of(recipe: Recipe, node: Node, request: RunRequest) -> tuple[str, ...]:
    """What a node ingests: its own sources or archives, what was given, or the recipe's archives."""
    if node.stage.name != "ingest":
        return ()
    own = node.settings.get("sources")
    if own:
        return (own,) if isinstance(own, str) else tuple(own)
    if node.archives:
        if request.sources:
            raise UsageError(f"The recipe {recipe.name} reads its own archives alone.", "Leave out --source (DATA).")
        recipe_sources(recipe.name, recipe.data, request.data_folder)  # reports all missing archives at once
        return recipe_sources(recipe.name, DataNeeded(archives=node.archives), request.data_folder)
    if request.sources or not recipe.name:
        return tuple(request.sources)
    return recipe_sources(recipe.name, recipe.data, request.data_folder)


def _reads_embedded_alone(recipe: Recipe, request: RunRequest) -> bool:
    """Whether the run reads the clips that come with pumps alone."""
    if request.sources:
        return tuple(request.sources) == (embedded_clips(),)
    return (
        bool(recipe.name) and recipe.data.embedded == "alone" and not archives_there(recipe.data, request.data_folder)
    )


def _may_be_missing(recipe: Recipe, run: Path) -> bool:
    """Whether recordings may be missing: the trainings of such a run read its clouds alone, which are there."""
    return recipe.done_stays and (run / "sample-tpc" / "manifest.json").exists()


def _splits_beside(sources: Sequence[str]) -> list[Path]:
    """The splits files that `pumps ingest` takes by itself: beside archives and files, and in folders."""
    folders = [Path(archive_and_member(text)[0] or text) for text in sources]
    beside = [(each if each.is_dir() else each.parent) / "splits.json" for each in folders]
    return sorted({path for path in beside if path.is_file()})


def source_files(sources: Iterable[str]) -> list[Path]:
    """The files on disk that the sources stand for: archives and plain files, folders and globs followed.

    Raises:
        InputError: a source names nothing.
    """
    from stages.shared.formats.readers import AUTO, rig_suffixes, suffixes_of
    from stages.shared.formats.sources import find_sources

    found = find_sources(list(sources), (*suffixes_of(AUTO), *rig_suffixes()))
    return sorted({Path(source.archive or source.name) for source in found})


def _parse_setting(text: str, recipe: Recipe) -> tuple[str, Layer]:
    """ "train-ae.encoder.width=16" as the stage or node and a layer."""
    name, equals, value = text.partition("=")
    stage, *path = name.strip().split(".")
    if stage in OLD_NAMES and stage not in recipe.nodes:
        tell_old_name(f"The stage {stage} of --set", OLD_NAMES[stage])
        stage = OLD_NAMES[stage]
    if not equals or not path or (stage not in NAMES and stage not in recipe.nodes):
        raise UsageError(
            f"--set {text!r} is not a STAGE.FIELD=VALUE, as train-ae.steps=100 is.", f"Stages are {', '.join(NAMES)}."
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
