"""`pumps train body-parts`: motions in, the autoencoders of the parts of a body out."""

from __future__ import annotations

from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from data_schemas.skeleton_text import plain_of_skeleton
from data_schemas.trainings import training_data
from stages.shared.contract import StageReport
from stages.shared.humanoid.clips_on_rig import body_joints_of, clips_on_rig, is_corresponding, rig_of_clips
from stages.shared.networks.layers.device import choose_device
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.training.loop import train
from stages.shared.training.stage import finish
from stages.train.body_parts.config import Config
from stages.train.body_parts.task import PartsTask


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Train the parts. The checkpoint holds the networks, and the rig that its motions are on.

    Raises: InputError for a bad motion artefact, a rig without one of the parts, or clips that are all shorter than a
        window; PumpsError if the loss is not a number.
    """
    check_artefact(config, "checkpoint")
    with MotionReader(config.motion) as reader:
        progress.start("reading clips")
        rows = [row for row in reader.clips if row.split == "train"]
        skeleton, stature = rig_of_clips(reader, rows)
        body = body_joints_of(skeleton, stature)
        like = {
            name: config.retarget or is_corresponding(reader.skeleton(name), skeleton)
            for name in {row.skeleton for row in reader.clips}
        }
        rows = [row for row in rows if like[row.skeleton]]
        clips, notes = clips_on_rig(reader, rows, body, config.rate_hz, config.window)
        held_rows = [row for row in reader.clips if row.split == "val" and like[row.skeleton]]
        try:
            held_back, _ = clips_on_rig(reader, held_rows, body, config.rate_hz, config.window)
        except InputError:  # no clip for validation is of use
            held_back = clips
        task = PartsTask(config, body, clips, held_back, choose_device(config.device))
        trained = train(task, config, progress=progress)
        network = {
            "network": "body-parts",
            "kind": config.network,
            "parts": config.parts,
            "trained": list(config.trained),
            "latent": config.latent,
            "blocks": config.blocks,
            "rate_hz": config.rate_hz,
            "skeleton": plain_of_skeleton(skeleton),
            "stature_m": stature,
        }
        data = training_data([clip.row for clip in clips])
        report = finish(
            config, trained, stage="train-body-parts", network=network, data=data, inputs=[reader.artefact]
        )
    counts = {part.name: _parameters(task, part.name) for part in task.parts}
    told = ", ".join(f"{name} {count:,}" for name, count in counts.items())
    lines = [*report.lines, *notes, f"Parameters: {sum(counts.values()):,} ({told})."]
    return report.model_copy(update={"lines": lines, "figures": {**report.figures, "parameters_of": counts}})


def _parameters(task: PartsTask, name: str) -> int:
    return sum(value.numel() for value in task.networks[name].parameters())
