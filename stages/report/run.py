"""`pumps report`: one HTML page with a 3D player, the tables and the loss curves. Opens offline, loads nothing."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from data_schemas.artefact import open_artefact
from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import UsageError
from data_schemas.manifest import Artefact
from stages.report.animation import animation_svg
from stages.report.config import Config
from stages.report.curves import curves_html
from stages.report.filled_windows import FilledWindows
from stages.report.film_strips import film_strips_html
from stages.report.results import results_html
from stages.report.scenes import scenes_of
from stages.report.several_fills import several_fills, several_fills_html
from stages.report.spectra import spectra_html
from stages.report.strips import farthest, strips_svg
from stages.shared.contract import StageReport
from stages.shared.markup import Markup, filled, joined, markup, own_file, script_data
from stages.shared.outputs import check_file, write_output
from stages.shared.progress import SILENT, Progress

ASSETS = Path(__file__).resolve().parent / "assets"
SUBTITLE = "pumps: motion between keyframes, on its own skeleton"


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write the page.

    Raises:
        UsageError: there is nothing to show, or a motion is not NAME=PATH.
        InputError: an artefact or a motion is missing or bad.
        PumpsError: the page cannot be written.
    """
    if not (config.metrics or config.checkpoints or config.motions or config.fills or config.samples):
        raise UsageError(
            "There is nothing to report.", "Give --metrics, --fills, --checkpoints, --motions or --samples."
        )
    if config.truth and not config.samples:
        raise UsageError("--truth is the true motion of --samples, and there are none.", "Use --motions truth=FILE.")
    check_file(config, (".html", ".htm"))
    if config.picture is not None:
        check_file(config, (".svg",), "picture")
    if config.animation is not None:
        check_file(config, (".svg",), "animation")
    progress.start("Writing the page", 3)
    scenes = scenes_of(config)
    filled_windows = _filled_windows(config) if config.fills else _NONE
    scenes += filled_windows.scenes
    fills = several_fills(config) if config.samples else None
    scenes += [fills.scene(config)] if fills else []
    progress.advance(1, "motions")
    metrics = open_artefact(config.metrics, "metrics") if config.metrics else None
    checkpoints = [open_artefact(path, "checkpoint") for path in config.checkpoints]
    page = filled(
        _asset("page.html"),
        title=config.title,
        subtitle=SUBTITLE,
        css=_asset("page.css"),
        script=joined([_asset("view3d.js"), _asset("player.js")]),
        player=_asset("player.html") if scenes else "",
        scenes=script_data(scenes),
        results=results_html(metrics) if metrics else "",
        figures=joined([several_fills_html(fills) if fills else "", filled_windows.figures]),
        training=joined(_training(checkpoint) for checkpoint in checkpoints),
        origin=_origin(
            [artefact for artefact in (metrics, *filled_windows.artefacts, *checkpoints) if artefact],
            _played(config),
            config.licences,
        ),
    )
    progress.advance(1, "page")
    drawn = _drawn(scenes, config)
    write_output(config.output, page.encode("utf-8"))
    size_kb = len(page.encode()) // 1024
    lines = [f"Report: {config.output} ({size_kb} kB, {len(scenes)} scene{'s' if len(scenes) != 1 else ''})."]
    for what, path, svg in drawn:
        write_output(path, svg.encode("utf-8"))
        lines.append(f"{what}: {path} ({len(svg.encode()) // 1024} kB).")
    return StageReport(
        output=config.output,
        lines=lines,
        figures={"scenes": len(scenes), "bytes": len(page.encode())},
    )


def _drawn(scenes: list[dict], config: Config) -> list[tuple[str, Path, str]]:
    """The picture and the animation, where they are asked for: what each is called, its file and its text."""
    if config.picture is None and config.animation is None:
        return []
    unknown = sorted(set(config.pictured) - {scene["name"] for scene in scenes})
    chosen = [scene for scene in scenes if scene["name"] in config.pictured or not config.pictured]
    if unknown or not chosen:
        raise UsageError(f"No scene is called {unknown[0]!r}." if unknown else "There is no scene to draw.")
    if config.fills and not config.pictured:
        chosen = [farthest(chosen)]
    asked = (("Picture", config.picture, strips_svg), ("Animation", config.animation, animation_svg))
    return [(what, path, draw(chosen)) for what, path, draw in asked if path is not None]


class _FilledWindows(NamedTuple):
    """What the page shows of the windows that evaluations keep."""

    scenes: list[dict]
    figures: Markup | str
    artefacts: list[Artefact]


_NONE = _FilledWindows([], "", [])


def _filled_windows(config: Config) -> _FilledWindows:
    with FilledWindows(config.fills) as fills:
        scenes = fills.scenes(config.max_windows)
        return _FilledWindows(scenes, joined([spectra_html(fills), film_strips_html(scenes)]), fills.artefacts)


def _training(artefact: Artefact) -> Markup:
    log = read_checkpoint(artefact, optimiser=False).log
    steps = max((int(row.get("step", 0)) for row in log), default=0)
    minutes = max((float(row.get("seconds", 0)) for row in log), default=0.0) / 60
    caption = f"{steps:,} steps, {minutes:.1f} minutes. Thin: training; thick: validation."
    return markup(
        "<section><h2>Training: {}</h2><p>{}</p>{}</section>", artefact.path.name, caption, curves_html(log)
    )


def _played(config: Config) -> list[Artefact]:
    """The motion artefacts that are played."""
    paths = [Path(text.partition("=")[2]) for text in config.motions]
    return [open_artefact(path, "motion") for path in paths if path.is_dir()]


def _origin(artefacts: list[Artefact], played: list[Artefact], licences_given: tuple[str, ...]) -> Markup:
    licences = {licence for artefact in (*artefacts, *played) for licence in artefact.manifest.licences}
    rows = [
        markup(
            "<dt>{}</dt><dd>{} artefact <code>{}</code>, written by {} ({})</dd>",
            artefact.path.name,
            artefact.manifest.kind,
            artefact.manifest.digest[:16],
            artefact.manifest.created_by,
            artefact.manifest.stage,
        )
        for artefact in artefacts
    ]
    if played:
        stages = ", ".join(sorted({artefact.manifest.stage for artefact in played}))
        rows.append(markup("<dt>Motions</dt><dd>{} motion artefacts, written by {}</dd>", len(played), stages))
    rows += [
        markup("<dt>Licence of the data</dt><dd>{}</dd>", licence) for licence in sorted(licences | {*licences_given})
    ]
    return markup("<dl>{}</dl>", rows) if rows else markup("<p>Only motions were given.</p>")


def _asset(name: str) -> Markup:
    return own_file(ASSETS / name)
