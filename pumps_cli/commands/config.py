"""`pumps config`: presets, and the settings files of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pumps_cli.outcome import Manner, show, told
from pumps_cli.stage_command import AsJson, Debug, Quiet
from stages.registry import OLD_NAMES, PIPELINE
from stages.shared.settings.layers import settle_file_part
from stages.shared.settings.presets import preset_layers, preset_names, preset_path
from stages.shared.settings.run_folder import write_run_config
from stages.shared.toml import toml_text

app = typer.Typer(no_args_is_help=True, epilog="Example: pumps config show --preset tiny")

_Presets = Annotated[list[str], typer.Option("--preset", metavar="NAME", help="A preset; a later one wins.")]


@app.command("list", epilog="Example: pumps config list")
def list_presets(quiet: Quiet = False, as_json: AsJson = False) -> None:
    """List the presets."""
    show(Manner(quiet=quiet, json=as_json), lambda: [_headline(name) for name in preset_names()], preset_names)


@app.command("show", epilog="Example: pumps config show --preset tiny --stage train-ae")
def show_preset(
    preset: _Presets,
    stage: Annotated[str | None, typer.Option(metavar="STAGE", help="Only this stage's settings.")] = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Print every setting that a preset leads to, defaults included."""
    manner = Manner(quiet=quiet, json=as_json, debug=debug)
    with told(manner, "pumps config show"):
        tables = {
            each.name: settle_file_part(
                each.config_type(),
                [layer for name in preset for layer in preset_layers(name, each.name)],
                what=f"pumps {' '.join(each.command)}",
            )
            for each in PIPELINE
            if stage is None or OLD_NAMES.get(stage, stage) == each.name
        }
        show(manner, lambda: [toml_text(tables).strip()], lambda: tables)


@app.command("write", epilog="Example: pumps config write --preset tiny --run runs/mine --set train-ae.steps=100")
def write(
    preset: _Presets,
    run: Annotated[Path, typer.Option(metavar="FOLDER", help="The run's folder.")],
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="STAGE.FIELD=VALUE", help="A setting that wins over presets.")
    ] = None,
    source: Annotated[
        list[str] | None, typer.Option(metavar="PATH", help="What the run ingests: files, folders, globs, archives.")
    ] = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Write RUN/config/STAGE.toml for every stage, touching only files whose content changes."""
    manner = Manner(quiet=quiet, json=as_json, debug=debug)
    with told(manner, "pumps config write"):
        changed = write_run_config(run, preset, settings or [], source or [])
        show(manner, lambda: [f"wrote {path}" for path in changed], lambda: [str(path) for path in changed])


def _headline(name: str) -> str:
    """A preset's name and the first line of its head comment."""
    first = preset_path(name).read_text(encoding="utf-8").splitlines()[0]
    return f"{name:8}{first.lstrip('# ')}"
