"""`pumps measure spectral`: predictions of mesh sequences against the truth, at the paper's times."""

from __future__ import annotations

import time
from collections import defaultdict

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.mesh import MeshReader
from data_schemas.metrics import MetricRow, write_metrics
from stages.measure.spectral.config import Config
from stages.measure.spectral.methods import TRUTH, MeshViews, Predicted, SpectralMethod, methods_of, true_window
from stages.measure.spectral.summary import MethodValues, summary_md, times_of
from stages.shared.contract import StageReport
from stages.shared.meshes.graph import edges_of
from stages.shared.meshes.measures import averaged_until, melv_mm, mpjpe_mm, rmse_share
from stages.shared.meshes.spectral_basis import compaction
from stages.shared.meshes.windows import MeshWindow, WindowList
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.statistics.tasks import PREDICTION

SIZES = (16, 32, 64, 128, 256, 512, 1024)  # numbers of coefficients whose error is shown
_MESHES = 24  # over which it is taken
METRICS = {"mpjpe": "mpjpe_mm", "until": "mpjpe_until_mm", "melv": "melv_mm", "rmse": "rmse_share"}


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Measure every method on the same windows; write `metrics`.

    Raises: UsageError for two rows of one name; InputError for weights of other meshes, or if no clip of the splits
        is long enough.
    """
    check_artefact(config, "metrics")
    with MeshReader(config.mesh) as reader:
        methods, paths = methods_of(config, reader)
        held_out = [row for row in reader.clips if row.split in config.splits]
        if not held_out:
            raise InputError(f"{config.mesh} has no clips of {', '.join(config.splits)}.", "Give --splits.")
        listed = WindowList(held_out, config.known + config.ahead, config.stride)
        windows = listed.spread(config.max_windows or len(listed))
        rates = sorted({row.fps for row in listed.rows})
        if len(rates) > 1:
            raise InputError(f"The clips of {config.mesh} have several frame rates.", "Choose with --splits.")
        times, frames = times_of(config.ahead, rates[0])
        if not times:
            raise InputError(f"{config.ahead} frames at {rates[0]:g} a second reach none of the paper's times.")
        views, edges = MeshViews(reader, config), edges_of(reader.topology.faces)[0]
        values = {name: MethodValues() for name in methods}
        clips: dict[str, list[int]] = defaultdict(list)
        progress.start("Predicting windows", total=len(windows) * len(methods))
        for number, window in enumerate(windows):
            clips[window.clip].append(number)
            truth = _Truth(views, window, frames)
            for name, method in methods.items():
                began = time.perf_counter()
                made = method(views, window)
                if name != TRUTH:
                    values[name].seconds += time.perf_counter() - began
                _measure(values[name], made, truth, frames, edges, itself=name == TRUTH)
                progress.advance(1, name)
        rows = [
            MetricRow(
                clip, reader.row(clip).skeleton, reader.row(clip).archive or "", name, PREDICTION, int(frame) + 1,
                metric, float(np.stack(getattr(each, field))[numbers, at].mean()), windows=len(numbers),
            )
            for name, each in values.items()
            for field, metric in METRICS.items()
            if getattr(each, field)
            for clip, numbers in clips.items()
            for at, frame in enumerate(frames)
        ]  # fmt: skip
        meshes = np.concatenate([_last_known(views, each) for each in windows[:: -(-len(windows) // _MESHES)]])
        held = {
            name: compaction(each.weights.basis, meshes, SIZES)
            for name, each in methods.items()
            if isinstance(each, SpectralMethod)
        }
        inputs = [reader.artefact, *(open_artefact(path, "checkpoint") for path in paths)]
    summary = summary_md(values, times, len(windows), config.ahead, rates[0], held)
    with write_artefact(config.output, "metrics", stage="measure-spectral", config=config, inputs=inputs) as draft:
        draft.summary |= {"windows": len(windows), "clips": len(clips), "methods": [*methods]}
        write_metrics(draft.folder, rows, summary)
    return StageReport(
        output=config.output,
        lines=[*(line for line in summary.splitlines() if line), f"Full tables: {config.output}, summary.md."],
        figures={"windows": len(windows), "clips": len(clips), "methods": [*methods]},
    )


def _last_known(views: MeshViews, window: MeshWindow) -> np.ndarray:
    """(1, N, 3) metres."""
    stop = window.start + views.known
    return views.reader.vertices(window.clip, stop - 1, stop)


class _Truth:
    """joints, vertices: of the window at the measured frames. last: the last known mesh."""

    def __init__(self, views: MeshViews, window: MeshWindow, frames: np.ndarray):
        true = true_window(views, window)
        assert true.vertices is not None
        self.joints = true.joints
        self.vertices = true.vertices(frames)
        self.last = _last_known(views, window)[0]


def _measure(
    values: MethodValues, made: Predicted, truth: _Truth, frames: np.ndarray, edges: np.ndarray, *, itself: bool
) -> None:
    if made.joints is not None and truth.joints is not None and not itself:
        errors = mpjpe_mm(made.joints, truth.joints)
        values.mpjpe.append(errors[frames])
        values.until.append(averaged_until(errors)[frames])
    if made.vertices is None:
        return
    vertices = truth.vertices if itself else made.vertices(frames)
    values.melv.append(melv_mm(vertices, truth.last, edges))
    if not itself:
        values.rmse.append(rmse_share(vertices, truth.vertices))
