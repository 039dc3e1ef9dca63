"""The latent motion synthesiser: fills latent frames that are missing (PUMPS 3.3, after CITL)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from stages.shared.networks.layers.attention import ExactNorm, Rows, TimeLayer
from stages.shared.networks.layers.layer_stack import LayerStack
from stages.shared.networks.layers.sizes import SynthesiserSizes

_PLACE_FEATURES = 8
_FAR_FRAMES = 15.0  # from here on, a missing frame's residual is at its full size
_FAR_M = 0.3  # the size of a centroid's residual there, metres


def neighbouring_keys(known: Tensor) -> tuple[Tensor, Tensor]:
    """For every frame the index of the last known frame up to it and of the first known frame from it on.

    Before the first and after the last key both are that key.

    Args:
        known: (B, T) with at least one True in every row.

    Returns: two (B, T) int64.
    """
    frames = torch.arange(known.shape[1], device=known.device).expand_as(known)
    before = torch.where(known, frames, -1).cummax(dim=1).values
    after = torch.where(known, frames, known.shape[1]).flip(1).cummin(dim=1).values.flip(1)
    first = torch.where(before < 0, after, before)
    last = torch.where(after == known.shape[1], before, after)
    return first, last


def share_between_keys(known: Tensor, times: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """`neighbouring_keys` and each frame's share in [0, 1] of the way from one to the other, (B, T)."""
    first, last = neighbouring_keys(known)
    times = times.expand_as(known)
    start, end = times.gather(1, first), times.gather(1, last)
    share = torch.where(end > start, (times - start) / (end - start).clamp_min(1e-6), torch.zeros_like(times))
    return first, last, share


def interpolate_known(values: Tensor, known: Tensor, times: Tensor) -> Tensor:
    """Linear interpolation of the known frames in time, held beyond the first and last; values (B, T, C)."""
    first, last, share = share_between_keys(known, times)
    width = (-1, -1, values.shape[-1])
    start = values.gather(1, first.unsqueeze(-1).expand(*width))
    end = values.gather(1, last.unsqueeze(-1).expand(*width))
    return torch.lerp(start, end, share.unsqueeze(-1).to(values.dtype))


def key_distance(known: Tensor, times: Tensor) -> Tensor:
    """(B, T) frames to the nearest key. A plain interpolation's error grows with it (a position's with its
    square, near a key), so with a residual that grows in the same way the network's outputs have one size
    everywhere."""
    first, last = neighbouring_keys(known)
    since, until = (times - times.gather(1, first)).abs(), (times.gather(1, last) - times).abs()
    return torch.minimum(since, until).float()


def place_in_gap(known: Tensor, times: Tensor) -> Tensor:
    """A frame's position in its gap, (B, T, 8): all are functions of differences of times."""
    first, last, share = share_between_keys(known, times)
    since = (times - times.gather(1, first)) / 30
    until = (times.gather(1, last) - times) / 30
    one_sided = (until < 0) | (since < 0) | ((since + until) <= 0)
    gap = since.abs() + until.abs()
    features = [
        share,
        share * (1 - share),
        since,
        until,
        gap,
        (1 + 30 * gap).log(),
        one_sided.float(),
        known.float(),
    ]
    return torch.stack([feature.float() for feature in features], dim=-1)


class LatentSynthesiser(nn.Module):
    """Known latent frames in, all latent frames out.

    Three stages of attention: over the keys alone; from the missing frames (a learned token each, with the plain
    interpolation) to the encoded keys; over all frames. The output is a residual on the plain interpolation, zero
    before training, so that learning starts no worse than it.
    """

    def __init__(self, latent_width: int, sizes: SynthesiserSizes):
        super().__init__()
        self.sizes = sizes
        self.latent_width = latent_width
        width = sizes.width
        self.embed_key = nn.Linear(latent_width + 3, width)
        self.embed_missing = nn.Linear(latent_width + 3 + _PLACE_FEATURES, width)
        self.missing_token = nn.Parameter(torch.randn(width) * 0.02)
        self.key_layers = LayerStack(TimeLayer(width, sizes.heads) for _ in range(sizes.key_layers))
        self.fill_layers = LayerStack(
            TimeLayer(width, sizes.heads, asks_memory=True) for _ in range(sizes.fill_layers)
        )
        self.frame_layers = LayerStack(TimeLayer(width, sizes.heads) for _ in range(sizes.frame_layers))
        self.norm = ExactNorm(width)
        self.out = nn.Linear(width, latent_width + 3)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(
        self,
        latents: Tensor,
        centroids: Tensor,
        known: Tensor,
        times: Tensor,
        valid: Tensor | None = None,
        base: tuple[Tensor, Tensor] | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Args:
            latents: (B, T, D), read only where `known`. centroids: (B, T, 3) metres, likewise.
            known: (B, T) True = the frame is given; at least one in every row.
            times: (B or 1, T) model frames, real-valued, rising.
            valid: (B, T) True for real frames, False for padding (never known); None for all.
            base: latents (B, T, D) and centroids (B, T, 3) of a plain interpolation of the keys alone, to which the
                residual is added; by default the known latents and centroids interpolated linearly.

        Returns: latents (B, T, D) and centroids (B, T, 3); known frames are returned as given.
        """
        times = times.expand_as(known)
        gate = known.unsqueeze(-1)
        latents, centroids = torch.where(gate, latents, 0), torch.where(gate, centroids, 0)
        if base is None:
            base = interpolate_known(latents, known, times), interpolate_known(centroids, known, times)
        base_latents = torch.where(gate, latents, base[0])
        base_centroids = torch.where(gate, centroids, base[1])
        origin = centroids.sum(1, keepdim=True) / known.sum(1).view(-1, 1, 1)

        key_inputs = torch.cat([latents, centroids - origin * gate], dim=-1)
        place = place_in_gap(known, times)
        missing_inputs = torch.cat([base_latents, base_centroids - origin, place], dim=-1)
        # On a GPU, counting the known frames would wait for it.
        alone = known.device.type == "cpu"
        frames = self._filled(key_inputs, missing_inputs, known, times, alone=alone)
        frames = self.frame_layers(frames, times, known=valid)
        far = key_distance(known, times).div(_FAR_FRAMES).clamp(max=1).unsqueeze(-1)
        residual = self.out(self.norm(frames)).to(latents.dtype) * torch.where(gate, 0, far)
        return base_latents + residual[..., :-3], base_centroids + _FAR_M * far * residual[..., -3:]

    def _filled(
        self, key_inputs: Tensor, missing_inputs: Tensor, known: Tensor, times: Tensor, *, alone: bool
    ) -> Tensor:
        """The first two stages, (B, T, width): encoded keys where `known`, and missing frames that attended to them.

        With `alone`, keys are computed at known frames only and missing frames at the others, which are all that is
        read; the result is the same.
        """
        if not alone:
            keys = self.key_layers(self.embed_key(key_inputs), times, known=known)
            missing = self.embed_missing(missing_inputs) + self.missing_token
            missing = self.fill_layers(missing, times, memory=keys, memory_times=times, known=known)
            return torch.where(known.unsqueeze(-1), keys, missing)
        known_at, missing_at = Rows.where(known), Rows.where(~known)
        # Attention runs over the keys alone, as many as the sequence with the most of them has.
        first = known.int().argsort(dim=1, descending=True, stable=True)[:, : int(known.sum(1).max())]
        is_key, key_times = known.gather(1, first), times.gather(1, first)
        keys_at = Rows.where(is_key)
        keys = self.embed_key(known_at.take(key_inputs))
        keys = self.key_layers(keys, key_times, known=is_key, rows=keys_at)
        missing = self.embed_missing(missing_at.take(missing_inputs)) + self.missing_token
        missing = self.fill_layers(
            missing, times, memory=keys, memory_times=key_times, known=is_key, rows=missing_at, memory_rows=keys_at
        )
        both = known_at._replace(index=torch.cat([known_at.index, missing_at.index]))
        return both.put(torch.cat([keys, missing]))

    def refine(
        self, latents: Tensor, centroids: Tensor, given: Tensor, times: Tensor, valid: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """All frames anew, from frames that are given but may be wrong: for fine-tuning (PUMPS 5).

        Every frame goes the way of a missing frame: it attends to the encoded given frames, and its residual is added
        to its own latent, or where it is not given to the interpolated one. No frame is returned as given.

        Args:
            latents: (B, T, D), read only where `given`. centroids: (B, T, 3) metres, likewise.
            given: (B, T) True = the frame holds something; at least one in every row.
            times: (B or 1, T) model frames, real-valued, rising.
            valid: (B, T) True for real frames, False for padding (never given); None for all.

        Returns: latents (B, T, D) and centroids (B, T, 3).
        """
        times = times.expand_as(given)
        gate = given.unsqueeze(-1)
        latents, centroids = torch.where(gate, latents, 0), torch.where(gate, centroids, 0)
        origin = centroids.sum(1, keepdim=True) / given.sum(1).view(-1, 1, 1)
        keys = self.embed_key(torch.cat([latents, (centroids - origin) * gate], dim=-1))
        keys = self.key_layers(keys, times, known=given)
        base = torch.where(gate, latents, interpolate_known(latents, given, times))
        base_centroids = torch.where(gate, centroids, interpolate_known(centroids, given, times))
        place = place_in_gap(given, times)
        frames = self.embed_missing(torch.cat([base, base_centroids - origin, place], dim=-1)) + self.missing_token
        frames = self.fill_layers(frames, times, memory=keys, memory_times=times, known=given)
        frames = self.frame_layers(frames, times, known=valid)
        residual = self.out(self.norm(frames)).to(latents.dtype)
        return base + residual[..., :-3], base_centroids + _FAR_M * residual[..., -3:]
