"""Following a run's steps without make: those whose files are missing, or older than what they are made from."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from data_schemas.errors import InputError, UsageError
from stages.shared.settings.recipes import Recipe
from stages.shared.settings.run_steps import RUN, Step, items_of, needed_nodes, steps_of

Execute = Callable[[Sequence[str]], None]


def follow(recipe: Recipe, run: Path, goal: str, execute: Execute, *, max_time: float | None = None) -> int:
    """Make a goal of a run; returns how many commands were executed.

    Args:
        execute: runs `pumps` with these words, and raises an error where it fails.
        max_time: minutes left for a training, which it is then given as `--max-time`.

    Raises: UsageError for an unknown goal; InputError where a command did not make its file.
    """
    count = 0
    for step in _steps_to(recipe, goal):
        for item in _items(recipe, step, run):
            if _is_done(recipe, step, run, item):
                continue
            _make(recipe, step, run, item, execute, max_time)
            count += 1
    return count


def commands_of(recipe: Recipe, run: Path, goal: str) -> Iterator[list[str]]:
    """The words after `pumps` of a goal's commands, in order. The name of a list stands for its items.

    Raises: UsageError for an unknown goal.
    """
    for step in _steps_to(recipe, goal):
        if step.command:
            yield [_filled(word, run, {}) for part in step.command for word in part.words]


def results_of(recipe: Recipe, run: Path, goal: str) -> Iterator[tuple[str, Path, bool]]:
    """What a goal shows: title, folder or page, and whether it is a folder of metrics."""
    steps = steps_of(recipe)
    for shown in recipe.goals[goal].show:
        title, _, name = shown.rpartition("=")
        metrics = steps[name].node.stage.writes == "metrics"
        yield title, run / name if metrics else Path(_filled(steps[name].done, run, {})), metrics


def _steps_to(recipe: Recipe, goal: str) -> list[Step]:
    if goal not in recipe.goals:
        raise UsageError(f"There is no goal {goal!r}.", f"Goals are {', '.join(recipe.goals)}.")
    steps = steps_of(recipe)
    return [steps[node.name] for node in needed_nodes(recipe, recipe.goals[goal].nodes)]


def _make(recipe: Recipe, step: Step, run: Path, item: str, execute: Execute, max_time: float | None) -> None:
    done = Path(_filled(step.done, run, {step.of_list: item}))
    if step.copied:
        shutil.copytree(_filled(step.copied, run, {}), done.parent, dirs_exist_ok=True, copy_function=shutil.copyfile)
    else:
        if step.node.stage.writes_file:
            done.parent.mkdir(parents=True, exist_ok=True)
        words = list(_words(recipe, step, run, item))
        if step.limited and max_time is not None:
            words += ["--max-time", f"{max_time:g}"]
        execute(words)
    if not done.is_file():
        raise InputError(
            f"{step.node.name} stopped before {done} was there." if step.limited else f"{done} was not made.",
            "Run it again to go on." if step.limited else "Look at the messages above.",
        )


def _words(recipe: Recipe, step: Step, run: Path, item: str) -> Iterator[str]:
    for part in step.command:
        if part.repeated:
            for each in items_of(recipe.lists[part.repeated], run):
                yield from (_filled(word, run, {part.repeated: each}) for word in part.words)
        else:
            yield from (_filled(word, run, {step.of_list: item}) for word in part.words)


def _items(recipe: Recipe, step: Step, run: Path) -> list[str]:
    """The items that a step is made for; one empty item where it is made once."""
    return items_of(recipe.lists[step.of_list], run) if step.of_list else [""]


def _is_done(recipe: Recipe, step: Step, run: Path, item: str) -> bool:
    done = Path(_filled(step.done, run, {step.of_list: item}))
    if not done.exists() or recipe.done_stays:
        return done.exists()
    made = os.stat(done).st_mtime_ns
    return all(os.stat(path).st_mtime_ns <= made for text in step.needed for path in _files(recipe, text, run))


def _files(recipe: Recipe, text: str, run: Path) -> list[Path]:
    """The files that a text stands for: one, or those of all items of its list."""
    named = next((each for each in recipe.lists if f"{{{each}}}" in text), "")
    items = items_of(recipe.lists[named], run) if named else [""]
    files = [Path(_filled(text, run, {named: item})) for item in items]
    for path in files:
        if not path.exists():
            raise InputError(f"{path} is missing, and no step of this run makes it.", "Write the run again.")
    return files


def _filled(text: str, run: Path, items: dict[str, str]) -> str:
    values = {RUN: str(run), **{f"{{{name}}}": item for name, item in items.items() if name}}
    return re.sub("|".join(map(re.escape, values)), lambda found: values[found[0]], text)
