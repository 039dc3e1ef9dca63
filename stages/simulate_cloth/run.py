"""`pumps simulate-cloth`: a sheet of cloth on two pins, simulated many times, as mesh sequences."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import astuple

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import PumpsError
from data_schemas.mesh import MeshWriter
from data_schemas.skinned_body import Body, Topology
from stages.shared.contract import StageReport
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.threads import process_context
from stages.simulate_cloth.checks import ClothChecks, check_frames
from stages.simulate_cloth.config import Config
from stages.simulate_cloth.sheet import make_sheet
from stages.simulate_cloth.xpbd import ClothSolver, Settings, pins_of

_LICENCE = "CC0-1.0 (simulated)"
_BODY = "sheet"


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Write the mesh artefact `config.output`; its summary holds what the frames were checked for."""
    check_artefact(config, "mesh")
    began = time.monotonic()
    sheet = make_sheet(config.rows, config.size_m, seed=config.seed)
    frames = int(np.floor(config.seconds * config.fps + 1e-6))
    splits = _splits(config)
    found: list[ClothChecks] = []
    risen: list[float] = []
    with (
        write_artefact(config.output, "mesh", stage="simulate-cloth", config=config, licences=[_LICENCE]) as draft,
        MeshWriter(draft.folder, Topology(sheet.faces, len(sheet.vertices))) as writer,
    ):
        writer.add_body(_BODY, Body(sheet.vertices.astype(np.float32), np.zeros((0, 3))))
        progress.start("Simulating cloth", total=config.count)
        for start, made, checks, rise in _simulated(config, frames):
            found.append(checks)
            risen.append(rise)
            for offset, places in enumerate(made):
                number = start + offset
                row = ClipRow(
                    clip=f"cloth-{number:06d}", source=f"simulation {number}", sha256="", skeleton=_BODY,
                    frames=frames, fps=config.fps, seconds=frames / config.fps, split=splits[number],
                    licence=_LICENCE,
                )  # fmt: skip
                writer.add_dense(row, [places])
            progress.advance(len(made))
        worst = _worst(found)
        seconds = time.monotonic() - began
        draft.summary |= {
            "clips": config.count, "frames": config.count * frames, "greatest_strain": worst.strain,
            "nearest_m": worst.nearest_m, "pin_drift_m": worst.pin_drift_m,
            "energy_rise": max(risen),
        }  # fmt: skip
    rate = 3600 * config.count / seconds
    lines = [
        f"{config.count} simulations of {frames} frames in {seconds:.1f} s, {rate:.0f} an hour; "
        f"{len(sheet.vertices)} vertices.",
        f"Threads: strain {100 * worst.strain:.2f} % at most, {100 * worst.strain_99:.2f} % in 99 of 100. Nearest "
        f"vertices: {1e3 * worst.nearest_m:.1f} mm. Energy: rises between two frames by at most "
        f"{100 * max(risen):.2f} % of its whole fall.",
    ]
    figures = {
        "simulations": config.count, "seconds": seconds, "an_hour": rate, "strain": worst.strain,
        "strain_99": worst.strain_99, "nearest_m": worst.nearest_m, "energy_rise": max(risen),
    }  # fmt: skip
    return StageReport(output=config.output, lines=lines, figures=figures)


def _worst(found: list[ClothChecks]) -> ClothChecks:
    strain, most, shear, nearest, drift = (list(values) for values in zip(*map(astuple, found), strict=True))
    return ClothChecks(max(strain), max(most), max(shear), min(nearest), max(drift))


def _splits(config: Config) -> list[str]:
    """The split of each simulation: shuffled, with the shares of the config."""
    test, val = (round(share * config.count) for share in (config.test_share, config.val_share))
    names = ["test"] * test + ["val"] * val + ["train"] * (config.count - test - val)
    return [names[index] for index in np.random.default_rng((config.seed, 6)).permutation(config.count)]


def _simulated(config: Config, frames: int) -> Iterator[tuple[int, np.ndarray, ClothChecks, float]]:
    """Batches in order: first simulation, places (S, T, N, 3) float32, checks, energy's greatest rise."""
    starts = range(0, config.count, config.batch)
    if config.workers == 1:
        for start in starts:
            yield _batch(config, frames, start)
        return
    with _pool(config.workers) as pool:
        # No more are begun than are about to be written, so that memory is bounded.
        ahead = [pool.submit(_batch, config, frames, start) for start in starts[: config.workers + 1]]
        for start in starts[config.workers + 1 :]:
            yield ahead.pop(0).result()
            ahead.append(pool.submit(_batch, config, frames, start))
        for each in ahead:
            yield each.result()


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    pool = ProcessPoolExecutor(workers, process_context())
    try:
        yield pool
    except BrokenProcessPool:
        raise PumpsError(
            "A process that simulates died, perhaps for lack of memory.", "Lower --workers or --batch."
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _batch(config: Config, frames: int, start: int) -> tuple[int, np.ndarray, ClothChecks, float]:
    sheet = make_sheet(config.rows, config.size_m, seed=config.seed)
    pins = pins_of(sheet, config.count, config.seed)[start : start + config.batch]
    settings = Settings(1 / config.steps_per_second, config.iterations, config.thickness_m)
    solver = ClothSolver(sheet, pins, settings)
    energies, places = [], []
    for frame in solver.frames(frames, config.fps):
        energies.append(solver.energy())
        places.append(frame)
    made = np.stack(places, axis=1)
    levels = np.stack(energies)
    fallen = np.maximum(levels[0] - levels.min(axis=0), 1e-9)
    rise = float((np.diff(levels, axis=0) / fallen).max()) if len(levels) > 1 else 0.0
    return start, made.astype(np.float32), check_frames(made, sheet, pins, config.thickness_m), rise
