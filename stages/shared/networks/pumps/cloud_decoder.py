"""The cloud decoder: latents over time to point trajectories; each point has its own noise identity (PUMPS 3.2)."""

from __future__ import annotations

import math
from functools import partial

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from stages.shared.kinematics.conventions import GROUPS
from stages.shared.networks.layers.attention import ExactNorm, TimeLayer, sinusoids
from stages.shared.networks.layers.layer_stack import Checkpointed, LayerStack
from stages.shared.networks.layers.pieces import in_pieces, rows_per_piece
from stages.shared.networks.layers.row_generator import draw_normal, draw_uniform
from stages.shared.networks.layers.sizes import DecoderSizes


def drop_features(latents: Tensor, share: float, kind: str, generator: torch.Generator | None = None) -> Tensor:
    """Sequence-wise dropout (PUMPS 3.1): the same features are dropped in every frame of a sequence.

    Args:
        latents: (B, T, D). share: p, the expected share that is dropped; the rest is scaled by 1 / (1 - p).
        kind: "sequence", or "element" (every frame by itself, PUMPS Table 2).
    """
    if share <= 0:
        return latents
    shape = (latents.shape[0], 1 if kind == "sequence" else latents.shape[1], latents.shape[2])
    keep = draw_uniform(shape, generator, latents.device) >= share
    return latents * keep / (1 - share)


class CloudDecoder(nn.Module):
    """Latents and centroids -> points. No attention between points, so a point depends on its identity alone.

    A true cloud is linear in the points' positions on their bones: p(t) = R(t) u + h(t). So beside the paper's
    point-wise MLP there is a `skinning` head: the frame's feature gives, for each body group, a 3 x K matrix, the
    noise identity gives a K-vector, and the point is their product. It needs one small product for a point and a
    frame; the MLP needs thousands of operations. `DecoderSizes.head` selects the head.

    `DecoderSizes.identities` sets the identities of points (PUMPS Table 2): noise as in the paper; the cells of a
    fixed 2D grid, as FoldingNet folds one; or draws from a Gaussian that each frame's feature gives, as a VAE's.
    """

    def __init__(self, latent_width: int, sizes: DecoderSizes):
        super().__init__()
        self.sizes = sizes
        self.embed = nn.Linear(latent_width + 3, sizes.width)
        self.layers = LayerStack(
            TimeLayer(sizes.width, sizes.heads, rotary=sizes.positions == "rope") for _ in range(sizes.layers)
        )
        self.norm = ExactNorm(sizes.width)
        head = SkinningHead if sizes.head == "skinning" else PointHead
        self.head = VariationalHead(sizes) if sizes.identities == "vae" else head(sizes)

    def forward(
        self,
        latents: Tensor,
        centroids: Tensor,
        times: Tensor,
        groups: Tensor,
        noise: Tensor,
        valid: Tensor | None = None,
        generator: torch.Generator | None = None,
    ) -> Tensor:
        """Args:
            latents: (B, T, D). centroids: (B, T, 3) metres. times: (B or 1, T) model frames.
            groups: (B or 1, P) body group of each point to make. noise: (B or 1, P, Z) the points' identities
                (`draw_noise`); 1 for the same points in all sequences.
            valid: (B, T) True for real frames; None for all.
            generator: of the dropout's mask, in training.

        Returns: (B, T, P, 3) metres.
        """
        frames = self.frame_features(latents, centroids, times, valid, generator)
        return self.place_points(frames, centroids, groups, noise)

    def frame_features(
        self,
        latents: Tensor,
        centroids: Tensor,
        times: Tensor,
        valid: Tensor | None = None,
        generator: torch.Generator | None = None,
    ) -> Tensor:
        """What the points of each frame are made from, (B, T, W); arguments as of `forward`."""
        if self.training:
            latents = drop_features(latents, self.sizes.dropout, self.sizes.dropout_kind, generator)
        weight = torch.ones_like(centroids[..., :1]) if valid is None else valid.unsqueeze(-1).to(centroids)
        middle = (centroids * weight).sum(1, keepdim=True) / weight.sum(1, keepdim=True).clamp_min(1)
        frames = self.embed(torch.cat([latents, centroids - middle], dim=-1))
        if self.sizes.positions == "sinusoidal":
            frames = frames + sinusoids(times, frames.shape[-1])
        return self.norm(self.layers(frames, times, known=valid))

    def place_points(self, frames: Tensor, centroids: Tensor, groups: Tensor, noise: Tensor) -> Tensor:
        """Points (B, T, P, 3), metres, of frames' features (B, T, W); groups and noise as of `forward`."""
        if not isinstance(self.head, SkinningHead):
            groups, noise = groups.expand(len(frames), -1), noise.expand(len(frames), -1, -1)
        return self.head(frames, groups, noise).to(centroids.dtype) + centroids.unsqueeze(2)

    def divergence(self, frames: Tensor, groups: Tensor) -> Tensor:
        """Divergence of the points' codes from N(0, 1), (B, T, P) nats; 0 except for `vae`."""
        if isinstance(self.head, VariationalHead):
            return self.head.divergence(frames, groups)
        return frames.new_zeros(*frames.shape[:2], groups.shape[1])

    def draw_noise(self, batch: int, points: int, generator: torch.Generator | None = None) -> Tensor:
        """Identities of new points, (batch, points, Z): N(0, 1), or the grid's cells, the same for every cloud."""
        device = self.embed.weight.device
        if self.sizes.identities == "grid":
            return grid_cells(points).to(device).expand(batch, -1, -1)
        return draw_normal((batch, points, self.sizes.noise), generator, device)


def grid_cells(points: int) -> Tensor:
    """Cells of a square 2D grid, (points, 2), centred, of unit variance on each axis.

    They come in a fixed scattered order, so that any consecutive points, such as one body group's, cover the square.
    """
    side = math.ceil(points**0.5)
    steps = torch.arange(side, dtype=torch.float32) - (side - 1) / 2
    steps = steps / steps.square().mean().sqrt().clamp_min(1e-6)
    cells = torch.cartesian_prod(steps, steps)
    return cells[torch.randperm(len(cells), generator=torch.Generator().manual_seed(0))[:points]]


class PointHead(nn.Module, Checkpointed):
    """The paper's head: the frame's feature joined to the identity, then linear layers to three coordinates.

    The first layer of a joined vector is a sum of two, W (t + z) = W_t t + W_z z, each taken once for a frame or a
    point; the frame's part has a projection for each body group.

    With checkpointing no intermediate results are kept.
    """

    def __init__(self, sizes: DecoderSizes):
        super().__init__()
        self.by_frame = nn.Linear(sizes.width, GROUPS * sizes.point_width)
        self.by_point = nn.Linear(sizes.identity_width, sizes.point_width, bias=False)
        self.hidden = nn.Linear(sizes.point_width, sizes.point_hidden)
        self.out = nn.Linear(sizes.point_hidden, 3)

    def forward(self, frames: Tensor, groups: Tensor, noise: Tensor) -> Tensor:
        """frames (B, T, W), groups (B, P), noise (B, P, Z) -> (B, T, P, 3) relative to the centroid."""
        by_group = self.by_frame(frames).unflatten(-1, (GROUPS, -1))  # (B, T, 5, C)
        by_point = self.by_point(noise)  # (B, P, C)
        one_hot = F.one_hot(groups.long(), GROUPS).to(by_point.dtype)
        # C features for every point of every frame are the autoencoder's largest intermediate result.
        again = self.checkpointing
        frames_at_once = rows_per_piece(frames.device, by_point[0].numel(), checkpointing=again)
        if frames_at_once >= frames.shape[0] * frames.shape[1] and not again:
            return self._points(by_group, one_hot.unsqueeze(1), by_point.unsqueeze(1))
        clouds = []
        for steps, own_groups, identities in zip(by_group, one_hot, by_point, strict=True):
            learnt = [identities, *self.hidden.parameters(), *self.out.parameters()]
            run = partial(self._points, one_hot=own_groups, by_point=identities)
            clouds.append(in_pieces(run, frames_at_once, [steps], learnt, checkpointing=again))
        return torch.stack(clouds)

    def _points(self, by_group: Tensor, one_hot: Tensor, by_point: Tensor) -> Tensor:
        """by_group (..., T, 5, C), one_hot (..., P, 5), by_point (..., P, C) -> (..., T, P, 3)."""
        joined = torch.matmul(one_hot, by_group) + by_point  # selects each point's own group
        inner = F.gelu(self.hidden(F.gelu(joined)))
        with torch.autocast(inner.device.type, enabled=False):  # bfloat16 is too coarse for coordinates
            return F.linear(inner.to(self.out.weight.dtype), self.out.weight, self.out.bias)


class VariationalHead(nn.Module):
    """A point's code is drawn from a Gaussian that its frame and body group give, as a VAE's decoder draws it.

    The draw is by the reparameterisation, mean + deviation * identity, the identity constant over time like the
    paper's noise; then linear layers as in `PointHead`. All information about the frame reaches the points through
    the code, whose divergence from N(0, 1) is a term of the loss.
    """

    def __init__(self, sizes: DecoderSizes):
        super().__init__()
        self.posterior = nn.Linear(sizes.width, GROUPS * 2 * sizes.noise)
        self.by_code = nn.Linear(sizes.noise + GROUPS, sizes.point_width)
        self.hidden = nn.Linear(sizes.point_width, sizes.point_hidden)
        self.out = nn.Linear(sizes.point_hidden, 3)

    def forward(self, frames: Tensor, groups: Tensor, noise: Tensor) -> Tensor:
        """frames (B, T, W), groups (B, P), noise (B, P, Z) -> (B, T, P, 3) relative to the centroid."""
        mean, log_variance = self._gaussians(frames, groups)
        codes = mean + (0.5 * log_variance).exp() * noise.unsqueeze(1)
        one_hot = F.one_hot(groups.long(), GROUPS).to(codes.dtype).unsqueeze(1).expand(-1, frames.shape[1], -1, -1)
        joined = self.by_code(torch.cat([codes, one_hot], dim=-1))
        return self.out(F.gelu(self.hidden(F.gelu(joined))))

    def divergence(self, frames: Tensor, groups: Tensor) -> Tensor:
        """KL(N(mean, variance) || N(0, 1)) of each point's code, (B, T, P) nats."""
        mean, log_variance = (part.float() for part in self._gaussians(frames, groups))
        return 0.5 * (mean.square() + log_variance.exp() - 1 - log_variance).sum(-1)

    def _gaussians(self, frames: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """Means and logarithms of variances, (B, T, P, Z) each."""
        mean, log_variance = _of_own_group(self.posterior(frames), groups).chunk(2, dim=-1)
        return mean, log_variance.clamp(-12, 6)


def _of_own_group(by_frame: Tensor, groups: Tensor) -> Tensor:
    """Frames' features (B, T, 5 K), a part for each body group -> each point's part, (B, T, P, K)."""
    by_group = by_frame.unflatten(-1, (GROUPS, -1))
    index = groups.long()[:, None, :, None].expand(-1, by_frame.shape[1], -1, by_group.shape[-1])
    return torch.gather(by_group, 2, index)


class SkinningHead(nn.Module):
    """A point is a product of its frame's transforms and its identity's code, within its body group."""

    def __init__(self, sizes: DecoderSizes):
        super().__init__()
        self.codes = sizes.codes
        self.by_frame = nn.Linear(sizes.width, GROUPS * 3 * sizes.codes)
        self.by_point = nn.Sequential(
            nn.Linear(sizes.identity_width + GROUPS, sizes.point_width),
            nn.GELU(),
            nn.Linear(sizes.point_width, sizes.point_width),
            nn.GELU(),
            nn.Linear(sizes.point_width, sizes.codes),
        )

    def forward(self, frames: Tensor, groups: Tensor, noise: Tensor) -> Tensor:
        """frames (B, T, W), groups (B or 1, P), noise (B or 1, P, Z) -> (B, T, P, 3) relative to the centroid."""
        batch, steps, width = frames.shape
        one_hot = F.one_hot(groups.long(), GROUPS).to(noise.dtype)
        codes = self.by_point(torch.cat([noise, one_hot], dim=-1))  # (B, P, K)
        codes = (one_hot.to(codes.dtype).unsqueeze(-1) * codes.unsqueeze(2)).flatten(2)  # (B, P, 5 K), own group only
        if len(codes) == 1:
            # The same points in every sequence: both products are one linear layer from a frame's feature to all of
            # their coordinates, which is smaller than the layer to the transforms.
            weight = self.by_frame.weight.view(GROUPS, 3, self.codes, width).transpose(1, 2).reshape(-1, 3 * width)
            bias = self.by_frame.bias.view(GROUPS, 3, self.codes).transpose(1, 2).reshape(-1, 3)
            scaled = codes[0] / self.codes**0.5
            placed = F.linear(frames, (scaled @ weight).view(-1, width), (scaled @ bias).flatten())
            return placed.view(batch, steps, -1, 3)
        transforms = self.by_frame(frames).view(batch, steps, GROUPS, 3, self.codes)
        transforms = transforms.transpose(2, 3).reshape(batch, steps * 3, GROUPS * self.codes)
        placed = torch.bmm(transforms, codes.transpose(1, 2)) / self.codes**0.5
        return placed.view(batch, steps, 3, -1).transpose(2, 3)
