"""The training of weights, continued on one's own motions."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from data_schemas.errors import UsageError
from pumps.files import PathLike, write_clips
from pumps.motion import Motion
from stages.shared.threads import one_thread_if_they_spin


@one_thread_if_they_spin()
def adapt(
    clips: PathLike | Motion | Iterable[PathLike | Motion],
    output: PathLike,
    *,
    weights: PathLike | None = None,
    minutes: float = 10,
    steps: int = 0,
    skeleton: PathLike | None = None,
    licence: str | None = None,
    seed: int = 0,
    device: str = "auto",
    overwrite: bool = False,
) -> dict[str, Any]:
    """Continue the training of weights on your own recordings, as `pumps weights adapt` does; keep the result only if
    it is better on recordings that are held out.

    Args:
        clips: files, folders, patterns, archives or motion artefacts; or motions. One alone needs no list.
        output: the folder to write, for `infill(weights=...)`.
        weights: what to start from, a shipped name or a folder; None for the default.
        minutes: of training. steps: of the optimiser, instead of minutes. seed: of all draws.
        skeleton: the file that holds the skeleton, for formats that keep it apart. device: as of `infill`.
        licence: of recordings that state none, which the adapted weights carry too; None for "the recordings' own".

    Returns: `kept` ("start", "trained", or "mean" of both), `confidence_fitted` (whether the confidence was fitted
        anew; where nothing was better, `kept` is "start" and this is False), `before` and `after` (errors on held-out
        recordings as a share of slerp's, mean over tasks), `steps`, `minutes` and `held_out`.
    Raises:
        UsageError: the folder holds something and `overwrite` is False, or files and motions are mixed.
        InputError: no recording is a humanoid's motion, they are too short, or the weights are not there.
    """
    from stages.shared.settings.layers import Layer, settle
    from stages.shared.weights.shipped import default_weights
    from stages.weights.adapt.config import OWN_LICENCE, Config
    from stages.weights.adapt.run import run

    given = [clips] if isinstance(clips, (str, os.PathLike, Motion)) else list(clips)
    motions = [each for each in given if isinstance(each, Motion)]
    if motions and len(motions) < len(given):
        raise UsageError("clips mixes motions with names of files.", "Give either.")
    settings = {
        "output": Path(output),
        "weights": os.fspath(weights or default_weights()),
        "minutes": minutes,
        "steps": steps,
        "skeleton": None if skeleton is None else os.fspath(skeleton),
        "licence": OWN_LICENCE if licence is None else licence,
        "seed": seed,
        "device": device,
        "overwrite": overwrite,
    }
    with TemporaryDirectory() as folder:
        names = [os.fspath(each) for each in given if not isinstance(each, Motion)]
        if motions:
            names = [str(Path(folder) / "motions")]
            write_clips(motions, names[0])
        config = settle(Config, [Layer("arguments", {**settings, "clips": names})], what="pumps.adapt")
        return run(config).figures
