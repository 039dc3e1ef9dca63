"""`pumps run`: a run from its recipe to its results, where there is no make."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from pumps_cli.commands.config import RunData, RunParameters, RunPresets, RunSettings, RunSources
from pumps_cli.outcome import Manner, errors_reported
from pumps_cli.stage_command import Debug, Quiet
from pumps_cli.terminal import say
from stages.shared.settings.recipes import GOAL, read_recipe, recipe_path
from stages.shared.settings.run_folder import RunRequest, write_run
from stages.shared.settings.run_following import commands_of, follow, results_of

EXAMPLE = "Example: pumps run --preset tiny --source recordings --run runs/mine"


def command(
    recipe: Annotated[
        str, typer.Argument(metavar="RECIPE", help="A recipe of `pumps config recipes`, or a TOML file of one.")
    ] = "",
    run: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="The run's folder; by default runs/RECIPE, or runs/mine.")
    ] = None,
    preset: RunPresets = None,
    settings: RunSettings = None,
    source: RunSources = None,
    parameters: RunParameters = None,
    data: RunData = Path("."),
    goal: Annotated[str, typer.Option(metavar="NAME", help="What to make of the run.")] = GOAL,
    minutes: Annotated[
        float | None, typer.Option(metavar="N", help="Stop each training after so many minutes; run again to go on.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Write the settings and print the commands of the run, and run none.")
    ] = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Make a run: ingest, train, fill, measure, report. Without a recipe, that of `make demo` on your recordings.

    Steps that are up to date are left out, and an interrupted run goes on where it was, as with make.
    """
    manner = Manner(quiet=quiet, debug=debug)
    with errors_reported(manner, "pumps run"):
        folder = run or Path("runs") / (recipe_path(recipe).stem if recipe else "mine")
        write_run(RunRequest(folder, preset or (), settings or (), source or (), recipe, parameters or (), data))
        made = read_recipe(recipe, parameters or (), str(data))

        def execute(words: Sequence[str]) -> None:
            if not quiet:
                say(f"pumps {shlex.join(words)}")
            _execute(words, quiet)

        if dry_run:
            for words in commands_of(made, folder, goal):
                say(f"pumps {shlex.join(words)}")
            return
        count = follow(made, folder, goal, execute, max_time=minutes)
        if quiet:
            return
        if not count:
            say(f"All of {folder} is up to date.")
        for title, place, metrics in results_of(made, folder, goal):
            if title:
                say(f"{title}:")
            if metrics:
                _execute(["results", str(place)], quiet)
            else:
                say(f"Report: {place.resolve()}")


def _execute(words: Sequence[str], quiet: bool) -> None:
    """Run `pumps` in a process of its own. Leaves with its exit code where it fails; it has said why."""
    sys.stdout.flush()
    code = subprocess.run([sys.executable, "-m", "pumps_cli", *words, *(["--quiet"] if quiet else [])]).returncode
    if code:
        raise typer.Exit(code)
