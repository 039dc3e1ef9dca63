"""RUN/run.mk: the nodes of a run as make sees them, with target, prerequisites and command of each.

Paths in it begin with $(R), so that a run can be copied: `make -f RUN/run.mk` makes it by itself, and the Makefile
includes it. Variables that it takes: R, PUMPS, TRAIN_FLAGS (for all trainings) and UNTIL (seconds since 1970 at which
trainings stop with a checkpoint).
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

from stages.shared.settings.recipes import GOAL, FileList, Node, Recipe
from stages.shared.weights.shipped import PARTS, SHIPPED

MAKEFILE = "run.mk"
CONFIG_FOLDER = "config"
_PREAMBLE = """\
# Written by `pumps config write`: the targets of this run, what each is made from, and its command.
R ?= {run}
PUMPS ?= pumps
again = $(MAKE) --no-print-directory -f $(firstword $(MAKEFILE_LIST)) R='$(R)'
in_time = $(if $(UNTIL),@test $(UNTIL) -gt $$(date +%s) || {{ echo 'The time is over; run make again to go on.' >&2; exit 1; }})
limit = $(if $(UNTIL),--max-time $$(awk "BEGIN {{ print ($(UNTIL) - $$(date +%s)) / 60 }}"))
finished = @test -f $@ || {{ echo '$(@D): training stopped before its end; run make again to go on.' >&2; exit 1; }}
"""  # noqa: E501, a line of make is one line


def makefile_text(recipe: Recipe, run: Path) -> str:
    """The text of a run's makefile."""
    blocks = [_PREAMBLE.format(run=run)]
    blocks += [_list(name, each) for name, each in recipe.lists.items()]
    goals = sorted(recipe.goals.items(), key=lambda item: item[0] != GOAL)  # the first is what make makes by itself
    blocks += ["\n".join(_goal(recipe, name)) + "\n" for name, _ in goals]
    blocks += ["\n".join(_Rule(recipe, node).lines()) + "\n" for node in recipe.nodes.values()]
    blocks.append(f".PRECIOUS: {' '.join(_target(recipe, node) for node in recipe.nodes.values())}\n")
    return "\n".join(blocks)


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
        if not _unlabelled(place).startswith(".") and not _node_of(recipe, _unlabelled(place))
    ]


def _goal(recipe: Recipe, name: str) -> Iterator[str]:
    """A goal's targets: first what its lists of files come from; then, in a second make that sees them, all else."""
    goal = recipe.goals[name]
    target = name if name == GOAL else f"{GOAL}-{name}"
    makers = sorted(
        {recipe.lists[each].of for node in _all_of(recipe, goal.nodes) for each in _lists_in(recipe, node)}
    )
    yield f".PHONY: {target}"
    if makers:
        yield f"{target}: {' '.join(_target(recipe, recipe.nodes[each]) for each in makers)}"
        yield f"\t+@$(again) {target}-all"
        target += "-all"
        yield f".PHONY: {target}"
    yield f"{target}: {' '.join(_target(recipe, recipe.nodes[each]) for each in goal.nodes)}"
    for shown in goal.show:
        title, _, node_name = shown.rpartition("=")
        node = recipe.nodes[node_name]
        if title:
            yield f"\t@echo '{title}:'"
        if node.stage.writes == "metrics":
            yield f"\t@$(PUMPS) results $(R)/{node.name}"
        else:
            yield f"\t@echo 'Report: $(abspath {_target(recipe, node)})'"
    if not goal.show:
        yield "\t@:"


def _all_of(recipe: Recipe, names: Sequence[str]) -> list[Node]:
    """The nodes of these names and all that they are made from."""
    found: dict[str, Node] = {}
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        node = found[name] = recipe.nodes[name]
        waiting += node.after
        waiting += [each for _, place in node.inputs if (each := _node_of(recipe, _unlabelled(place)))]
    return list(found.values())


class _Rule:
    """One node's rule: what it is made from, and its command."""

    def __init__(self, recipe: Recipe, node: Node):
        self.recipe, self.node = recipe, node
        self.of_list = next((each for each in recipe.lists if f"{{{each}}}" in node.stage.target), "")

    def lines(self) -> Iterator[str]:
        node, target = self.node, _target(self.recipe, self.node)
        if node.copy_of:
            source, needed = self._place(node.copy_of)
            yield self._head(target, needed)
            yield "\t@mkdir -p $(@D)"
            yield f"\tcp -R {source}/. $(@D)"
            return
        words, needed = self._words()
        config = f"$(R)/{CONFIG_FOLDER}/{config_name(node)}"
        needed.insert(0, config)
        if node.stage.name == "ingest":
            needed.append(f"$(R)/{CONFIG_FOLDER}/{source_list_name(node)}")
        yield self._head(target, list(dict.fromkeys(needed)))
        training = node.stage.command[0] == "train"
        if training:
            yield "\t$(in_time)"
        if node.stage.writes_file:
            yield "\t@mkdir -p $(@D)"
        given, flags = words
        command = ["$(PUMPS)", *node.stage.command, *given, "--config", config, *flags]
        if "overwrite" in node.stage.config_type().model_fields:
            command.append("--overwrite")
        if node.stage.writes:
            command += ["-o", "$@" if node.stage.writes_file else f"$(R)/{node.name}"]
        yield "\t" + " ".join([*command, *(["$(TRAIN_FLAGS)", "$(limit)"] if training else [])])
        if training:
            yield "\t$(finished)"

    def _head(self, target: str, needed: Sequence[str]) -> str:
        if self.recipe.done_stays:
            return f"{target}: $(if $(wildcard {target}),,{' '.join(needed)})"
        pattern = f"$(R)/{self.node.done.replace(f'{{{self.of_list}}}', '%')}: " if self.of_list else ""
        return f"{target}: {pattern}{' '.join(needed)}"

    def _words(self) -> tuple[tuple[list[str], list[str]], list[str]]:
        """Words by place, flags, and prerequisites."""
        given: list[str] = []
        flags: list[str] = []
        needed: list[str] = []
        for each, group in groupby(self.node.inputs, key=lambda item: self._listed(item[1])):
            here: list[str] = []
            for key, text in group:
                place, of_place = self._place(_unlabelled(text))
                needed += of_place
                word = _quoted(text[: len(text) - len(_unlabelled(text))] + place)
                if key in self.node.stage.arguments:
                    given.append(word)
                else:
                    here.append(f"--{key.replace('_', '-')} {word}")
            if each and not self.of_list:
                flags.append(f"$(foreach each,$({each}_list),{' '.join(here)})".replace(f"{{{each}}}", "$(each)"))
            else:
                flags += here
        if self.of_list:
            given, flags = ([word.replace(f"{{{self.of_list}}}", "$*") for word in words] for words in (given, flags))
        needed += [_target(self.recipe, self.recipe.nodes[each]) for each in self.node.after]
        return (given, flags), needed

    def _listed(self, text: str) -> str:
        return next((each for each in self.recipe.lists if f"{{{each}}}" in text), "")

    def _place(self, text: str) -> tuple[str, list[str]]:
        """A place as make sees it, and what must be there first."""
        if text == ".":
            return "$(R)", []
        if text.startswith("./"):
            return f"$(R)/{text[2:]}", []
        node = _node_of(self.recipe, text)
        if node:
            return f"$(R)/{text}", [_target(self.recipe, self.recipe.nodes[node])]
        path = Path(text)
        trained = path.with_name(dict(zip(*PARTS, strict=True)).get(path.name, path.name))
        if not path.exists() and trained.exists():  # a run's folder has its parts under other names
            path = trained
        folder = path if path.exists() else SHIPPED / text
        manifests = sorted([*folder.glob("manifest.json"), *folder.glob("*/manifest.json")])
        return str(path), [str(each) for each in manifests]


def _target(recipe: Recipe, node: Node) -> str:
    """The file, or for a node that is made for each item of a list the files, that say that it is done."""
    listed = re.fullmatch(r"(.*)\{([a-z-]+)\}(.*)", node.done)
    if listed and listed[2] in recipe.lists:
        return f"$({listed[2]}_list:%=$(R)/{listed[1]}%{listed[3]})"
    return f"$(R)/{node.done}"


def _list(name: str, files: FileList) -> str:
    """A list's variable: what stands in the place of the asterisks, those that come first before the others."""
    head, tail = files.files.split("*", 1)[0], files.files.rsplit("*", 1)[1]
    pattern = re.sub(r"\*(/\*)*", "%", files.files)
    found = f"$(patsubst $(R)/{pattern},%,$(wildcard $(R)/{files.files}))"
    assert pattern == f"{head}%{tail}", files.files
    if not files.first:
        return f"{name}_list := {found}\n"
    first = "".join(f"$(filter %/{each},$({name}_found)) " for each in files.first)
    others = f"$(sort $(filter-out {' '.join(f'%/{each}' for each in files.first)},$({name}_found)))"
    return f"{name}_found := {found}\n{name}_list := {first}{others}\n"


def _node_of(recipe: Recipe, place: str) -> str:
    """The node whose folder a place lies in; "" for none."""
    fitting = [name for name in recipe.nodes if place == name or place.startswith(f"{name}/")]
    return max(fitting, key=len, default="")


def _lists_in(recipe: Recipe, node: Node) -> set[str]:
    texts = [node.done, *(text for _, text in node.inputs)]
    return {each for each in recipe.lists for text in texts if f"{{{each}}}" in text}


def _unlabelled(text: str) -> str:
    return text.rpartition("=")[2]


def _quoted(word: str) -> str:
    """A word for the shell, in which make still puts its variables."""
    plain = re.sub(r"\$\(\w+\)|\{[a-z-]+\}", "", word)
    return word if plain == "" or shlex.quote(plain) == plain else "'" + word.replace("'", "'\\''") + "'"
