"""Recipes of tables and of pretraining: TOML files that list nodes, each a stage with its settings and inputs.

A text in a recipe may hold {NAME}, which stands for a word: a parameter of the recipe (`--with NAME=WORDS`), a key of
its rows (`[[each]]`), or one of `recipe` (its name), `data` (the folder of archives) and `clips` (the folder of the
clips that come with pumps). In rows it may stand for all of these except keys of rows. A node whose name holds a key
of the rows is made once for each row. A text that is one {NAME} alone stands for all of its words; a text whose word
is missing is left out.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from data_schemas.errors import UsageError
from stages.registry import PIPELINE, Stage, stage_named
from stages.shared.toml import parse_value, read_toml
from stages.shared.weights.shipped import named_source

Words = Mapping[str, tuple[str, ...]]
_NAME = re.compile(r"\{([a-z-]+)\}")
GOAL = "run"  # what a run makes unless another goal is named


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class DataNeeded(_Strict):
    """The recordings of a recipe.

    archives: data sets by their names in the catalogue.
    missing:  whether a data set that is not there is refused, or left out.
    embedded: whether the clips that come with pumps are read: beside the archives, or alone where none is there.
    """

    archives: tuple[str, ...] = ()
    missing: Literal["refused", "left-out"] = "refused"
    embedded: Literal["", "beside", "alone"] = ""


class Goal(_Strict):
    """What a target makes, and the nodes whose results it then prints ("TITLE=node" prints a title first)."""

    nodes: tuple[str, ...]
    show: tuple[str, ...] = ()


class FileList(_Strict):
    """Files of the run that are known once the node `of` is done; {NAME} is what the asterisks of `files` stand for.

    first: last parts of names that come first, in this order; all others follow by name.
    """

    of: str
    files: str
    first: tuple[str, ...] = ()


class NodeText(_Strict):
    """One node as a recipe has it.

    stage:       the stage's name in the registry.
    inputs:      field of its Config -> places ("NODE", "NODE/more", "LABEL=NODE", "." for the run's folder, "./PATH"
                 for a path in it that is not a node), weights by name, or paths.
    settings:    field of its Config -> value.
    on_embedded: settings where only the clips that come with pumps are read.
    after:       nodes that are made before it, although none of its flags names them.
    archives:    data sets that it reads, for an ingest node with others than the recipe's.
    archives_of: the recipe whose archives alone are measured.
    target:      the file in the run's folder that says that it is done; by default the stage's, in the node's folder.
    copy_of:     a folder or node to copy instead of running the stage, where it is given.
    when:        the parameter without which there is no such node.
    """

    stage: str
    inputs: dict[str, str | tuple[str, ...]] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)
    on_embedded: dict[str, Any] = Field(default_factory=dict)
    after: tuple[str, ...] = ()
    archives: tuple[str, ...] = ()
    archives_of: str = ""
    target: str = ""
    copy_of: str = ""
    when: str = ""


class RecipeText(_Strict):
    """A recipe as its file has it; `done_stays`: an output that is there is done, whatever the files' times are."""

    preset: str
    done_stays: bool = False
    parameters: dict[str, str] = Field(default_factory=dict)
    data: DataNeeded = DataNeeded()
    each: tuple[dict[str, str | tuple[str, ...]], ...] = ()
    lists: dict[str, FileList] = Field(default_factory=dict)
    goals: dict[str, Goal]
    nodes: dict[str, NodeText]


@dataclass(frozen=True)
class Node:
    """One node of a run, its texts filled in; fields as in `NodeText` and, for the stage, in the registry."""

    name: str
    stage: Stage
    inputs: tuple[tuple[str, str], ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    on_embedded: Mapping[str, Any] = field(default_factory=dict)
    after: tuple[str, ...] = ()
    archives: tuple[str, ...] = ()
    target: str = ""
    copy_of: str = ""

    @property
    def done(self) -> str:
        """The file in the run's folder that says that the node is done."""
        return self.target or f"{self.name}/{self.stage.target}"


@dataclass(frozen=True)
class Recipe:
    """The nodes of a run, and what is made of them."""

    name: str
    preset: str
    data: DataNeeded
    nodes: Mapping[str, Node]
    goals: Mapping[str, Goal]
    lists: Mapping[str, FileList]
    done_stays: bool = False


def pipeline(words: Words) -> Recipe:
    """The run of `make demo` and `make reproduce`: the registry's pipeline, each stage once.

    Weights that are compared also fill the clips, and the page plays them beside those that were trained.
    """
    nodes = {
        stage.name: Node(stage.name, stage, tuple(_places(stage.inputs, words)), after=stage.needs)
        for stage in PIPELINE
    }
    for text in words.get("weights", ()):
        name, source = named_source(text)
        page, fill = nodes["report"], nodes["infill"]
        compared = f"infill-{name}"
        picked = [(key, place) for key, place in fill.inputs if key != "weights"]
        nodes[compared] = Node(compared, fill.stage, (*picked, ("weights", source)), after=("data-pick",))
        played = ("motions", f"{{clip}}/{name}={compared}/{{clip}}.bvh")
        nodes["report"] = replace(page, inputs=(*page.inputs, played), after=(*page.after, compared))
    goals = {GOAL: Goal(nodes=("report", "decode"), show=("evaluate", "report"))}
    lists = {"clip": FileList(of="data-pick", files="data-pick/*.bvh")}
    return Recipe("", "tiny", DataNeeded(), nodes, goals, lists)


def recipe_names() -> list[str]:
    """The recipes that ship with pumps, in alphabetical order."""
    return sorted(path.stem for path in _folder().glob("*.toml"))


def recipe_path(name: str) -> Path:
    """The file of a recipe, by its name or path. Raises UsageError when there is none."""
    if name.endswith(".toml") and Path(name).is_file():
        return Path(name)
    if name not in recipe_names():
        raise UsageError(
            f"There is no recipe {name!r}.", f"Take one of {', '.join(recipe_names())}, or a file NAME.toml."
        )
    return _folder() / f"{name}.toml"


def read_recipe(name: str, given: Sequence[str] = (), data_folder: str = "") -> Recipe:
    """A recipe with its texts filled in; without a name, the pipeline.

    Args:
        name:        of a recipe that ships with pumps, or a TOML file of one.
        given:       "NAME=WORDS" each, parameters of the recipe.
        data_folder: where its archives lie.

    Raises: UsageError for an unknown recipe or parameter, or a file that is not a recipe.
    """
    text = _text(name) if name else None
    words = _parameters(name, {"weights": ""} if text is None else text.parameters, given)
    if text is None:
        return pipeline(words)
    words |= {"recipe": (recipe_path(name).stem,), "data": (data_folder,), "clips": (embedded_clips(),)}
    words = {key: tuple(w for each in value for w in filled(each, words)) for key, value in words.items()}
    rounds, ends = _rounds(words)
    words |= ends
    rows = [{key: _all(_several(value), words) for key, value in row.items()} for row in text.each]
    nodes: dict[str, Node] = {}
    absent: set[str] = set()
    for key, node in text.nodes.items():
        for row in _rows_of(key, [*rows, *rounds]):
            made = _node(key, node, {**words, **row})
            if not node.when or words[node.when]:
                nodes[made.name] = made
            else:
                absent.add(made.name)
    goals = {
        key: Goal(nodes=_all(goal.nodes, words), show=_all(goal.show, words)) for key, goal in text.goals.items()
    }
    return Recipe(name, text.preset, text.data, _without(nodes, absent), goals, text.lists, text.done_stays)


def filled(text: str, words: Words) -> list[str]:
    """`text` with its {NAME}s replaced; names that are not words stay. Empty where a word is missing."""
    alone = _NAME.fullmatch(text)
    if alone and alone[1] in words:
        return list(words[alone[1]])
    if any(not words[name] for name in _NAME.findall(text) if name in words):
        return []
    return [_NAME.sub(lambda found: words[found[1]][0] if found[1] in words else found[0], text)]


def embedded_clips() -> str:
    """The folder of the clips that come with pumps, relative to the working folder where it lies inside."""
    folder = Path(str(files("stages.shared.clips")))
    return os.path.relpath(folder) if folder.is_relative_to(Path.cwd()) else str(folder)


def _node(name: str, text: NodeText, words: Words) -> Node:
    settings = _settings(text.settings, words)
    if text.archives_of:
        names = ", ".join(f'"{archive}.zip"' for archive in _text(text.archives_of).data.archives)
        settings["where"] = f"archive in ({names},)"
    inputs = [(key, each) for key, value in text.inputs.items() for each in _several(value)]
    return Node(
        name=filled(name, words)[0],
        stage=_stage(text.stage),
        inputs=tuple(_places(inputs, words)),
        settings=settings,
        on_embedded=_settings(text.on_embedded, words),
        after=_all(text.after, words),
        archives=_all(text.archives, words),
        target="".join(filled(text.target, words)),
        copy_of="".join(filled(text.copy_of, words)),
    )


def _stage(name: str) -> Stage:
    try:
        return stage_named(name)
    except KeyError as error:
        raise UsageError(f"A recipe's node has a stage that is not there: {error.args[0]}.") from None


def _without(nodes: Mapping[str, Node], absent: Set[str]) -> dict[str, Node]:
    """The nodes without what they would take from absent ones."""
    return {
        name: replace(
            node,
            after=tuple(each for each in node.after if each not in absent),
            inputs=tuple((key, place) for key, place in node.inputs if place not in absent),
        )
        for name, node in nodes.items()
    }


def _rows_of(name: str, rows: Sequence[Mapping[str, tuple[str, ...]]]) -> Sequence[Words]:
    """The rows that a node is made for: those with all row keys of its name; one empty row where it has none."""
    keys = {key for row in rows for key in row}
    wanted = {key for key in _NAME.findall(name) if key in keys or key == "round"}
    return [row for row in rows if wanted <= row.keys()] if wanted else [{}]


def _rounds(words: Words) -> tuple[list[Words], Words]:
    """Rows of the parameter `rounds`: trainings that start from the mean of the last one's end and beginning.

    The first training is the node train-lms. It began with the weights `initial`; without them, its end stands for
    its beginning. The words `end` and `begin` are those of the last round; `trained` is what is packed.
    """
    count = int(words["rounds"][0]) if words.get("rounds") else 0
    begin = filled("{initial}/lms", words) if "initial" in words else []
    end, first = "train-lms", begin[0] if begin else "train-lms"
    rows: list[Words] = []
    for number in range(2, count + 1):
        rows.append({"round": (str(number),), "last-end": (end,), "last-begin": (first,)})
        end, first = f"round-{number}/train-lms", f"round-{number}/begin"
    return rows, {"end": (end,), "begin": (first,), "trained": ("./averaged" if count else ".",)}


def _parameters(recipe: str, defaults: Mapping[str, str], given: Sequence[str]) -> dict[str, tuple[str, ...]]:
    values = dict(defaults)
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or name not in values:
            raise UsageError(
                f"--with {text!r} is not NAME=WORDS with a parameter of {recipe or 'the pipeline'}.",
                f"Its parameters are {', '.join(values) or 'none'}.",
            )
        values[name] = value
    if not values.get("rounds", "1").strip() or values.get("rounds") == "0":
        values["rounds"] = ""
    elif not values.get("rounds", "1").isdecimal():
        raise UsageError(f"--with rounds={values['rounds']} is not a whole number.", "Give rounds=3, for example.")
    return {name: tuple(value.split()) for name, value in values.items()}


def _settings(values: Mapping[str, Any], words: Words) -> dict[str, Any]:
    return {key: found for key, value in values.items() if (found := _setting(value, words)) is not None}


def _setting(value: Any, words: Words) -> Any:
    """A value of a setting; words become numbers where they are some. None where its word is missing."""
    if isinstance(value, Mapping):
        return _settings(value, words)
    if not isinstance(value, str) or not _NAME.search(value):
        return value
    found = [parse_value(each) if _NAME.fullmatch(value) else each for each in filled(value, words)]
    return found[0] if len(found) == 1 else found or None


def _places(inputs: Sequence[tuple[str, str]], words: Words) -> Iterator[tuple[str, str]]:
    for key, text in inputs:
        for place in filled(text, words):
            yield key, place


def _all(texts: Sequence[str], words: Words) -> tuple[str, ...]:
    return tuple(word for text in texts for word in filled(text, words))


def _several(value: str | tuple[str, ...]) -> tuple[str, ...]:
    return (value,) if isinstance(value, str) else value


@cache
def _text(name: str) -> RecipeText:
    values = _with_base(name)
    try:
        return RecipeText.model_validate(values)
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors())
        raise UsageError(f"{name}.toml is not a recipe: {faults}.") from None


def _with_base(name: str) -> dict[str, Any]:
    """The tables of a recipe over those of the recipe that it `extends`."""
    values = read_toml(recipe_path(name), what="recipe")
    base = values.pop("extends", None)
    return {**_with_base(base), **values} if base else values


def _folder() -> Path:
    return Path(str(files("stages.shared.presets"))) / "recipes"
