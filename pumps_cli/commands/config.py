"""`pumps config`: presets, and the settings files of a run."""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path
from typing import Annotated

import typer

from pumps_cli.help_page import HelpCommand, HelpGroup
from pumps_cli.outcome import Manner, errors_reported, show
from pumps_cli.stage_command import AsJson, Debug, Quiet
from stages.registry import OLD_NAMES, PIPELINE
from stages.shared.settings.layers import settle_file_part
from stages.shared.settings.presets import preset_layers, preset_names, preset_path
from stages.shared.settings.recipes import recipe_names, recipe_path
from stages.shared.settings.run_folder import RunRequest, write_run
from stages.shared.toml import toml_text

app = typer.Typer(cls=HelpGroup, no_args_is_help=True, epilog="Example: pumps config show --preset tiny")

_Presets = Annotated[list[str], typer.Option("--preset", metavar="NAME", help="A preset; a later one wins.")]

# The options of a run, which `pumps run` has too.
RunPresets = Annotated[
    list[str] | None,
    typer.Option("--preset", metavar="NAME", help="A preset; a later one wins. By default the recipe's."),
]
RunSettings = Annotated[
    list[str] | None, typer.Option("--set", metavar="STAGE.FIELD=VALUE", help="A setting that wins over presets.")
]
RunSources = Annotated[
    list[str] | None,
    typer.Option("--source", metavar="PATH", help="What the run ingests: files, folders, globs, archives."),
]
RunParameters = Annotated[
    list[str] | None, typer.Option("--with", metavar="NAME=WORDS", help="A parameter of the recipe.")
]
RunData = Annotated[Path, typer.Option("--data", metavar="FOLDER", help="Where the recipe's archives lie.")]


@app.command("list", cls=HelpCommand, epilog="Example: pumps config list")
def list_presets(quiet: Quiet = False, as_json: AsJson = False) -> None:
    """List the presets."""
    manner = Manner(quiet=quiet, json=as_json)
    with errors_reported(manner, "pumps config list"):
        show(manner, lambda: [_headline(name, preset_path(name)) for name in preset_names()], preset_names)


@app.command("show", cls=HelpCommand, epilog="Example: pumps config show --preset tiny --stage train-ae")
def show_preset(
    preset: _Presets,
    stage: Annotated[str | None, typer.Option(metavar="STAGE", help="Only this stage's settings.")] = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Print every setting that a preset leads to, defaults included."""
    manner = Manner(quiet=quiet, json=as_json, debug=debug)
    with errors_reported(manner, "pumps config show"):
        tables = {
            each.name: settle_file_part(
                each.config_type(),
                [layer for name in preset for layer in preset_layers(name, each.name)],
                what=f"pumps {' '.join(each.command)}",
            )
            for each in PIPELINE
            if stage is None or OLD_NAMES.get(stage, stage) == each.name
        }
        show(manner, toml_text(tables).strip().splitlines, lambda: tables)


@app.command("recipes", cls=HelpCommand, epilog="Example: pumps config recipes")
def list_recipes(quiet: Quiet = False, as_json: AsJson = False) -> None:
    """List the recipes of tables and of pretraining."""
    manner = Manner(quiet=quiet, json=as_json)
    with errors_reported(manner, "pumps config recipes"):
        show(manner, lambda: [_headline(name, recipe_path(name)) for name in recipe_names()], recipe_names)


@app.command(
    "write",
    cls=HelpCommand,
    epilog="Example: pumps config write --preset tiny --run runs/mine --set train-ae.steps=100",
)
def write(
    run: Annotated[Path, typer.Option(metavar="FOLDER", help="The run's folder.")],
    preset: RunPresets = None,
    settings: RunSettings = None,
    source: RunSources = None,
    recipe: Annotated[
        str,
        typer.Option(metavar="NAME", help="A recipe of `pumps config recipes`, or a TOML file of one."),
    ] = "",
    parameters: RunParameters = None,
    data: RunData = Path("."),
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Write RUN/config, the settings of every stage, and RUN/run.mk, the makefile that runs them.

    Files whose content does not change are not touched.
    """
    manner = Manner(quiet=quiet, json=as_json, debug=debug)
    with errors_reported(manner, "pumps config write"):
        request = RunRequest(run, preset or (), settings or (), source or (), recipe, parameters or (), data)
        changed = write_run(request)
        show(manner, lambda: [f"wrote {path}" for path in changed], lambda: [str(path) for path in changed])


def _headline(name: str, path: Path) -> str:
    """Name and first sentence of the head comment of a preset or recipe."""
    head = takewhile(lambda line: line.lstrip("#").strip(), path.read_text(encoding="utf-8").splitlines())
    return f"{name:13}{' '.join(line.lstrip('# ') for line in head)}"
