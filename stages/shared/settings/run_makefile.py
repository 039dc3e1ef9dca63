"""RUN/run.mk: the steps of a run as make sees them, with target, prerequisites and command of each.

Paths in it begin with $(R), so that a run can be copied: `make -f RUN/run.mk` makes it by itself, and the Makefile
includes it. Variables that it takes: R, PUMPS, TRAIN_FLAGS (for all trainings) and UNTIL (seconds since 1970 at which
trainings stop with a checkpoint).
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from stages.shared.settings.recipes import GOAL, FileList, Recipe
from stages.shared.settings.run_steps import RUN, Part, Step, lists_in, needed_nodes, steps_of

MAKEFILE = "run.mk"
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
    steps = steps_of(recipe)
    blocks = [_PREAMBLE.format(run=run)]
    blocks += [_list(name, each) for name, each in recipe.lists.items()]
    goals = sorted(recipe.goals.items(), key=lambda item: item[0] != GOAL)  # the first is what make makes by itself
    blocks += ["\n".join(_goal(recipe, steps, name)) + "\n" for name, _ in goals]
    blocks += ["\n".join(_rule(recipe, step)) + "\n" for step in steps.values()]
    blocks.append(f".PRECIOUS: {' '.join(_files(recipe, step.done) for step in steps.values())}\n")
    return "\n".join(blocks)


def _goal(recipe: Recipe, steps: dict[str, Step], name: str) -> Iterator[str]:
    """A goal's targets: first what its lists of files come from; then, in a second make that sees them, all else."""
    goal = recipe.goals[name]
    target = name if name == GOAL else f"{GOAL}-{name}"
    makers = sorted(
        {recipe.lists[each].of for node in needed_nodes(recipe, goal.nodes) for each in lists_in(recipe, node)}
    )
    yield f".PHONY: {target}"
    if makers:
        yield f"{target}: {' '.join(_files(recipe, steps[each].done) for each in makers)}"
        yield f"\t+@$(again) {target}-all"
        target += "-all"
        yield f".PHONY: {target}"
    yield f"{target}: {' '.join(_files(recipe, steps[each].done) for each in goal.nodes)}"
    for shown in goal.show:
        title, _, node_name = shown.rpartition("=")
        step = steps[node_name]
        if title:
            yield f"\t@echo '{title}:'"
        if step.node.stage.writes == "metrics":
            yield f"\t@$(PUMPS) results $(R)/{node_name}"
        else:
            yield f"\t@echo 'Report: $(abspath {_files(recipe, step.done)})'"
    if not goal.show:
        yield "\t@:"


def _rule(recipe: Recipe, step: Step) -> Iterator[str]:
    """A step's target, prerequisites and commands."""
    target, needed = _files(recipe, step.done), " ".join(_files(recipe, each) for each in step.needed)
    if recipe.done_stays:
        yield f"{target}: $(if $(wildcard {target}),,{needed})"
    elif step.of_list:
        yield f"{target}: {_text(step.done.replace(f'{{{step.of_list}}}', '%'))}: {needed}"
    else:
        yield f"{target}: {needed}"
    if step.copied:
        yield "\t@mkdir -p $(@D)"
        yield f"\tcp -R {_text(step.copied)}/. $(@D)"
        return
    if step.limited:
        yield "\t$(in_time)"
    if step.node.stage.writes_file:
        yield "\t@mkdir -p $(@D)"
    words = [text for part in step.command if (text := _words(part, step))]
    yield "\t" + " ".join(["$(PUMPS)", *words, *(["$(TRAIN_FLAGS)", "$(limit)"] if step.limited else [])])
    if step.limited:
        yield "\t$(finished)"


def _words(part: Part, step: Step) -> str:
    """Words of a command for the shell, in which make puts the items of lists."""
    is_file = step.node.stage.writes_file
    text = " ".join("$@" if is_file and each == step.done else _quoted(each) for each in part.words)
    if part.repeated:
        return f"$(foreach each,$({part.repeated}_list),{text})".replace(f"{{{part.repeated}}}", "$(each)")
    return text.replace(f"{{{step.of_list}}}", "$*") if step.of_list else text


def _files(recipe: Recipe, text: str) -> str:
    """A file of the run, or all the files that a list makes of it."""
    found = re.fullmatch(r"(.*)\{([a-z-]+)\}(.*)", text.removeprefix(RUN))
    if found and found[2] in recipe.lists:
        return f"$({found[2]}_list:%={_text(RUN)}{found[1]}%{found[3]})"
    return _text(text)


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


def _text(text: str) -> str:
    return text.replace(RUN, "$(R)")


def _quoted(word: str) -> str:
    """A word for the shell, in which make still puts its variables."""
    word = _text(word)
    plain = re.sub(r"\$\(\w+\)|\{[a-z-]+\}", "", word)
    return word if plain == "" or shlex.quote(plain) == plain else "'" + word.replace("'", "'\\''") + "'"
