"""A stage as a command: flags from its Config, settings from presets and files, the stage run, its report printed."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any

import typer

from pumps_cli.flags import listed_on_standard_input, parameters_of, values_given
from pumps_cli.outcome import Manner, show_report, told
from pumps_cli.progress import TerminalProgress
from stages.registry import Stage
from stages.shared.contract import StageConfig
from stages.shared.settings.layers import COMMAND_LINE, Layer, settle
from stages.shared.settings.presets import file_layer, preset_layers

_PANEL = "Every command"

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.", rich_help_panel=_PANEL)]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object, not text.", rich_help_panel=_PANEL)]
Debug = Annotated[bool, typer.Option("--debug", help="Show tracebacks and warnings.", rich_help_panel=_PANEL)]
_Presets = Annotated[
    list[str] | None,
    typer.Option("--preset", metavar="NAME", help="Settings by name (`pumps config list`).", rich_help_panel=_PANEL),
]
_Files = Annotated[
    list[str] | None,
    typer.Option("--config", metavar="FILE.toml", help="Settings from a file; flags win.", rich_help_panel=_PANEL),
]


def add_stage(app: typer.Typer, stage: Stage) -> None:
    """Add the stage's command to an app. Its flags come from its Config."""
    app.command(stage.command[-1], help=stage.summary, epilog=f"Example: {stage.example}")(_callback(stage))


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
    """Run the stage and print its report. Of several processes that a launcher started the first alone tells."""
    if int(os.environ.get("RANK", "0")) > 0:
        manner = replace(manner, quiet=True, json=False)
    run = stage.runner()
    with TerminalProgress(quiet=manner.quiet or manner.json) as progress:
        report = run(config, progress=progress)
    show_report(manner, report)


def _callback(stage: Stage) -> Callable[..., None]:
    def command(**given: Any) -> None:
        presets, files = given.pop("preset_names") or [], given.pop("config_files") or []
        manner = Manner(quiet=given.pop("quiet"), json=given.pop("as_json"), debug=given.pop("debug"))
        with told(manner, command_words(stage)):
            values = listed_on_standard_input(values_given(given), stage.arguments)
            execute(stage, settle_config(stage, list(presets), list(files), values), manner)

    parameters = [
        *parameters_of(stage.config_type(), stage.arguments, (*dict(stage.fixed), *stage.without)),
        Parameter("preset_names", Parameter.KEYWORD_ONLY, default=None, annotation=_Presets),
        Parameter("config_files", Parameter.KEYWORD_ONLY, default=None, annotation=_Files),
        Parameter("quiet", Parameter.KEYWORD_ONLY, default=False, annotation=Quiet),
        Parameter("as_json", Parameter.KEYWORD_ONLY, default=False, annotation=AsJson),
        Parameter("debug", Parameter.KEYWORD_ONLY, default=False, annotation=Debug),
    ]
    command.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in parameters}
    return command
