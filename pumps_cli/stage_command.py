"""A stage as a command: flags from its Config, settings from presets and files, the stage run, its report printed."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any

import typer

from pumps_cli.completion import among, preset_values
from pumps_cli.flags import listed_on_standard_input, parameters_of, shown_as, values_given
from pumps_cli.help_page import EVERY_COMMAND, HelpCommand, print_everything
from pumps_cli.outcome import Manner, errors_reported, show_report
from pumps_cli.progress import TerminalProgress
from stages.registry import Stage
from stages.shared.contract import StageConfig
from stages.shared.settings.layers import COMMAND_LINE, Layer, settle
from stages.shared.settings.presets import file_layer, is_in_presets, preset_layers

_PANEL = EVERY_COMMAND

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.", rich_help_panel=_PANEL)]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object, not text.", rich_help_panel=_PANEL)]
Debug = Annotated[bool, typer.Option("--debug", help="Show tracebacks and warnings.", rich_help_panel=_PANEL)]
_Presets = Annotated[
    list[str] | None,
    typer.Option(
        "--preset",
        metavar="NAME",
        autocompletion=among(preset_values),
        rich_help_panel=_PANEL,
        help="Take settings from a preset (`pumps config list`); of several, the later ones win.",
    ),
]
_Files = Annotated[
    list[str] | None,
    typer.Option(
        "--config", metavar="FILE.toml", rich_help_panel=_PANEL,
        help="Take settings from a file; options on the command line win.",
    ),
]  # fmt: skip
_HelpAll = Annotated[
    bool,
    typer.Option(
        "--help-all", is_eager=True, callback=print_everything, rich_help_panel=_PANEL,
        help="Show the options that are rarely changed, too.",
    ),
]  # fmt: skip


def add_stage(app: typer.Typer, stage: Stage, panel: str | None = None) -> None:
    """Add the stage's command to an app, in the panel of help named. Its flags come from its Config."""
    shown = type("StageCommand", (HelpCommand,), {"shown_as": shown_as(stage.config_type())})
    app.command(
        stage.command[-1], cls=shown, help=stage.summary, epilog=f"Example: {stage.example}", rich_help_panel=panel
    )(_callback(stage))


def settle_config(stage: Stage, presets: list[str], files: list[str], values: dict[str, Any]) -> StageConfig:
    """Defaults, then presets, then files, then flags, the later winning. Raises UsageError, InputError."""
    table = stage.form_of or stage.name
    layers = [layer for name in presets for layer in preset_layers(name, table)]
    layers += [file_layer(Path(name), table) for name in files]
    layers.append(Layer(COMMAND_LINE, {**values, **dict(stage.fixed)}))
    return settle(stage.config_type(), layers, what=command_words(stage), arguments=stage.arguments)


def command_words(stage: Stage) -> str:
    """ "pumps train ae"."""
    return " ".join(("pumps", *stage.command))


def execute(stage: Stage, config: StageConfig, manner: Manner) -> None:
    """Run the stage and print its report. If a launcher started several processes, only the first one prints."""
    if int(os.environ.get("RANK", "0")) > 0:
        manner = replace(manner, quiet=True, json=False)
    run = stage.runner()
    with TerminalProgress(quiet=manner.quiet or manner.json) as progress:
        report = run(config, progress=progress)
    show_report(manner, report)


def _callback(stage: Stage) -> Callable[..., None]:
    def command(**given: Any) -> None:
        presets, files = given.pop("preset_names", None) or [], given.pop("config_files", None) or []
        given.pop("help_all", None)
        manner = Manner(quiet=given.pop("quiet"), json=given.pop("as_json"), debug=given.pop("debug"))
        with errors_reported(manner, command_words(stage)):
            values = listed_on_standard_input(values_given(given), stage.arguments)
            execute(stage, settle_config(stage, list(presets), list(files), values), manner)

    config_type = stage.config_type()
    parameters = parameters_of(config_type, stage.arguments, (*dict(stage.fixed), *stage.without))
    if is_in_presets(stage.form_of or stage.name):
        parameters.append(Parameter("preset_names", Parameter.KEYWORD_ONLY, default=None, annotation=_Presets))
    if config_type.model_fields:
        parameters.append(Parameter("config_files", Parameter.KEYWORD_ONLY, default=None, annotation=_Files))
    parameters += [
        Parameter("quiet", Parameter.KEYWORD_ONLY, default=False, annotation=Quiet),
        Parameter("as_json", Parameter.KEYWORD_ONLY, default=False, annotation=AsJson),
        Parameter("debug", Parameter.KEYWORD_ONLY, default=False, annotation=Debug),
    ]
    if shown_as(config_type).rare:
        parameters.append(Parameter("help_all", Parameter.KEYWORD_ONLY, default=False, annotation=_HelpAll))
    command.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in parameters}
    return command
