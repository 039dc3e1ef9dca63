"""Networks that generate motions of an action: a transformer VAE (ACTOR) and a recurrent VAE (Action2Motion).

Both learn sequences of joint positions: (B, T, F), F = 3 J metres, placed so that the pelvis of the first frame is at
the origin and faces +Z. Inside, a frame is the pelvis and the other joints relative to it, less the mean and divided
by the standard deviation of real frames.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from stages.shared.networks.concepts.motion_encoder import perceptron, sinusoidal

NETWORKS = ("actor", "recurrent")
LEAST_SPREAD_M = 0.02  # so that the noise of a joint that hardly moves is not amplified


class Reconstructed(NamedTuple):
    """frames (B, T, F) standardised; divergence (B,): KL divergence of a sequence's codes from their prior."""

    frames: Tensor
    divergence: Tensor


class ActionGenerator(nn.Module):
    """What both networks have in common: the standardisation of frames, and sampling in metres.

    Args:
        features: F. mean, spread: (F,) of real frames relative to their pelvis.
    """

    mean: Tensor
    spread: Tensor

    def __init__(self, features: int, latent: int):
        super().__init__()
        self.features, self.latent = features, latent
        self.register_buffer("mean", torch.zeros(features))
        self.register_buffer("spread", torch.ones(features))

    def standardised(self, motion: Tensor) -> Tensor:
        """Placed positions (..., F) in metres as the network sees them."""
        return (relative_frames(motion) - self.mean) / self.spread

    def positions(self, frames: Tensor) -> Tensor:
        """The inverse of `standardised`."""
        found = frames * self.spread + self.mean
        return torch.cat([found[..., :3], found[..., 3:] + _repeated(found)], dim=-1)

    def noise_shape(self, rows: int, frames: int) -> tuple[int, ...]:
        """Shape of the standard normal numbers that `forward` and `sample` take for sequences."""
        raise NotImplementedError

    def forward(self, motion: Tensor, action: Tensor, valid: Tensor, noise: Tensor) -> Reconstructed:
        """Reconstruct sequences.

        Args:
            motion: (B, T, F) metres. action: (B,). valid: (B, T) True for real frames, at least the first.
            noise: of `noise_shape`.
        """
        raise NotImplementedError

    def sample(self, action: Tensor, frames: int, noise: Tensor) -> Tensor:
        """(B, T, F) metres: new motions of actions (B,)."""
        raise NotImplementedError


def relative_frames(motion: Tensor) -> Tensor:
    """Positions (..., 3 J) as the pelvis, and the other joints relative to it."""
    return torch.cat([motion[..., :3], motion[..., 3:] - _repeated(motion)], dim=-1)


def _repeated(motion: Tensor) -> Tensor:
    """(..., 3 (J - 1)) the first joint of each frame, once for each other joint."""
    return motion[..., :3].tile(motion.shape[-1] // 3 - 1)


class Actor(ActionGenerator):
    """A compact ACTOR (Petrovich et al. 2021): one code for a sequence, and positions as the decoder's queries.

    Two learned tokens of the action go before the frames into the encoder and come out as mean and log variance of
    the code. The decoder attends to the code plus a learned vector of the action.
    """

    def __init__(self, features: int, actions: int, width: int, blocks: int, latent: int):
        super().__init__(features, latent)
        self.width = width
        layer = {
            "d_model": width, "nhead": 4, "dim_feedforward": 2 * width, "dropout": 0.1, "activation": "gelu",
            "batch_first": True,
        }  # fmt: skip
        self.embed = nn.Linear(features, width)
        self.tokens = nn.Parameter(torch.randn(actions, 2, width))
        self.encoder = nn.TransformerEncoder(nn.TransformerEncoderLayer(**layer), blocks, enable_nested_tensor=False)
        self.code = nn.ModuleList([nn.Linear(width, latent), nn.Linear(width, latent)])
        self.from_code = nn.Linear(latent, width)
        self.action = nn.Parameter(torch.randn(actions, width))
        self.decoder = nn.TransformerDecoder(nn.TransformerDecoderLayer(**layer), blocks)
        self.output = nn.Linear(width, features)

    def noise_shape(self, rows: int, frames: int) -> tuple[int, ...]:
        return rows, self.latent

    def forward(self, motion: Tensor, action: Tensor, valid: Tensor, noise: Tensor) -> Reconstructed:
        whole = torch.cat([self.tokens[action], self.embed(self.standardised(motion))], dim=1)
        whole = whole + sinusoidal(whole.shape[1], self.width, whole.device)
        hidden = ~torch.cat([torch.ones_like(valid[:, :2]), valid], dim=1)
        encoded = self.encoder(whole, src_key_padding_mask=hidden)
        mean, log_variance = (layer(encoded[:, at]) for at, layer in enumerate(self.code))
        log_variance = log_variance.clamp(-12, 6)
        divergence = 0.5 * (mean.square() + log_variance.exp() - 1 - log_variance).sum(1)
        code = mean + noise * (log_variance / 2).exp()
        return Reconstructed(self._decoded(code, action, motion.shape[1], valid), divergence)

    def sample(self, action: Tensor, frames: int, noise: Tensor) -> Tensor:
        return self.positions(self._decoded(noise, action, frames, None))

    def _decoded(self, code: Tensor, action: Tensor, frames: int, valid: Tensor | None) -> Tensor:
        memory = (self.from_code(code) + self.action[action])[:, None]
        queries = sinusoidal(frames, self.width, code.device).expand(len(code), -1, -1)
        hidden = None if valid is None else ~valid
        return self.output(self.decoder(queries, memory, tgt_key_padding_mask=hidden))


class Recurrent(ActionGenerator):
    """A conditional temporal VAE (Guo et al. 2020, Action2Motion) on joint positions: one code for a frame.

    A frame's code has a posterior, which has seen the frame, and a prior, which has seen the frames before it. A
    recurrent network makes the frame from the one before it, the action, the share of the sequence that is over, and
    the code. In training the frame before it is the true one with probability `_TAUGHT`, else the one that was made.
    The paper's generator makes rotations (Lie algebra); this one makes positions.
    """

    _TAUGHT = 0.6

    def __init__(self, features: int, actions: int, width: int, blocks: int, latent: int):
        super().__init__(features, latent)
        self.width, self.actions, self.blocks = width, actions, blocks
        given = features + actions + 1
        self.posterior = nn.GRUCell(given, width)
        self.prior = nn.GRUCell(given, width)
        self.posterior_code, self.prior_code = nn.Linear(width, 2 * latent), nn.Linear(width, 2 * latent)
        self.generator = nn.ModuleList(
            nn.GRUCell(given + latent if at == 0 else width, width) for at in range(blocks)
        )
        self.output = perceptron(width, features, width)

    def noise_shape(self, rows: int, frames: int) -> tuple[int, ...]:
        return rows, frames, self.latent + 1  # the last number chooses between a true frame and one that was made

    def forward(self, motion: Tensor, action: Tensor, valid: Tensor, noise: Tensor) -> Reconstructed:
        true = self.standardised(motion)
        counts = valid.sum(1)
        taught = torch.special.ndtr(noise[..., -1:]) < self._TAUGHT
        frames, divergences = self._run(action, motion.shape[1], counts, noise, true, taught)
        return Reconstructed(frames, (divergences * valid).sum(1))

    def sample(self, action: Tensor, frames: int, noise: Tensor) -> Tensor:
        counts = torch.full((len(action),), frames, device=noise.device)
        return self.positions(self._run(action, frames, counts, noise, None, None)[0])

    def _run(
        self, action: Tensor, length: int, counts: Tensor, noise: Tensor, true: Tensor | None, taught: Tensor | None
    ) -> tuple[Tensor, Tensor]:
        """Frames (B, T, F) and the divergences (B, T) of their codes; without `true`, codes come from the prior."""
        rows = len(action)
        before = noise.new_zeros(rows, self.features)
        one_hot = nn.functional.one_hot(action, self.actions).to(noise.dtype)
        states = [noise.new_zeros(rows, self.width) for _ in range(self.blocks + 2)]
        made, divergences = [], []
        for at in range(length):
            told = torch.cat([one_hot, (at / counts)[:, None].to(noise.dtype)], dim=1)
            states[0] = self.prior(torch.cat([before, told], dim=1), states[0])
            mean, log_variance = self._code(self.prior_code(states[0]))
            if true is not None:
                prior_mean, prior_log = mean, log_variance
                states[1] = self.posterior(torch.cat([true[:, at], told], dim=1), states[1])
                mean, log_variance = self._code(self.posterior_code(states[1]))
                apart = ((mean - prior_mean).square() + log_variance.exp()) / prior_log.exp()
                divergences.append(0.5 * (apart - 1 - log_variance + prior_log).sum(1))
            code = mean + noise[:, at, :-1] * (log_variance / 2).exp()
            found = torch.cat([before, told, code], dim=1)
            for layer, cell in enumerate(self.generator):
                states[2 + layer] = found = cell(found, states[2 + layer])
            frame = self.output(found)
            made.append(frame)
            before = frame if true is None or taught is None else torch.where(taught[:, at], true[:, at], frame)
        return torch.stack(made, dim=1), torch.stack(divergences, dim=1) if divergences else noise.new_zeros(rows, 0)

    def _code(self, found: Tensor) -> tuple[Tensor, Tensor]:
        mean, log_variance = found.chunk(2, dim=1)
        return mean, log_variance.clamp(-8, 4)


def new_generator(network: str, features: int, actions: int, width: int, blocks: int, latent: int) -> ActionGenerator:
    """A network with weights drawn from torch's generator.

    Args:
        network: one of `NETWORKS`. blocks: transformer blocks, or layers of the recurrent generator.
    """
    made = {"actor": Actor, "recurrent": Recurrent}[network]
    return made(features, actions, width, blocks, latent)
