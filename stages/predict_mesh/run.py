"""`pumps predict-mesh`: mesh sequences in, the same with the frames that follow out."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import chain

from data_schemas.errors import InputError
from stages.predict_mesh.config import Config
from stages.shared.contract import StageReport
from stages.shared.inference.rewritten_meshes import rewritten_meshes
from stages.shared.inference.spectral import load_spectral, vertices_in_parts
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write the mesh artefact `config.output`.

    A clip with fewer known frames than the weights need is reported and left out.
    Raises: InputError for weights of another task or connectivity, or if no clip is long enough.
    """
    check_artefact(config, "mesh")
    weights = load_spectral(config.weights, config.device, last=config.kept == "last")
    weights.check_task("predict")
    lines: list[str] = []
    clips, seconds, played = 0, 0.0, 0.0
    opened = (config.mesh, config.output, weights, str(config.weights), config.where, "predict-mesh", config)
    with rewritten_meshes(*opened) as meshes:
        reader = meshes.reader
        progress.start("Predicting meshes", total=len(meshes.rows))
        for row in meshes.rows:
            progress.advance(1, row.clip)
            stop = min(row.frames, config.until or row.frames)
            if stop < weights.known:
                lines.append(f"left out: {row.clip} has {stop} known frames, and {weights.known} are needed.")
                continue
            if row.fps not in weights.fps:
                lines.append(f"Note: {row.clip} has {row.fps:g} frames a second; the weights know {weights.fps}.")
            start = stop - weights.known
            began = time.perf_counter()
            coefficients = meshes.view.window(row.clip, start, stop)
            made = weights.predict(coefficients[None], config.frames)[0]
            seconds += time.perf_counter() - began
            frames = weights.known + config.frames
            known = reader.vertices(row.clip, start, stop)
            meshes.writer.add_dense(
                replace(row, frames=frames, seconds=frames / row.fps),
                chain([known], vertices_in_parts(weights.basis, made)),
            )
            clips += 1
            played += config.frames / row.fps
        if not clips:
            raise InputError(f"No clip of {config.mesh} has the {weights.known} known frames that are needed.")
        meshes.draft.summary |= {"clips": clips, "known": weights.known, "predicted": config.frames}
    times = played / max(seconds, 1e-9)
    said = f"{clips} clips, {config.frames} frames predicted after {weights.known} known ones, at {times:.1f} times "
    figures = {"clips": clips, "predicted": config.frames, "seconds": seconds, "times_real_time": times}
    return StageReport(output=config.output, lines=[f"{said}real time.", *lines], figures=figures)
