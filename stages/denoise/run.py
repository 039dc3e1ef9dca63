"""`pumps denoise`: a noisy motion in, the same motion cleaned out, and what changed."""

from __future__ import annotations

import time
from collections.abc import Callable

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.denoise.config import Config
from stages.denoise.motion_files import MotionFile, motion_file
from stages.denoise.selection import check_something_there, chosen_frames, chosen_joints, masked
from stages.denoise.summary import figures_of, lines_of
from stages.shared.contract import StageReport
from stages.shared.formats.writers import SUFFIXES
from stages.shared.inference.denoising import MENDING, Denoised, DenoiseOptions, denoise_motion
from stages.shared.inference.kept_models import kept_denoiser, kept_models
from stages.shared.inference.latent_denoising import LatentOptions, denoised_by_latents
from stages.shared.inference.pose_denoising import check_rig, refined
from stages.shared.inference.pose_model import load_pose_model
from stages.shared.many_files.file_runs import over_files
from stages.shared.outputs import check_file, write_output
from stages.shared.progress import SILENT, Progress

NO_WEIGHTS, LATENT = "none", "latent"


@over_files
def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Clean a motion.

    Raises: UsageError for options that contradict each other; InputError for a file, mask, joints or weights that are
        bad.
    """
    started = time.perf_counter()
    check_file(config, SUFFIXES.values())
    if config.weights is not None and config.method not in MENDING:
        raise UsageError("--weights is for the methods mend and latent.", "Leave out --method, or --weights.")
    if config.method == LATENT and (config.weights is None or config.fill == NO_WEIGHTS):
        raise UsageError(
            "--method latent needs a denoiser and the weights whose autoencoder it was trained with.",
            "Train one with `pumps train denoiser` and give its folder as --weights; leave --fill out.",
        )
    if config.method in MENDING and config.width != 1.0:
        raise UsageError("--width is for the plain filters.", "Name one with --method, such as savgol.")
    progress.start("cleaning", 3)
    file = motion_file(config)
    progress.advance(note="read")
    found = clean_file(file, config)
    progress.advance(note="cleaned")
    data, losses = file.written(config.output, found.motion, found.changed, found.moved)
    write_output(config.output, data)
    progress.advance(note="written")
    notes, figures = [*file.notes, *losses], figures_of(file.skeleton, found)
    seconds = time.perf_counter() - started
    noted, lines = [f"Note: {note}" for note in notes], lines_of(figures, found, seconds)
    return StageReport(
        output=config.output,
        lines=[*noted, *lines],
        gist=[*noted, lines[0]],
        figures={**figures, "method": config.method, "seconds": seconds, "notes": notes},
    )


def clean_file(file: MotionFile, config: Config) -> Denoised:
    """The cleaned motion of a file, within what the config chooses."""
    skeleton, motion = file.skeleton, file.motion
    missing = masked(config.mask, motion.frames, skeleton.names) | file.empty[:, None]
    check_something_there(missing, file.name)
    joints, positions = chosen_joints(config.joints, skeleton)
    frames = chosen_frames(config.frames, motion.frames)
    refine = _refining(config, skeleton)
    options = DenoiseOptions(config.method, config.width, config.strength, config.seed)
    return denoise_motion(
        skeleton,
        motion,
        missing,
        options=options,
        # Called only for a long gap, since loading weights takes longer than cleaning a short clip.
        models=None if config.fill == NO_WEIGHTS else lambda: kept_models(config.fill, config.device),
        refine=refine,
        frames=frames,
        joints=joints,
        positions=positions,
    )


def _refining(config: Config, skeleton: Skeleton) -> Callable[[Motion, Motion], Motion] | None:
    """What a network makes of the noisy and the mended motion; None without a network."""
    if config.weights is None:
        return None
    if config.method == LATENT:
        denoiser = kept_denoiser(config.weights, config.fill, config.device)
        options = LatentOptions(seed=config.seed)
        return lambda noisy, mended: denoised_by_latents(denoiser, skeleton, noisy, mended, options)
    model = load_pose_model(config.weights, ("repair", "denoise"), config.device)
    check_rig(model, skeleton)
    return lambda noisy, mended: refined(model, skeleton, noisy, mended)
