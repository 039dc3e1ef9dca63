"""The `pumps` command. Only the command that is asked for is built, so that help comes at once and without torch."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Annotated

import typer

from data_schemas.version import PUMPS_VERSION
from stages.registry import GROUP_SUMMARIES, OLD_NAMES, OLD_WORDS, STAGES, Stage, stage_named
from stages.shared.threads import let_waiting_threads_sleep

_ABOUT = "Fill in human motion on any skeleton: BVH in, infilled BVH out."
_EXAMPLE = "Example: pumps infill walk.bvh --keyframes 0,15,40 -o filled.bvh"

# Commands beside the stages: name -> (module that holds its typer `app`, what help says of it).
_TOOLS = {
    "artefact": ("pumps_cli.commands.artefact", "Show an artefact, check its digests, draw what it came from."),
    "config": ("pumps_cli.commands.config", "Show presets; write a run's settings, one file a stage."),
    "formats": ("pumps_cli.commands.formats", "List the formats that are read, with their traps."),
    "results": ("pumps_cli.commands.results", "Print the table of a metrics artefact."),
    "stages": ("pumps_cli.commands.stages", "List the stages in order, with what each reads and writes."),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `pumps` with these arguments (default: the shell's). Leaves by SystemExit with the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    given = _today(given)
    wanted = next((word for word in given if not word.startswith("-")), None)
    everything = "_PUMPS_COMPLETE" in os.environ  # the shell asks for completions
    let_waiting_threads_sleep()
    build_app(wanted, everything=everything)(args=given, prog_name="pumps")


def _today(given: list[str]) -> list[str]:
    """The arguments with a command's old word replaced by those of today, which is told on stderr."""
    at = next((place for place, word in enumerate(given) if not word.startswith("-")), None)
    if at is None or given[at] not in OLD_WORDS:
        return given
    words = stage_named(OLD_NAMES[given[at]]).command
    new = " ".join(words)
    print(f"`pumps {given[at]}` is now `pumps {new}`; the old word goes in the next version.", file=sys.stderr)
    return [*given[:at], *words, *given[at + 1 :]]


def build_app(wanted: str | None, *, everything: bool = False) -> typer.Typer:
    """The app with the wanted command whole, and all others by name and summary only."""
    app = typer.Typer(
        help=_ABOUT, epilog=_EXAMPLE, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode="rich",
        context_settings={"help_option_names": ["-h", "--help"]},
    )  # fmt: skip
    app.callback()(_root)
    for name, build in _commands():
        build(app, everything or name == wanted)
    return app


def _print_version(asked: bool) -> None:
    if asked:
        print(f"pumps {PUMPS_VERSION}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    """What stands before a command."""


def _commands() -> list[tuple[str, Callable[[typer.Typer, bool], None]]]:
    """Every word that may follow `pumps`, with what adds it to an app (whole, or by name only)."""
    words = dict.fromkeys(stage.command[0] for stage in STAGES)
    found: list[tuple[str, Callable[[typer.Typer, bool], None]]] = []
    for word in words:
        members = [stage for stage in STAGES if stage.command[0] == word]
        found.append((word, lambda app, whole, word=word, members=members: _add_stages(app, word, members, whole)))
    found += [(name, lambda app, whole, name=name: _add_tool(app, name, whole)) for name in _TOOLS]
    return found


def _add_stages(app: typer.Typer, word: str, members: list[Stage], whole: bool) -> None:
    if not whole:
        _add_name(app, word, GROUP_SUMMARIES.get(word) or members[0].summary)
        return
    from pumps_cli.stage_command import add_stage

    if word not in GROUP_SUMMARIES:
        add_stage(app, members[0])
        return
    group = typer.Typer(help=GROUP_SUMMARIES[word], no_args_is_help=True)
    group.callback()(lambda: None)  # a group of one command is a group still
    for stage in members:
        add_stage(group, stage)
    app.add_typer(group, name=word, epilog=f"Example: {members[0].example}")


def _add_tool(app: typer.Typer, name: str, whole: bool) -> None:
    module, summary = _TOOLS[name]
    if whole:
        app.add_typer(import_module(module).app, name=name, help=summary)
    else:
        _add_name(app, name, summary)


def _add_name(app: typer.Typer, name: str, summary: str) -> None:
    app.command(name, help=summary)(lambda: None)
