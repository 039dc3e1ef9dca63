"""The steps of a run: for each node of a recipe the file that says that it is done, what that is made from, and the
command that makes it. `run_makefile` writes them for make, `pumps run` follows them itself.

In every text here {run} stands for the run's folder, and the name of a list of files, such as {clip}, for each of its
items in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from stages.shared.settings.recipes import FileList, Node, Recipe
from stages.shared.weights.shipped import PARTS, SHIPPED

CONFIG_FOLDER = "config"
RUN = "{run}"


@dataclass(frozen=True)
class Part:
    """Words of a command; with `repeated`, the name of a list of files, all of them once for each of its items."""

    words: tuple[str, ...]
    repeated: str = ""


@dataclass(frozen=True)
class Step:
    """How a node is made.

    done:      the file that says that it is done.
    of_list:   the list for whose items it is made one by one, `done` and `command` holding its name; "" for none.
    needed:    files that are older than `done` if it is up to date.
    command:   the words after `pumps`; none where a folder is copied.
    copied:    the folder that is copied instead.
    limited:   whether it is a training, which a time limit may stop before its end.
    """

    node: Node
    done: str
    of_list: str
    needed: tuple[str, ...]
    command: tuple[Part, ...] = ()
    copied: str = ""

    @property
    def limited(self) -> bool:
        return bool(self.command) and self.node.stage.command[0] == "train"


def steps_of(recipe: Recipe) -> dict[str, Step]:
    """The step of every node, by its name."""
    return {name: _step(recipe, node) for name, node in recipe.nodes.items()}


def needed_nodes(recipe: Recipe, names: Sequence[str]) -> list[Node]:
    """The nodes of these names and all that they are made from, each before those that are made from it."""
    found: dict[str, Node] = {}

    def add(name: str, above: tuple[str, ...]) -> None:
        assert name not in above, f"{name} is made from itself"
        if name not in found:
            node = recipe.nodes[name]
            lists = [recipe.lists[each].of for each in lists_in(recipe, node)]
            made_from = [maker for _, place in node.inputs if (maker := node_of(recipe, without_label(place)))]
            for each in (*lists, *node.after, *made_from):
                add(each, (*above, name))
            found[name] = node

    for name in names:
        add(name, ())
    return list(found.values())


def lists_in(recipe: Recipe, node: Node) -> list[str]:
    """The lists of files that a node depends on."""
    texts = [node.done, *(text for _, text in node.inputs)]
    return [each for each in recipe.lists if any(f"{{{each}}}" in text for text in texts)]


def items_of(files: FileList, run: Path) -> list[str]:
    """What the asterisks of a list stand for in a run, in the list's order."""
    head, tail = files.files.split("*", 1)[0], files.files.rsplit("*", 1)[1]
    found = [path.relative_to(run).as_posix() for path in run.glob(files.files)]
    items = sorted(text[len(head) : len(text) - len(tail)] for text in found)
    order = {name: place for place, name in enumerate(files.first)}
    return sorted(items, key=lambda item: (order.get(item.rpartition("/")[2], len(order)), item))


def config_name(node: Node) -> str:
    """A node's settings file in the run's config folder."""
    return f"{node.name}.toml"


def source_list_name(node: Node) -> str:
    """The file in the run's config folder that lists what an ingest node reads."""
    return "sources.txt" if node.name == "ingest" else f"{node.name}.sources.txt"


def outside_inputs(recipe: Recipe, node: Node) -> list[str]:
    """The node's inputs that no other node of the run makes, as "field = place": weights by name, and paths."""
    return [
        f"{key} = {place}"
        for key, place in node.inputs
        if not without_label(place).startswith(".") and not node_of(recipe, without_label(place))
    ]


def node_of(recipe: Recipe, place: str) -> str:
    """The node whose folder a place lies in; "" for none."""
    fitting = [name for name in recipe.nodes if place == name or place.startswith(f"{name}/")]
    return max(fitting, key=len, default="")


def without_label(text: str) -> str:
    """A place without the "LABEL=" before it."""
    return text.rpartition("=")[2]


def done_of(node: Node) -> str:
    """The file that says that a node is done."""
    return f"{RUN}/{node.done}"


def _step(recipe: Recipe, node: Node) -> Step:
    of_list = next((each for each in recipe.lists if f"{{{each}}}" in node.stage.target), "")
    if node.copy_of:
        source, needed = _place(recipe, node.copy_of)
        return Step(node, done_of(node), of_list, tuple(needed), copied=source)
    given, flags, made_from = _inputs(recipe, node)
    config = f"{RUN}/{CONFIG_FOLDER}/{config_name(node)}"
    needed = [config, *made_from, *(done_of(recipe.nodes[each]) for each in node.after)]
    if node.stage.name == "ingest":
        needed.append(f"{RUN}/{CONFIG_FOLDER}/{source_list_name(node)}")
    last: list[str] = []
    if "overwrite" in node.stage.config_type().model_fields:
        last.append("--overwrite")
    if node.stage.writes:
        last += ["-o", done_of(node) if node.stage.writes_file else f"{RUN}/{node.name}"]
    parts = (Part((*node.stage.command, *given, "--config", config)), *flags, Part(tuple(last)))
    return Step(node, done_of(node), of_list, tuple(dict.fromkeys(needed)), parts)


def _inputs(recipe: Recipe, node: Node) -> tuple[list[str], list[Part], list[str]]:
    """Words by place, flags, and the files that these are made from."""
    given: list[str] = []
    flags: list[Part] = []
    needed: list[str] = []
    own = {each for each in recipe.lists if f"{{{each}}}" in node.stage.target}

    def listed(text: str) -> str:
        return next((each for each in recipe.lists if f"{{{each}}}" in text), "")

    for each, group in groupby(node.inputs, key=lambda item: listed(item[1])):
        words: list[str] = []
        for key, text in group:
            place, made_from = _place(recipe, without_label(text))
            needed += made_from
            word = text[: len(text) - len(without_label(text))] + place
            if key in node.stage.arguments:
                given.append(word)
            else:
                words += [f"--{key.replace('_', '-')}", word]
        flags.append(Part(tuple(words), "" if each in own else each))
    return given, flags, needed


def _place(recipe: Recipe, text: str) -> tuple[str, list[str]]:
    """A place, and the files that must be there first."""
    if text == ".":
        return RUN, []
    if text.startswith("./"):
        return f"{RUN}/{text[2:]}", []
    maker = node_of(recipe, text)
    if maker:
        return f"{RUN}/{text}", [done_of(recipe.nodes[maker])]
    path = Path(text)
    trained = path.with_name(dict(zip(*PARTS, strict=True)).get(path.name, path.name))
    if not path.exists() and trained.exists():  # a run's folder has its parts under other names
        path = trained
    folder = path if path.exists() else SHIPPED / text
    manifests = sorted([*folder.glob("manifest.json"), *folder.glob("*/manifest.json")])
    return str(path), [str(each) for each in manifests]
