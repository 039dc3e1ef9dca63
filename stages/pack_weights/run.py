"""`pumps pack-weights`: the two checkpoints of a run in, weights to hand on out."""

from __future__ import annotations

import numpy as np

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact
from data_schemas.whole_file import write_whole
from stages.config import StageReport
from stages.pack_weights.config import Config
from stages.progress import SILENT, Progress

_LOGGED = ("step", "split", "loss", "score", "rec_mm", "moving_mm")


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Copy both networks without the optimiser's state, in half precision, and write one card for them.

    The synthesiser's record of its encoder is renewed, since the packed encoder is another artefact.

    Raises: InputError where the run has no finished networks, or they do not belong together.
    """
    progress.start("packing", 2)
    ae, lms = (open_artefact(config.run / name, "checkpoint") for name in ("train-ae", "train-lms"))
    autoencoder, synthesiser = read_checkpoint(ae, optimiser=False), read_checkpoint(lms, optimiser=False)
    if synthesiser.config.get("encoder_digest") != ae.manifest.digest:
        raise InputError(
            f"The synthesiser in {config.run} was trained on another autoencoder than the one beside it.",
            "Train it again with `pumps train lms`.",
        )
    packed = _pack(config, "ae", autoencoder, ae)
    progress.advance()
    synthesiser.config["encoder_digest"] = packed.manifest.digest
    _pack(config, "lms", synthesiser, lms)
    progress.advance()
    name = config.name or config.output.name
    card = _card(name, autoencoder, synthesiser, sorted({*ae.manifest.licences, *lms.manifest.licences}))
    write_whole(config.output / "MODEL_CARD.md", card.encode("utf-8"))
    size = sum(path.stat().st_size for path in config.output.rglob("*") if path.is_file())
    return StageReport(
        output=config.output,
        lines=[f"Packed {name}: {size / 1e6:.1f} MB in {config.output}."],
        figures={"bytes": size},
    )


def _pack(config: Config, part: str, kept: Checkpoint, source: Artefact) -> Artefact:
    width = np.float16 if config.half else np.float32
    path = config.output / part
    settings = {"half": config.half, "trained": source.manifest.config, "digest": source.manifest.digest}
    with write_artefact(
        path, "checkpoint", stage="pack-weights", config=settings, licences=source.manifest.licences
    ) as draft:
        write_checkpoint(
            draft.folder,
            weights={name: value.astype(width) for name, value in kept.weights.items()},
            config=kept.config,
            optimiser=None,
            log=[{name: row[name] for name in _LOGGED if name in row} for row in kept.log],
            card=kept.card,
        )
    return open_artefact(path, "checkpoint")


def _card(name: str, autoencoder: Checkpoint, synthesiser: Checkpoint, licences: list[str]) -> str:
    return "\n".join(
        [
            f"# The weights `{name}`",
            "",
            "An autoencoder of temporal point clouds and a latent motion synthesiser, for `pumps infill`.",
            "",
            "The weights carry the licences of the data they were trained on, apart from the code's Apache-2.0:",
            "",
            *[f"- {licence}" for licence in licences or ["none stated"]],
            "",
            "What they measure to stands in docs/results.md of the project. Gaps longer than those trained on get",
            "a warning; fingers, faces and props are not theirs: those joints are interpolated plainly.",
            "",
            autoencoder.card.replace("# ", "## ", 1),
            synthesiser.card.replace("# ", "## ", 1),
        ]
    )
