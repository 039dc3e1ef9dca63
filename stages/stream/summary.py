"""The page of a streaming experiment: errors and bytes, a part that is absent, advice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from data_schemas.metrics import MetricRow
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.table import Entry, Row, Table
from stages.stream.config import Config

ERROR, ANGLE, BYTES = "mpjpe_180_cm", "mpjae_deg", "bytes_per_second"
SEEN, UNSEEN = "all groups seen", "some groups absent"


def loss_task(loss: float) -> str:
    """The task of rows at a loss."""
    return f"loss {loss:g}"


def mean_of(rows: Sequence[MetricRow], method: str, task: str, metric: str) -> float:
    """The mean over clips, by their windows."""
    found = [(row.value, row.windows) for row in rows if (row.method, row.task, row.metric) == (method, task, metric)]
    values, counts = np.array(found, float).T
    return float(np.average(values, weights=counts))


def curves(rows: Sequence[MetricRow], methods: Sequence[str], losses: Sequence[float]) -> dict[str, list[float]]:
    """method -> MPJPE at each loss."""
    return {name: [mean_of(rows, name, loss_task(loss), ERROR) for loss in losses] for name in methods}


def summary_md(
    config: Config, rows: Sequence[MetricRow], sizes: Mapping[str, float], bodies: Sequence[str], notes: Sequence[str]
) -> str:
    """The whole page. sizes: method -> bytes a second. bodies: the methods that are bodies of parts."""
    losses = sorted(config.loss)
    lines = curves(rows, list(sizes), losses)
    heads = ("bytes a second", *(f"{100 * loss:g} %" for loss in losses))
    table = Table(
        ("sent as",),
        heads,
        tuple(
            Row(
                (name,),
                (
                    Entry(f"{sizes[name]:.0f}"),
                    *(
                        Entry(f"{value:.2f}", f"({mean_of(rows, name, loss_task(loss), ANGLE):.1f})")
                        for value, loss in zip(lines[name], losses, strict=True)
                    ),
                ),
            )
            for name in sizes
        ),
    )
    absent = ", ".join(group.replace("_", " ") for group in config.absent)
    apart = Table(
        ("sent as",),
        (SEEN, UNSEEN),
        tuple(
            Row((name,), tuple(Entry(f"{mean_of(rows, name, task, ERROR):.2f}") for task in (SEEN, UNSEEN)))
            for name in bodies
        ),
    )
    return "\n".join(
        [
            "# Streaming\n",
            f"Made by:\n\n```\n{command_line('pumps stream', config)}\n```\n",
            f"Packets are lost in runs of {config.burst:g} on average. A part's packet holds its latent of one "
            f"window, {config.bits} bits a number; a packet of rotations holds one pose, 4 bytes a joint; every "
            f"packet has {config.header_bytes} bytes more. What is lost is held. Means over clips and "
            f"{config.seeds} seeds.\n",
            *[f"- {note}" for note in notes],
            "\n## MPJPE in cm at 1.80 m (MPJAE in degrees) by the share of packets lost\n",
            *table.markdown(),
            f"\n## Without {absent}\n",
            "MPJPE in cm of the other body groups, without packet loss. Joints of the absent groups have the "
            "mean pose of the training.\n",
            *apart.markdown(),
            "\n## Advice\n",
            advice(lines, sizes, losses),
            "",
        ]
    )


def advice(lines: Mapping[str, Sequence[float]], sizes: Mapping[str, float], losses: Sequence[float]) -> str:
    """What the figures say: the best way without loss, with the most loss, and for the fewest bytes."""
    calm = min(lines, key=lambda name: lines[name][0])
    rough = min(lines, key=lambda name: lines[name][-1])
    small = min(sizes, key=lambda name: sizes[name])
    steady = min(lines, key=lambda name: lines[name][-1] - lines[name][0])
    worst = f"{100 * losses[-1]:g} %"
    return (
        f"At {100 * losses[0]:g} % loss take {calm} ({lines[calm][0]:.2f} cm, {sizes[calm]:.0f} bytes a second). At "
        f"{worst} loss take {rough} ({lines[rough][-1]:.2f} cm, {sizes[rough]:.0f} bytes a second). For the fewest "
        f"bytes take {small} ({sizes[small]:.0f} a second, {lines[small][0]:.2f} cm, {lines[small][-1]:.2f} at "
        f"{worst}). A part's packet can leave only when its window is over; rotations leave at once. "
        f"Loss costs {steady} least ({lines[steady][-1] - lines[steady][0]:.2f} cm)."
    )
