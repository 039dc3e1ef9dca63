"""`pumps demo`: an embedded clip filled by the default weights, in a page that plays it beside the truth."""

from __future__ import annotations

import webbrowser
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from data_schemas.errors import UsageError
from pumps_cli.completion import among
from pumps_cli.outcome import Manner, errors_reported, show
from pumps_cli.stage_command import AsJson, Debug, Quiet, execute, settle_config
from stages.registry import stage_named

EXAMPLE = "Example: pumps demo"

FILLED, PAGE = "filled.bvh", "demo.html"


def embedded_clips() -> dict[str, Path]:
    """The clips that come with pumps: name -> BVH."""
    folder = Path(str(files("stages.shared.clips")))
    return {path.stem: path for path in sorted(folder.glob("*.bvh"))}


def command(
    clip: Annotated[
        str,
        typer.Argument(
            metavar="CLIP",
            help="An embedded clip, such as walk or jump.",
            autocompletion=among(lambda: [*embedded_clips()]),
        ),
    ] = "dance_b",
    keyframes: Annotated[
        str, typer.Option(metavar="FRAMES", help="Which frames are keyframes, as in `pumps infill`.")
    ] = "every:15",
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write into.")] = Path(
        "pumps-demo"
    ),
    unopened: Annotated[bool, typer.Option("--no-open", help="Write the page without opening it.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files of an earlier call.")] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Fill an embedded clip with the default weights, and open a page: truth, filled, plain interpolation.

    Nothing is trained. The folder holds the filled BVH and the page, which opens offline.
    """
    manner = Manner(quiet=quiet, json=as_json, debug=debug)
    with errors_reported(manner, "pumps demo"):
        clips = embedded_clips()
        if clip not in clips:
            raise UsageError(f"There is no embedded clip {clip!r}.", f"Clips are {', '.join(clips)}.")
        filled, page = output / FILLED, output / PAGE
        silent = replace(manner, quiet=True, json=False)
        for stage, values in (
            ("infill", {"input": clips[clip], "keyframes": keyframes, "output": filled}),
            ("report", {"motions": (f"truth={clips[clip]}", f"filled={filled}"), "keyframes": keyframes,
                        "title": f"{clip}, filled between keyframes", "output": page}),
        ):  # fmt: skip
            named = stage_named(stage)
            execute(named, settle_config(named, [], [], {**values, "overwrite": overwrite}), silent)
        lines = [
            f"Filled: {filled}, from the keys of {clip} ({keyframes}). The frames between were not read.",
            f"Page: {page.resolve()}",
            f"On your own file: pumps infill FILE.bvh --keyframes {keyframes} -o filled.bvh",
        ]
        show(manner, lambda: lines, lambda: {"output": str(page), "filled": str(filled), "lines": lines})
        if not unopened:
            webbrowser.open(page.resolve().as_uri())
