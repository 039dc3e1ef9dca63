"""`pumps body-parts compose`: a motion of a body with further limbs, from trained parts and motions."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.body_parts.compose.config import Config
from stages.body_parts.compose.limbs import AddedLimb, body_with_limbs
from stages.body_parts.compose.picture import body_picture
from stages.body_parts.compose.recipe import Limb, Recipe, read_body_recipe
from stages.shared.contract import StageReport
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import source_named
from stages.shared.formats.writers import SUFFIXES, bytes_of_motion, written_format
from stages.shared.humanoid.clips_on_rig import is_corresponding, motion_on_rig
from stages.shared.inference.part_models import PartBody, load_part_body
from stages.shared.kinematics.matrix_poses import columns_of, rotations_of_columns
from stages.shared.outputs import check_file, write_output
from stages.shared.progress import SILENT, Progress


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Reconstruct the body's motion by its parts and add the limbs; write the result.

    The body's rig is that of its weights. All motions last as long as the shortest.
    Raises: InputError for a bad recipe, a motion shorter than a window or of no humanoid, or parts of different rigs.
    """
    check_file(config, SUFFIXES.values())
    if config.picture is not None:
        check_file(config, (".svg",), "picture")
    chosen = written_format(config.output)
    recipe = read_body_recipe(config.recipe)
    progress.start("composing", 2 + len(recipe.limbs))
    body = load_part_body(recipe.weights, config.device)
    local, pelvis = _on_rig(recipe.motion, body)
    models = [load_part_body(f"{each.weights}:{each.part}", config.device) for each in recipe.limbs]
    limbs = [_limb(each, model, recipe, body, config) for each, model in zip(recipe.limbs, models, strict=True)]
    frames = min([len(local), *(len(each.local) for each in limbs)])
    limbs = [AddedLimb(each.part, each.name, each.offset_m, each.local[:frames]) for each in limbs]
    progress.advance(1 + len(limbs))
    made = _over_clip(body, local[:frames])
    skeleton, motion = body_with_limbs(body.body, made, pelvis[:frames], limbs, body.rate_hz)
    inputs = [each for one in (body, *models) for each in one.inputs]
    licences = sorted({licence for each in inputs for licence in each.manifest.licences})
    data, notes = bytes_of_motion(chosen, skeleton, motion, config.output.stem, licence=", ".join(licences))
    write_output(config.output, data)
    if config.picture is not None:
        added = frozenset(name for name in skeleton.names if name not in body.body.skeleton.names)
        write_output(config.picture, body_picture(skeleton, motion, added).encode())
    progress.advance()
    line = f"{config.output}: {frames} frames at {body.rate_hz:g} a second, {skeleton.joints} joints"
    names = [f"{each.part.name} {each.name}" for each in limbs]
    return StageReport(
        output=config.output,
        lines=[f"{line}, with {', '.join(names)}." if names else f"{line}.", *notes],
        figures={"frames": frames, "joints": skeleton.joints, "limbs": names},
    )


def _limb(limb: Limb, model: PartBody, recipe: Recipe, body: PartBody, config: Config) -> AddedLimb:
    if not is_corresponding(model.body.skeleton, body.body.skeleton):
        raise InputError(
            f"{limb.weights} is of another rig than {recipe.weights}.", "Train both on one rig's motions."
        )
    if (model.window, model.rate_hz) != (body.window, body.rate_hz):
        raise UsageError(
            f"{limb.weights} has windows of {model.window} frames at {model.rate_hz:g} Hz, and {recipe.weights} of "
            f"{body.window} at {body.rate_hz:g} Hz.",
            "Train both with the same window and rate.",
        )
    local, _ = _on_rig(limb.motion or recipe.motion, model)
    words = (config.seed, zlib.crc32(f"{limb.part} {limb.name}".encode()))
    seed = int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0] >> 1)

    def moved(latents: list[Tensor]) -> list[Tensor]:
        """One draw for all windows, so that the limb's motion stays smooth."""
        generator = torch.Generator().manual_seed(seed)
        draws = [torch.randn(each.shape[1], generator=generator).to(each.device) for each in latents]
        return [z + limb.noise * z.std(dim=0, correction=0) * d for z, d in zip(latents, draws, strict=True)]

    made = _over_clip(model, local, moved if limb.noise else None)
    part = model.parts[0].part
    return AddedLimb(part, limb.name, limb.offset_m, made[:, part.joints])


def _on_rig(name: str, body: PartBody) -> tuple[np.ndarray, np.ndarray]:
    source, motion = _read(name)
    made = motion_on_rig(source, motion, body.body, body.rate_hz)
    if made is None:
        raise InputError(f"{name} cannot be put on the rig of the parts.", "Take a motion of a like rig.")
    return made


def _read(name: str) -> tuple[Skeleton, Motion]:
    source = source_named(name)
    found = recordings_in(source, Asked())
    if len(found) != 1:
        raise InputError(f"{source.name} holds {len(found)} clips, and one is needed.", "`pumps export` one.")
    return found[0].skeleton, found[0].motion


def _over_clip(
    body: PartBody, local: np.ndarray, altered: Callable[[list[Tensor]], list[Tensor]] | None = None
) -> np.ndarray:
    """A clip's rotations (T, B, 4) as its parts reconstruct them."""
    return rotations_of_columns(body.over_clip(columns_of(torch.from_numpy(local)), altered)).numpy()
