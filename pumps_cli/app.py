"""The `pumps` command. Only the command that is asked for is built, so that help is fast and loads no torch."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Annotated

import typer

from data_schemas.old_names import old_name_told
from data_schemas.version import PUMPS_VERSION
from pumps_cli.help_page import HelpCommand, HelpGroup
from pumps_cli.terminal import say_aside, write_any_text
from stages.registry import GROUP_SUMMARIES, OLD_NAMES, OLD_WORDS, PANELS, STAGES, stage_named
from stages.shared.memory import keep_freed_memory
from stages.shared.threads import let_waiting_threads_sleep

_ABOUT = "Fill in human motion on any skeleton: BVH in, infilled BVH out."
_EXAMPLE = "Example: pumps infill walk.bvh --keyframes 0,15,40 -o filled.bvh"

# Commands beside the stages: name -> (module that holds its typer `app`, its summary in help).
_TOOLS = {
    "artefact": ("pumps_cli.commands.artefact", "Show artefacts, check their files, show their inputs, join parts."),
    "config": ("pumps_cli.commands.config", "List and show presets; write the settings of a run."),
    "demo": ("pumps_cli.commands.demo", "Fill a clip that comes with pumps, and open a page that plays it."),
    "formats": ("pumps_cli.commands.formats", "List the file formats that pumps reads, and what to know about each."),
    "run": ("pumps_cli.commands.run", "Make a run where there is no make: ingest, train, fill, measure, report."),
    "results": ("pumps_cli.commands.results", "Print the tables of a metrics artefact."),
    "stages": ("pumps_cli.commands.stages", "List the stages in order, with what each reads and writes."),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `pumps` with these arguments (default: the shell's). Leaves by SystemExit with the exit code."""
    write_any_text()
    given = list(sys.argv[1:] if arguments is None else arguments)
    given = _today(given)
    completing = "_PUMPS_COMPLETE" in os.environ  # the shell asks for completions
    words = _words_to_complete() if completing else given
    keep_freed_memory()
    let_waiting_threads_sleep()
    build_app(next((word for word in words if not word.startswith("-")), None))(args=given, prog_name="pumps")


def tool_words() -> list[str]:
    """The commands that are not stages."""
    return [*_TOOLS]


def _words_to_complete() -> list[str]:
    """The words after `pumps` on the line that the shell asks about."""
    line = os.environ.get("_TYPER_COMPLETE_ARGS") or os.environ.get("COMP_WORDS", "")
    return line.split()[1:]


def _today(given: list[str]) -> list[str]:
    """The arguments with a command's old name replaced by today's words; a note on stderr says so."""
    at = next((place for place, word in enumerate(given) if not word.startswith("-")), None)
    if at is None or given[at] not in OLD_WORDS:
        return given
    words = stage_named(OLD_NAMES[given[at]]).command
    new = " ".join(words)
    say_aside(old_name_told(f"`pumps {given[at]}`", f"`pumps {new}`"))
    return [*given[:at], *words, *given[at + 1 :]]


def build_app(wanted: str | None) -> typer.Typer:
    """The app with the wanted command complete, and all others by name and summary only."""
    app = typer.Typer(
        cls=HelpGroup, help=_ABOUT, epilog=_EXAMPLE, no_args_is_help=True, pretty_exceptions_enable=False,
        rich_markup_mode="rich", context_settings={"help_option_names": ["-h", "--help"]},
    )  # fmt: skip
    app.callback()(_root)
    for panel, words in PANELS.items():
        for word in words:
            if word != wanted:
                app.command(word, help=_summary_of(word), rich_help_panel=panel)(lambda: None)
            elif word in _TOOLS:
                _add_tool(app, word, panel)
            else:
                _add_stages(app, word, panel)
    return app


def _print_version(asked: bool) -> None:
    if asked:
        print(f"pumps {PUMPS_VERSION}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool, typer.Option("--version", "-V", help="Print the version.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    """The options before a command."""


def _summary_of(word: str) -> str:
    if word in _TOOLS:
        return _TOOLS[word][1]
    return GROUP_SUMMARIES.get(word) or next(stage.summary for stage in STAGES if stage.command[0] == word)


def _add_stages(app: typer.Typer, word: str, panel: str) -> None:
    from pumps_cli.stage_command import add_stage

    members = [stage for stage in STAGES if stage.command[0] == word]
    if word not in GROUP_SUMMARIES:
        add_stage(app, members[0], panel)
        return
    group = typer.Typer(cls=HelpGroup, help=GROUP_SUMMARIES[word], no_args_is_help=True)
    group.callback()(lambda: None)  # so that a group of one command is a group too
    for stage in members:
        add_stage(group, stage)
    app.add_typer(group, name=word, epilog=f"Example: {members[0].example}", rich_help_panel=panel)


def _add_tool(app: typer.Typer, word: str, panel: str) -> None:
    """A tool's module has an `app`, which is a group, or a function `command`, which is one command."""
    module, summary = _TOOLS[word]
    found = import_module(module)
    if hasattr(found, "app"):
        app.add_typer(found.app, name=word, help=summary, rich_help_panel=panel)
    else:
        app.command(word, cls=HelpCommand, help=summary, epilog=found.EXAMPLE, rich_help_panel=panel)(found.command)
