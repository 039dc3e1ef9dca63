"""How true motions vary around what some weights fill: a Gaussian over the residual of a gap's latents.

The residual of a gap is the true motion's latents and centroids minus those of the fill, both seen from where the
body faces +Z halfway through the gap. At the relative time u of a gap, 0 at its first key and 1 at its second, it is

    r(u) = s * sum over k of sin(k pi u) * (c_k E, d_k),    (c, d) = F z,    z ~ N(0, I)

with directions E of the latents, coefficients c of these and d of the centroid for each wave k, a factor F of few
columns, the strongest modes of residuals, and the gap's scale s, log-linear in `GapPath.features`. What weaker modes
add is not drawn. A gap without a key at one end has half waves, sin((k - 1/2) pi u). The residual vanishes at keys.
`pumps weights vary` measures E, F and the weights of s.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_schemas.damaged_files import reading
from data_schemas.errors import InputError
from stages.shared.inference.models import Models
from stages.shared.outputs import write_output
from stages.shared.weights.shipped import VARIATION_NAME, weights_folder

VERSION = 1
WAVES = 4
CENTROID = 3
FEATURES = 4
_LEAST_SPEED = 1e-4
_DECIMALS = 5


@dataclass(frozen=True)
class GapPath:
    """What the distribution of a gap's residual depends on.

    times:   (n,) of its tokens, model frames.
    before:  time of the key before it; None if it begins without one.
    after:   time of the key after it; None if it ends without one.
    latents: (m, D) of the fill at the gap's tokens and the keys beside it, whose times are `path_times` (m,).
    lone:    share of the keys beside it whose velocity is not known, since no known token is next to them.
    """

    times: np.ndarray
    before: float | None
    after: float | None
    latents: np.ndarray
    path_times: np.ndarray
    lone: float

    @property
    def open(self) -> bool:
        """Whether a key is missing at one of its ends."""
        return self.before is None or self.after is None

    @property
    def length(self) -> float:
        """Model frames from key to key, or from the key to the end of the clip."""
        first = self.times[0] if self.before is None else self.before
        last = self.times[-1] if self.after is None else self.after
        return max(float(last - first), 1.0)

    def waves(self) -> np.ndarray:
        """(n, WAVES) the waves at its tokens."""
        if self.before is None:  # time runs from the key backwards
            u = ((self.times[-1] if self.after is None else self.after) - self.times) / self.length
        else:
            u = (self.times - self.before) / self.length
        number = np.arange(1, WAVES + 1) - (0.5 if self.open else 0.0)
        return np.sin(np.pi * u[:, None] * number)

    def features(self) -> np.ndarray:
        """(FEATURES,) that the residual's scale depends on: 1, `lone`, the logarithms of the length and of the speed
        of the fill's latents."""
        steps = np.diff(self.latents, axis=0) / np.diff(self.path_times)[:, None]
        speed = np.sqrt(np.square(steps).mean()) if len(steps) else 0.0
        return np.array([1.0, self.lone, np.log(self.length), np.log(max(float(speed), _LEAST_SPEED))])


@dataclass(frozen=True)
class Variation:
    """The distribution of residuals.

    directions: (R, D) unit vectors E.
    factor:     (WAVES, R + 3, M) F: coefficients of the directions, and metres of the centroid, at a scale of 1.
    scale:      (2, FEATURES) weights of log s, for gaps between two keys and for gaps with one.
    digest:     of the encoder whose latents these are.
    """

    directions: np.ndarray
    factor: np.ndarray
    scale: np.ndarray
    digest: str

    def draw(self, gap: GapPath, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """A residual of the gap's n tokens: latents (n, D), and centroids (n, 3), metres; float32."""
        drawn = self.factor @ rng.standard_normal(self.factor.shape[-1])
        size = np.exp(self.scale[int(gap.open)] @ gap.features())
        values = size * (gap.waves() @ drawn)
        latents = values[:, :-CENTROID] @ self.directions
        return latents.astype(np.float32), values[:, -CENTROID:].astype(np.float32)


def write_variation(path: Path, variation: Variation, about: dict[str, object]) -> None:
    """Write it as JSON; `about` states what it was measured on."""
    content: dict[str, object] = {"version": VERSION, "encoder_digest": variation.digest, "about": about}
    content |= {
        name: np.round(np.asarray(getattr(variation, name), np.float64), _DECIMALS).tolist()
        for name in ("directions", "factor", "scale")
    }
    write_output(path, (json.dumps(content) + "\n").encode("utf-8"))


def variation_of(models: Models) -> Variation:
    """The variation beside loaded models. Raises as `read_variation`."""
    coder = models.autoencoder
    return read_variation(models.name, coder.encoder.latent_width, coder.digest)


def read_variation(weights: str | Path, width: int, digest: str) -> Variation:
    """The variation beside some weights.

    Args:
        width: of the latents. digest: of the weights' autoencoder.

    Raises: InputError if there is none, if it is damaged, or if it was measured with another autoencoder.
    """
    path = weights_folder(weights) / VARIATION_NAME
    if not path.is_file():
        raise InputError(
            f"The weights {weights} do not hold how motions vary, so they give one fill alone.",
            "Use other weights, or measure it with `pumps weights vary`.",
        )
    with reading(path):
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict) or content.get("version") != VERSION:
            raise ValueError("it is of another version")
        directions, factor, scale = (
            np.asarray(content.get(name), np.float64) for name in ("directions", "factor", "scale")
        )
        fits = directions.ndim == 2 and directions.shape[1] == width and factor.ndim == 3
        fits = fits and factor.shape[:2] == (WAVES, len(directions) + CENTROID) and scale.shape == (2, FEATURES)
        if not fits or not all(np.isfinite(each).all() for each in (directions, factor, scale)):
            raise ValueError("its numbers do not fit the weights")
        found = str(content.get("encoder_digest"))
    if found != digest:
        raise InputError(
            f"{path} was measured with another autoencoder than the one beside it.", "Run `pumps weights vary` again."
        )
    return Variation(directions, factor, scale, digest)
