"""The page of a measurement: MPJPE, acceleration error and angles by category."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from data_schemas.metrics import MetricRow
from stages.measure.denoise.config import Config
from stages.measure.denoise.methods import MEND, NOISY, TRUE_CLOUDS, TRUE_LATENTS
from stages.shared.inference.latent_denoiser import LatentDenoiser
from stages.shared.inference.pose_filling import Interpolator
from stages.shared.inference.pose_model import PoseModel
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.category_tables import table_of

METRICS = ("mpjpe_mm", "acceleration_mm", "mpjae_deg")
_TITLES = {
    "mpjpe_mm": "MPJPE, mm",
    "acceleration_mm": "Acceleration error, mm a frame^2",
    "mpjae_deg": "Angles, degrees",
}
_DECIMALS = 2
_OF_BREAKDOWN = (
    f" `{TRUE_LATENTS}`: mending, then what `--method latent` would do with the latents of the truth: the error of "
    f"autoencoder and solve. `{TRUE_CLOUDS}`: with the points of the truth: the error of the solve."
)


def summary_md(
    config: Config,
    rows: Sequence[MetricRow],
    trained: Mapping[str, PoseModel | LatentDenoiser | Interpolator],
    widths: Mapping[str, float],
) -> str:
    """The whole page."""
    windows = sum(row.windows for row in rows if row.method == NOISY and row.metric == METRICS[0])
    clips = len({row.clip for row in rows})
    parts = [
        "# Denoising (PUMPS Table 4)\n",
        f"Made by:\n\n```\n{command_line('pumps measure denoise', config)}\n```\n",
        f"{clips} clips, {windows} windows of {config.window} frames at 30 fps; noise: {config.noise}. All methods "
        "see the same noisy windows. Means over windows; of all clips with a 95% bootstrap interval over clips. "
        f"`{NOISY}`: nothing is done. `{MEND}`: `pumps denoise` without weights."
        + (_OF_BREAKDOWN if config.breakdown else "")
        + "\n",
        "\n".join(
            [f"- {name}: width {width:g}, the best of {len(config.widths)}." for name, width in widths.items()]
            + [
                f"- {name}: {sum(value.numel() for value in each.network.parameters()) / 1e6:.2f} M parameters, "
                f"trained on {each.trained_on}."
                for name, each in trained.items()
            ]
        ),
    ]
    for metric in METRICS:
        parts += [f"\n## {_TITLES[metric]}\n", *table_of(rows, metric, config.seed, _DECIMALS).markdown()]
    return "\n".join(parts) + "\n"


def terminal_lines(rows: Sequence[MetricRow], seed: int) -> list[str]:
    """One line a method: MPJPE and acceleration error over all clips."""
    tables = [table_of(rows, metric, seed, _DECIMALS) for metric in METRICS[:2]]
    return [
        f"{one.labels[0]:16} MPJPE {one.entries[-1].text} mm, acceleration {other.entries[-1].text} mm a frame^2"
        for one, other in zip(tables[0].rows, tables[1].rows, strict=True)
    ]
