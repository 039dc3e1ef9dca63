"""Autoencoders of body parts in use: loaded from checkpoints, put together into a body, over clips of any length.

A body may be put together from parts of different networks and trainings, on one rig. Where a part and the spine both
hold a connector, the spine's rotation of it is kept (de Clermont Gallerande et al. 2025, 3.3 a), or both are averaged
(3.3 b).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import Artefact, open_artefact
from data_schemas.skeleton_text import skeleton_of_plain
from stages.shared.humanoid.body_parts import SPINE, BodyPart, body_part
from stages.shared.humanoid.clips_on_rig import RigBodyJoints, body_joints_of, is_corresponding
from stages.shared.humanoid.decompositions import DECOMPOSITIONS
from stages.shared.inference.bounded_network import MOST_WINDOW, build_bounded, whole_setting
from stages.shared.inference.models import load_state, overlapping_windows
from stages.shared.networks.body_parts.part_networks import NETWORKS, PartNetwork
from stages.shared.networks.layers.device import choose_device
from stages.shared.weights.shipped import named_source

_MEND = "Give a folder that `pumps train body-parts` wrote."


@dataclass(frozen=True)
class PartModel:
    """The trained network of one part. kind: ae, pae, vae or svae."""

    part: BodyPart
    network: PartNetwork
    kind: str


@dataclass(frozen=True)
class PartBody:
    """Parts of one rig's body. Where two parts hold a joint, the earlier one's rotation of it is kept.

    window: frames of a window at rate_hz. blend: weight of a later part's rotation of its connector; 0 keeps the
    earlier part's alone.
    """

    parts: tuple[PartModel, ...]
    body: RigBodyJoints
    window: int
    rate_hz: float
    inputs: tuple[Artefact, ...]
    device: torch.device
    blend: float = 0.0

    @property
    def widths(self) -> list[int]:
        """The width of each part's latent, in order."""
        return [each.network.width for each in self.parts]

    @property
    def kinds(self) -> str:
        """The networks' kinds, such as "ae" or "ae+vae"."""
        return "+".join(dict.fromkeys(each.kind for each in self.parts))

    @property
    def parameters(self) -> int:
        return sum(value.numel() for each in self.parts for value in each.network.parameters())

    def encode(self, columns: Tensor, generator: torch.Generator | None = None) -> list[Tensor]:
        """The latents (N, D) of each part of windows (N, T, B, 6).

        generator: where given, VAE and S-VAE draw their latents by it; else they give the distributions' means.
        """
        with torch.inference_mode():
            return [
                each.network.encode(columns[:, :, each.part.joints], generator, sampled=generator is not None)[0]
                for each in self.parts
            ]

    def decode(self, latents: Sequence[Tensor]) -> Tensor:
        """Columns (N, T, B, 6) of the parts' latents. Joints of no part are not turned against their parents."""
        with torch.inference_mode():
            return self.joined([m.network.decode(z) for m, z in zip(self.parts, latents, strict=True)])

    def over_clip(self, columns: Tensor, altered: Callable[[list[Tensor]], list[Tensor]] | None = None) -> Tensor:
        """A clip's columns (T, B, 6) encoded and decoded in half-overlapping windows, which are blended.

        altered: changes the latents (N, D) of all windows. Raises: InputError if the clip is shorter than a window.
        """
        frames = len(columns)
        if frames < self.window:
            raise InputError(
                f"The motion has {frames} frames at {self.rate_hz:g} a second, and a window has {self.window}.",
                "Take a longer motion, or parts that were trained on shorter windows.",
            )
        spans = list(overlapping_windows(frames, self.window))
        latents = self.encode(torch.stack([columns[start:stop] for start, stop, _ in spans]).to(self.device))
        made = self.decode(latents if altered is None else altered(latents)).to(columns.device)
        out, total = torch.zeros_like(columns), torch.zeros(frames, 1, 1)
        for (start, stop, fade), window in zip(spans, made, strict=True):
            out[start:stop] += fade.view(-1, 1, 1) * window
            total[start:stop] += fade.view(-1, 1, 1)
        return out / total

    def without_groups(self, columns: Tensor, groups: Sequence[int]) -> Tensor:
        """Windows (N, T, B, 6) whose joints of these groups have the mean pose of the training."""
        out = columns.clone()
        for model in self.parts:
            hidden = np.isin(self.body.groups[model.part.joints], groups)
            joints = model.part.joints[hidden]
            out[:, :, joints] = model.network.mean.cpu()[torch.from_numpy(hidden)]
        return out

    def joined(self, made: Sequence[Tensor]) -> Tensor:
        """The parts' columns (N, T, K, 6) as one body's (N, T, B, 6)."""
        first = made[0]
        out = first.new_zeros(*first.shape[:2], len(self.body.joints), first.shape[-1])
        out[..., 0] = out[..., 4] = 1.0
        for model, columns, fresh in zip(self.parts, made, self.kept, strict=True):
            joints = model.part.joints.tolist()
            out[:, :, [joints[place] for place in fresh]] = columns[:, :, fresh]
            again = sorted(set(range(len(joints))) - set(fresh))
            if self.blend and again:
                there = [joints[place] for place in again]
                out[:, :, there] = torch.lerp(out[:, :, there], columns[:, :, again], self.blend)
        return out

    @property
    def kept(self) -> list[list[int]]:
        """For each part the places of those of its joints that no earlier part holds."""
        held: set[int] = set()
        out = []
        for each in self.parts:
            joints = each.part.joints.tolist()
            out.append([place for place, joint in enumerate(joints) if joint not in held])
            held |= set(joints)
        return out


def load_part_bodies(texts: Sequence[str], device: str = "auto", blend: float = 0.0) -> dict[str, PartBody]:
    """Bodies of one rig, window and rate by name, of `NAME=SOURCE` texts; see `load_part_body`.

    Raises: UsageError for a name twice; InputError for bodies of different rigs, windows or rates.
    """
    named = [named_source(text) for text in texts]
    refuse_repeats([name for name, _ in named], "--weights")
    bodies = {name: load_part_body(source, device, blend) for name, source in named}
    (first, one), *others = bodies.items()
    for name, other in others:
        if (one.window, one.rate_hz) != (other.window, other.rate_hz):
            raise InputError(
                f"{first} and {name} have windows of {one.window} frames at {one.rate_hz:g} Hz and of {other.window} "
                f"at {other.rate_hz:g} Hz.",
                "Measure them one by one.",
            )
        if one.body.skeleton.names != other.body.skeleton.names:
            raise InputError(f"{first} and {name} are of different rigs.", "Measure them one by one.")
    return bodies


def refuse_repeats(names: Sequence[str], flag: str) -> None:
    """Raise UsageError if a name stands twice."""
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"{flag} names {twice[0]!r} twice.", "Give each a name of its own, as NAME=FOLDER.")


def load_part_body(source: str, device: str = "auto", blend: float = 0.0) -> PartBody:
    """A body put together from checkpoints.

    Args:
        source: folders of `pumps train body-parts`, joined by "+": "FOLDER" for all of its parts, "FOLDER:left_arm"
            for one of them. The part with the spine comes first wherever it stands.
        blend: see `PartBody`.
    Raises: InputError for other checkpoints or rigs that do not correspond, UsageError for a part twice or unknown.
    """
    found: list[PartModel] = []
    bodies: list[tuple[RigBodyJoints, int, float]] = []
    inputs: list[Artefact] = []
    chosen = choose_device(device)
    loaded: dict[str, tuple[list[PartModel], RigBodyJoints, int, float, Artefact]] = {}
    for text in source.split("+"):
        folder, _, part = text.partition(":")
        if folder not in loaded:
            loaded[folder] = _loaded(folder, chosen)
        models, body, window, rate, artefact = loaded[folder]
        if part:
            models = [each for each in models if each.part.name == part]
            if not models:
                raise UsageError(f"{folder} has no part {part!r}.", "Name one of the parts that it was trained for.")
        found, bodies, inputs = [*found, *models], [*bodies, (body, window, rate)], [*inputs, artefact]
    body, window, rate = bodies[0]
    for other, frames, hertz in bodies[1:]:
        if (frames, hertz) != (window, rate):
            raise InputError(
                f"The parts of {source} have windows of {window} and {frames} frames at {rate:g} and {hertz:g} Hz.",
                "Put together parts that were trained with the same window and rate.",
            )
        if not is_corresponding(other.skeleton, body.skeleton):
            raise InputError(f"The parts of {source} are of different rigs.", "Train them on motions of one rig.")
    _refuse_doubles(found, source)
    with_spine = [SPINE in body.groups[each.part.own] for each in found]
    order = sorted(range(len(found)), key=lambda index: not with_spine[index])
    return PartBody(tuple(found[index] for index in order), body, window, rate, tuple(inputs), chosen, blend)


def _refuse_doubles(found: Sequence[PartModel], source: str) -> None:
    seen: dict[int, str] = {}
    for each in found:
        for joint in each.part.own.tolist():
            if joint in seen:
                raise UsageError(
                    f"{source} has two models of one joint, in {seen[joint]} and {each.part.name}.",
                    "Name each part once, as FOLDER:PART; `pumps body-parts compose` doubles limbs.",
                )
            seen[joint] = each.part.name


def _loaded(folder: str, device: torch.device) -> tuple[list[PartModel], RigBodyJoints, int, float, Artefact]:
    artefact = open_artefact(folder, "checkpoint")
    kept = read_checkpoint(artefact, optimiser=False)
    config = kept.config
    if config.get("network") != "body-parts" or config.get("kind") not in NETWORKS:
        raise InputError(f"{folder} holds no autoencoders of body parts.", _MEND)
    window = whole_setting(config, "window", MOST_WINDOW, folder)
    latent = whole_setting(config, "latent", MOST_WINDOW, folder)
    blocks = whole_setting(config, "blocks", 1000, folder, least=0)
    rate, stature = (_positive(config, name, folder) for name in ("rate_hz", "stature_m"))
    if config.get("parts") not in DECOMPOSITIONS or not _are_parts(config):
        raise InputError(f"{folder} is damaged: it does not name the parts that it holds.", "Train it again.")
    body = body_joints_of(skeleton_of_plain(config.get("skeleton")), stature)
    models = []
    for name in config["trained"]:
        part = body_part(name, body.parents, body.groups)
        weights = {key.removeprefix(f"{name}."): v for key, v in kept.weights.items() if key.startswith(f"{name}.")}
        share = latent // config["parts"]
        sizes = {"joints": len(part.joints), "window": window, "share": share, "blocks": blocks}
        network = build_bounded(
            lambda part=part, share=share: NETWORKS[config["kind"]](len(part.joints), window, share, blocks, rate),
            sizes, weights, folder,
        )  # fmt: skip
        load_state(network, weights, folder)
        models.append(PartModel(part, network.to(device).eval(), config["kind"]))
    return models, body, window, rate, artefact


def _are_parts(config: Mapping[str, object]) -> bool:
    names = config.get("trained")
    allowed = DECOMPOSITIONS[config["parts"]]  # pyright: ignore[reportArgumentType]
    return isinstance(names, list) and bool(names) and len(set(names)) == len(names) and set(names) <= set(allowed)


def _positive(config: Mapping[str, object], name: str, folder: str) -> float:
    value = config.get(name)
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0 < value < 1e6:
        raise InputError(f"{folder} is damaged: its {name} is {str(value)[:40]}.", "Train it again.")
    return float(value)
