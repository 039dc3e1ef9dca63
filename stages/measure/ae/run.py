"""`pumps measure ae`: reconstruct held-out clouds with several autoencoders, and measure the errors."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from data_schemas.artefact import write_artefact
from data_schemas.manifest import open_artefact
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.skeleton import BODY_GROUPS
from data_schemas.tpc import TpcReader
from stages.measure.ae.config import Config
from stages.measure.ae.methods import load_methods
from stages.measure.ae.picture import Panel, cloud_picture
from stages.measure.ae.summary import REFERENCE, AutoencoderResults, summary_md, terminal_lines
from stages.shared.contract import StageReport
from stages.shared.inference.measured_clouds import MovingBones, draw_on_window, measured_windows, redraw_on_window
from stages.shared.inference.models import Autoencoder
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.outputs import check_artefact
from stages.shared.pointcloud.assignment import paired_difference
from stages.shared.pointcloud.reconstruction import chamfer_distance, distances, jerk, spread_ratios
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.archives import archive_of

TASK = "reconstruction"
PICTURE_POINTS = 256  # as in the paper; decoders can decode any number of points
_AT_ONCE = 16  # windows encoded in one call


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure every autoencoder on the same windows and draws, and two draws of the truth; write `metrics`.

    Raises:
        InputError: a checkpoint holds no autoencoder, or the tpc artefact no held-out rigid clip that is long enough.
        UsageError: two methods have the same name.
    """
    check_artefact(config, "metrics")
    methods = load_methods(config)
    frames = config.window or min(method.autoencoder.window for method in methods)
    points = config.points or min(method.autoencoder.points for method in methods)
    with TpcReader(config.tpc) as reader:
        windows = measured_windows(reader, config.splits, frames, config.max_windows)
        inputs = [reader.artefact, *(open_artefact(method.source, "checkpoint") for method in methods)]
    progress.start("reconstructing", len(windows) * (len(methods) + 1))
    truth, other, groups = _draws(windows, points, config)
    shown = _shown(windows, config.pictures)
    scenes = [windows[index] for index in shown]
    dense, dense_other, dense_groups = _draws(scenes, PICTURE_POINTS, config) if scenes else (truth, other, groups)
    drawn = {"truth": dense, "another draw": dense_other}
    tables = {REFERENCE: _measurements(other, truth, groups)}
    progress.advance(len(windows), REFERENCE)
    for method in methods:
        made = _reconstruct(method.autoencoder, windows, truth, groups, groups, config.seed)
        tables[method.name] = _measurements(made, truth, groups)
        if scenes:
            drawn[method.name] = _reconstruct(
                method.autoencoder, scenes, truth[shown], groups[shown], dense_groups, config.seed
            )
        progress.advance(len(windows), method.name)
    rows = [row for name, figures in tables.items() for row in _rows(name, windows, figures, frames)]
    measured = AutoencoderResults(config, methods, rows, frames, points, len(windows))
    with write_artefact(config.output, "metrics", stage="measure-ae", config=config, inputs=inputs) as draft:
        names = []
        for place, window in enumerate(scenes):
            names.append(f"clouds-{place + 1}.svg")
            panels = [Panel(name, clouds[place]) for name, clouds in drawn.items()]
            text = cloud_picture(panels, dense_groups[place], window.row.clip)
            (draft.folder / names[-1]).write_text(text, encoding="utf-8")
        draft.summary.update(windows=len(windows), methods=[method.name for method in methods])
        write_metrics(draft.folder, rows, summary_md(measured, names))
    return StageReport(
        output=config.output,
        lines=[*terminal_lines(measured), f"Full tables and pictures: {config.output}, summary.md."],
        figures={"windows": len(windows), "methods": [method.name for method in methods]},
    )


def _draws(windows: Sequence[MovingBones], points: int, config: Config) -> tuple[Tensor, Tensor, Tensor]:
    """Two independent draws (W, T, P, 3) of the windows' clouds with the same body groups (W, P)."""
    clouds, others, groups = [], [], []
    for window in windows:
        rng = np.random.default_rng(window.seed(config.seed))
        drawn = draw_on_window(window, points, rng, config.sigma_m)
        groups.append(drawn.groups)
        clouds.append(window.cloud(drawn))
        others.append(window.cloud(redraw_on_window(window, drawn.groups, rng, config.sigma_m)))
    return torch.stack(clouds), torch.stack(others), torch.stack(groups)


def _reconstruct(
    autoencoder: Autoencoder,
    windows: Sequence[MovingBones],
    truth: Tensor,
    groups: Tensor,
    wanted: Tensor,
    seed: int,
) -> Tensor:
    """Clouds (W, T, Q, 3) on the CPU, decoded from the latents of true ones (W, T, P, 3).

    Args: groups: (W, P) of the true points. wanted: (W, Q) body groups of the points to decode.
    """
    decoder, device, frames = autoencoder.decoder, autoencoder.device, truth.shape[1]
    times = torch.arange(frames, device=device, dtype=torch.float32).unsqueeze(0)
    # Drawn on the CPU, so that every device decodes the same points.
    seeds = [int(np.random.SeedSequence(window.seed(seed)).generate_state(1)[0]) for window in windows]
    noise = torch.stack([autoencoder.draw_noise(wanted.shape[1], each) for each in seeds]).to(device)
    made = []
    with torch.inference_mode():
        for start in range(0, len(windows), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            clouds, kinds = truth[part].to(device), groups[part].to(device)
            latents, centroids = autoencoder.encoder(clouds.flatten(0, 1), kinds.repeat_interleave(frames, 0))
            latents, centroids = latents.unflatten(0, (-1, frames)), centroids.unflatten(0, (-1, frames))
            made.append(decoder(latents, centroids, times, wanted[part].to(device), noise[part]).cpu())
    return torch.cat(made)


def _measurements(made: Tensor, truth: Tensor, groups: Tensor) -> dict[str, np.ndarray]:
    """Every metric of every window, (W,) each."""
    parts: dict[str, list[Tensor]] = defaultdict(list)
    for start in range(0, len(made), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        cloud, true, kinds = made[part], truth[part], groups[part]
        whole, moving, square = distances(paired_difference(cloud, true, kinds))
        spread = spread_ratios(cloud, true, kinds)
        parts["rec_mm"].append(1000 * whole)
        parts["rec_m2"].append(square)
        parts["moving_mm"].append(1000 * moving)
        parts["chamfer_mm"].append(1000 * chamfer_distance(cloud, true, kinds))
        parts["spread"].append(spread.nanmean(1))
        parts["jerk_ratio"].append(jerk(cloud, MODEL_FPS) / jerk(true, MODEL_FPS))
        for group, name in enumerate(BODY_GROUPS):
            parts[f"spread_{name}"].append(spread[:, group])
    return {name: torch.cat(values).double().numpy() for name, values in parts.items()}


def _rows(
    method: str, windows: Sequence[MovingBones], figures: dict[str, np.ndarray], frames: int
) -> Iterator[MetricRow]:
    by_clip: dict[str, list[int]] = defaultdict(list)
    for index, window in enumerate(windows):
        by_clip[window.row.clip].append(index)
    for metric, values in figures.items():
        for members in by_clip.values():
            known = [index for index in members if np.isfinite(values[index])]
            if known:
                row = windows[members[0]].row
                value = float(values[known].mean())
                place = (row.clip, row.skeleton, archive_of(row))
                yield MetricRow(*place, method, TASK, frames, metric, value, windows=len(known))


def _shown(windows: Sequence[MovingBones], count: int) -> list[int]:
    """The windows for the picture: as far apart in the list as possible, so from different archives."""
    return [int((2 * place + 1) * len(windows) / (2 * count)) for place in range(min(count, len(windows)))]
