"""Trained networks in use: finding weights, loading them, and running them on clips of any length and on any
device."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from data_schemas.checkpoint import Checkpoint, read_checkpoint
from data_schemas.errors import InputError
from data_schemas.manifest import Artefact, open_artefact
from data_schemas.trainings import last_sentence
from stages.shared.inference.bounded_network import MOST_POINTS, MOST_WINDOW, build_bounded, whole_setting
from stages.shared.inference.confidence import Confidence, read_confidence
from stages.shared.kinematics.plain_interpolation import Glide
from stages.shared.kinematics.runs import widened_to_keys
from stages.shared.networks.layers.device import choose_device
from stages.shared.networks.layers.sizes import DecoderSizes, EncoderSizes, SynthesiserSizes
from stages.shared.networks.pumps.cloud_decoder import CloudDecoder, grid_cells
from stages.shared.networks.pumps.frame_encoder import FrameEncoder
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser
from stages.shared.weights.shipped import parts_of, weights_folder

_WINDOW_FRAMES_AT_ONCE = 2048  # of windows that are decoded or filled in one call
_FRAMES_AT_ONCE = 512  # clouds encoded in one call: enough to be fast, few enough to stay in memory


@dataclass(frozen=True)
class Autoencoder:
    """An encoder and decoder in use, with a record of their training data."""

    encoder: FrameEncoder
    decoder: CloudDecoder
    window: int
    points: int
    licences: tuple[str, ...]
    digest: str
    device: torch.device

    def encode(self, points: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """Encode every frame of a clip.

        Args:
            points: (T, P, 3) metres. groups: (P,) body groups.

        Returns: latents (T, D), centroids (T, 3), on the device; each frame is encoded independently.
        """
        groups = groups.to(self.device)
        parts = []
        with torch.inference_mode():
            for chunk in points.split(_FRAMES_AT_ONCE):
                chunk = chunk.to(self.device, torch.float32)
                parts.append(self.encoder(chunk, groups.expand(len(chunk), -1)))
        return torch.cat([part[0] for part in parts]), torch.cat([part[1] for part in parts])

    def spans(self, frames: int) -> list[Span]:
        """The windows in which a clip of this many frames is decoded, in order."""
        return whole_windows(frames, self.window)

    def decode(
        self,
        latents: Tensor,
        centroids: Tensor,
        times: Tensor,
        groups: Tensor,
        noise: Tensor,
        spans: Sequence[Span] | None = None,
    ) -> Tensor:
        """Decode a clip of any length, by overlapping windows that are blended.

        Args:
            latents: (T, D). centroids: (T, 3) metres. times: (T,) model frames, rising, real-valued.
            groups: (P,) body groups of the decoded points. noise: (P, Z) their identities.
            spans: windows in these T frames, such as some of a longer clip's; None for all of a clip of T frames.

        Returns: (T, P, 3) metres; zeros in frames without a window.
        """
        out = torch.zeros(len(times), len(groups), 3, device=self.device)
        weights = torch.zeros(len(times), 1, 1, device=self.device)
        groups, noise = groups.to(self.device), noise.to(self.device)
        latents, centroids, times = (part.to(self.device) for part in (latents, centroids, times))
        with torch.inference_mode():
            for some in batches_of(self.spans(len(times)) if spans is None else spans):
                made = self.decoder(
                    *(rows_of(part, some) for part in (latents, centroids, times.float())),
                    groups.unsqueeze(0),
                    noise.unsqueeze(0),
                )
                for span, points in zip(some, made, strict=True):
                    fade = span.fade.to(self.device)[:, None, None]
                    out[span.start : span.stop] += fade * points
                    weights[span.start : span.stop] += fade
        return out / torch.where(weights > 0, weights, 1)

    def draw_noise(self, points: int, seed: int) -> Tensor:
        """Identities (points, Z), the same for the same seed on every device."""
        if self.decoder.sizes.identities == "grid":
            return grid_cells(points)
        return torch.randn(points, self.decoder.sizes.noise, generator=torch.Generator().manual_seed(seed))


@dataclass(frozen=True)
class Models:
    """An autoencoder, a synthesiser and their confidence, as filling needs them."""

    autoencoder: Autoencoder
    synthesiser: LatentSynthesiser
    window: int
    longest_gap: int
    licences: tuple[str, ...]
    trained_on: str
    name: str
    confidence: Confidence | None = None

    @property
    def glide(self) -> Glide:
        """How the plain interpolation that they were trained on continues beyond the keys, seconds."""
        sizes = self.synthesiser.sizes
        return Glide(sizes.glide_root_s, sizes.glide_turn_s)

    @property
    def windows(self) -> tuple[int, int]:
        """Frames in the synthesiser's and in the decoder's windows."""
        return self.window, self.autoencoder.window

    def encode(self, points: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """As `Autoencoder.encode`."""
        return self.autoencoder.encode(points, groups)

    def spans(self, known: Tensor) -> list[Span]:
        """The windows in which a clip is filled, in order, each widened to contain the keys at both ends of its gaps.

        Args:
            known: (T,) bool, at least one True.
        """
        keys = torch.nonzero(known).squeeze(1).cpu().numpy()
        windows = overlapping_windows(len(known), self.window)
        return [Span(*widened_to_keys(keys, start, stop), start, stop, fade) for start, stop, fade in windows]

    def synthesise(
        self,
        latents: Tensor,
        centroids: Tensor,
        known: Tensor,
        times: Tensor,
        base: tuple[Tensor, Tensor] | None = None,
        spans: Sequence[Span] | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Fill the unknown frames of a clip of any length.

        Windows overlap and are blended; each is widened to contain the keys at both ends of its gaps.

        Args:
            latents: (T, D), read only in known frames. centroids: (T, 3) metres. known: (T,) bool, at least one True.
            times: (T,) model frames, rising, real-valued.
            base: latents (T, D) and centroids (T, 3) of the skeleton's plain interpolation, for weights that were
                trained on it.
            spans: windows in these T frames, such as some of a longer clip's; None for all of a clip of T frames.

        Returns: latents (T, D), centroids (T, 3); as given in frames without a window.
        Raises: InputError if these weights need a base and none is given.
        """
        if self.synthesiser.sizes.base == "skeleton" and base is None:
            raise InputError(
                "These weights fill between the keys of a skeleton, and there is none.",
                "Give the motion whose keys are known, or weights trained with synthesiser.base = 'latent'.",
            )
        device = self.autoencoder.device
        latents, centroids, known, times = (part.to(device) for part in (latents, centroids, known, times))
        base = base if self.synthesiser.sizes.base == "skeleton" else None
        base = None if base is None else (base[0].to(device), base[1].to(device))

        def made(some: list[Span]) -> tuple[Tensor, Tensor]:
            return self.synthesiser(
                *(rows_of(part, some) for part in (latents, centroids, known, times.float())),
                None,
                None if base is None else (rows_of(base[0], some), rows_of(base[1], some)),
            )

        return blended_windows(self.spans(known) if spans is None else spans, (latents, centroids), made)


class Span(NamedTuple):
    """A window of a clip: frames `first` to `last` (excluded) are read, `start` to `stop` are written with weights
    `fade` (stop - start,)."""

    first: int
    last: int
    start: int
    stop: int
    fade: Tensor

    def moved(self, by: int) -> Span:
        """The same window in frames that are counted from another one."""
        return Span(self.first + by, self.last + by, self.start + by, self.stop + by, self.fade)


def touching(spans: Sequence[Span], first: int, last: int, rows: np.ndarray | None = None) -> list[Span]:
    """Those of a clip's windows that write some of its frames `first` to `last` (excluded); with `rows`
    (last - first,) bool, some frame that is True there."""
    some = [span for span in spans if span.start < last and span.stop > first]
    if rows is None:
        return some
    return [span for span in some if rows[max(span.start - first, 0) : span.stop - first].any()]


def reach_of(spans: Sequence[Span], first: int, last: int) -> tuple[int, int]:
    """First and last (excluded) frame of a clip that these windows read, or that lie from `first` to `last`."""
    return min([first, *(span.first for span in spans)]), max([last, *(span.last for span in spans)])


def batches_of(spans: Sequence[Span], frames: int = _WINDOW_FRAMES_AT_ONCE) -> Iterator[list[Span]]:
    """Windows that read equally many frames, in batches of at most so many frames (or of one window), shortest first.

    Windows of one length keep their order.
    """
    for length, each in groupby(sorted(spans, key=_length_of), _length_of):
        some, most = list(each), max(1, frames // length)
        yield from (some[first : first + most] for first in range(0, len(some), most))


def _length_of(span: Span) -> int:
    return span.last - span.first


def rows_of(values: Tensor, spans: Sequence[Span]) -> Tensor:
    """What each window reads of a clip's values (T, ...): (windows, frames, ...)."""
    return torch.stack([values[span.first : span.last] for span in spans])


def blended_windows(
    spans: Sequence[Span], given: tuple[Tensor, Tensor], made: Callable[[list[Span]], tuple[Tensor, Tensor]]
) -> tuple[Tensor, Tensor]:
    """Latents and centroids of a clip, computed window by window and blended, without gradients.

    Args:
        given: latents (T, D) and centroids (T, 3), which frames without a window keep.
        made: windows that read equally many frames -> their latents (windows, frames, D) and centroids.
    """
    out = torch.zeros_like(given[0]), torch.zeros_like(given[1])
    weights = out[0].new_zeros(len(given[0]), 1)
    with torch.inference_mode():
        for some in batches_of(spans):
            parts = made(some)
            for number, span in enumerate(some):
                inner = slice(span.start - span.first, span.stop - span.first)
                fade = span.fade.to(weights.device).unsqueeze(1)
                for whole, part in zip(out, parts, strict=True):
                    whole[span.start : span.stop] += fade * part[number, inner]
                weights[span.start : span.stop] += fade
        return (
            torch.where(weights > 0, out[0] / weights, given[0]),
            torch.where(weights > 0, out[1] / weights, given[1]),
        )


def whole_windows(frames: int, window: int) -> list[Span]:
    """The windows of `overlapping_windows`, each of which reads the frames that it writes."""
    return [Span(start, stop, start, stop, fade) for start, stop, fade in overlapping_windows(frames, window)]


def overlapping_windows(frames: int, window: int) -> Iterator[tuple[int, int, Tensor]]:
    """Windows over a clip, half overlapping, with blending weights in the overlaps.

    Yields: start, stop and (stop - start,) weights, all positive; a single window has weights of one.
    """
    if frames <= window:
        yield 0, frames, torch.ones(frames)
        return
    step = max(1, window // 2)
    starts = [*range(0, frames - window, step), frames - window]
    ramp = torch.linspace(0, 1, window + 2)[1:-1]
    hill = torch.minimum(ramp, ramp.flip(0)) * 2
    hill = hill * hill * (3 - 2 * hill)
    for start in starts:
        yield start, start + window, hill.clamp_min(1e-3)


def window_seams(frames: int, windows: Sequence[int]) -> np.ndarray:
    """(K,) frames of a clip of `frames` frames on both sides of each beginning or end of a window of one of these
    lengths inside it. Windows that were not blended would cause jumps at these frames."""
    spans = [span for window in windows for span in overlapping_windows(frames, window)]
    inside = [edge for start, stop, _ in spans for edge in (start, stop) if 0 < edge < frames]
    return np.array(sorted({frame for edge in inside for frame in (edge - 1, edge)}), np.int64)


def load_autoencoder(path: str | Path, device: str = "auto") -> Autoencoder:
    """The encoder and decoder of a checkpoint artefact. Raises InputError if the artefact is of another kind."""
    artefact = open_artefact(path, "checkpoint")
    kept = read_checkpoint(artefact, optimiser=False)
    if kept.config.get("network") != "autoencoder":
        raise InputError(f"{path} holds no autoencoder.", "Give the folder that `pumps train ae` wrote.")
    chosen = choose_device(device)
    encoder = build_bounded(
        lambda: FrameEncoder(EncoderSizes(**kept.config["encoder"])), kept.config.get("encoder"), kept.weights, path
    )
    decoder = build_bounded(
        lambda: CloudDecoder(encoder.latent_width, DecoderSizes(**kept.config["decoder"])),
        kept.config.get("decoder"),
        kept.weights,
        path,
    )
    load_state(
        encoder, {name[8:]: value for name, value in kept.weights.items() if name.startswith("encoder.")}, path
    )
    load_state(
        decoder, {name[8:]: value for name, value in kept.weights.items() if name.startswith("decoder.")}, path
    )
    return Autoencoder(
        encoder.to(chosen).eval(),
        decoder.to(chosen).eval(),
        whole_setting(kept.config, "window", MOST_WINDOW, path),
        whole_setting(kept.config, "points", MOST_POINTS, path),
        tuple(artefact.manifest.licences),
        artefact.manifest.digest,
        chosen,
    )


def load_weights(name_or_path: str | Path, device: str = "auto", *, confidence: bool = True) -> Models:
    """Weights by shipped name or folder, with the confidence beside them if wanted.

    Raises: InputError if there are none, or if the synthesiser was trained on another encoder.
    """
    folder = weights_folder(name_or_path)
    ae, lms = parts_of(folder)
    autoencoder = load_autoencoder(ae, device)
    artefact: Artefact = open_artefact(lms, "checkpoint")
    kept = read_checkpoint(artefact, optimiser=False)
    if kept.config.get("encoder_digest") != autoencoder.digest:
        raise InputError(
            f"The synthesiser in {folder} was trained on another autoencoder than the one beside it.",
            "Train it again with `pumps train lms`.",
        )
    return Models(
        autoencoder,
        load_synthesiser(kept, autoencoder, lms),
        whole_setting(kept.config, "window", MOST_WINDOW, lms),
        whole_setting(kept.config, "longest_gap", MOST_WINDOW, lms, least=0),
        tuple(artefact.manifest.licences),
        last_sentence(kept.trainings),
        str(name_or_path),
        read_confidence(folder) if confidence else None,
    )


def load_synthesiser(kept: Checkpoint, autoencoder: Autoencoder, path: str | Path) -> LatentSynthesiser:
    """The synthesiser of a checkpoint, for the latents of an autoencoder and on its device.

    Raises: InputError if its weights do not fit its sizes.
    """
    network = build_bounded(
        lambda: LatentSynthesiser(autoencoder.encoder.latent_width, SynthesiserSizes(**kept.config["synthesiser"])),
        kept.config.get("synthesiser"),
        kept.weights,
        path,
    )
    load_state(network, kept.weights, path)
    return network.to(autoencoder.device).eval()


def load_state(network: torch.nn.Module, weights: dict[str, np.ndarray], path: object) -> None:
    """Load a network's weights by name. Raises InputError if they do not fit."""
    try:
        network.load_state_dict(
            {name: torch.from_numpy(np.array(value, np.float32)) for name, value in weights.items()}
        )
    except RuntimeError as error:
        raise InputError(
            f"The weights in {path} do not fit their own config: {error}.", "Train them again."
        ) from None
