"""Pages of filled windows: every method of every chosen window plays, with its strips and spectra."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.fills import FilledBatch, FillsWriter
from data_schemas.metrics import MetricRow, write_metrics
from stages.report.config import Config
from stages.report.filled_windows import FilledWindows, tasks_of
from stages.report.run import run
from stages.report.spectra import densities_of
from stages.shared.statistics.baselines import Poses, slerp
from stages.shared.statistics.measurements import TRUTH, measured_joints
from stages.shared.statistics.spectra import velocity_density
from stages.shared.statistics.windows import Task
from tests.evaluate.swaying import skeleton, swaying
from tests.report.pages import parsed

RIG = skeleton()
TASKS = [Task("interpolation", 15, 61), Task("interpolation", 30, 61), Task("transition", 15, 61)]


def kept(folder: Path, method: str, clips: tuple[str, ...] = ("a", "b", "<c>"), shift: float = 0.0) -> Path:
    """An evaluation of one method: slerp, some way off in the gaps."""
    with write_artefact(folder, "metrics", stage="evaluate", config={}, licences=["CC0"]) as draft:
        rows = [
            MetricRow(clip, "s", "set", name, task.name, task.interval, "l2p_m", 0.1 * task.interval)
            for clip in clips for task in TASKS for name in (method, "slerp")
        ]  # fmt: skip
        write_metrics(draft.folder, rows, "# It\n")
        with FillsWriter(draft.folder, 30.0) as fills:
            for task in TASKS:
                poses = Poses.of(RIG, [swaying(seed, task.frames) for seed in range(len(clips))])
                known = task.known(task.frames)
                batch = FilledBatch(0, "set", task.name, task.interval, "", clips, (5,) * len(clips), known)
                fills.begin(batch, RIG, poses.positions[:, 0, 1].numpy())
                fills.add(TRUTH, poses.positions.numpy(), poses.rotations.numpy())
                positions, rotations = slerp(poses, known)
                fills.add(method, positions + shift * ~known[None, :, None, None], rotations)
    return folder


@pytest.fixture(scope="module")
def evaluations(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("fills")
    return kept(folder / "one", "slerp"), kept(folder / "two", "<mine>", shift=0.25)


def test_the_page_plays_every_method_in_every_chosen_window(evaluations: tuple[Path, Path], tmp_path: Path):
    page = tmp_path / "page.html"
    run(Config(fills=evaluations, metrics=evaluations[0], max_windows=2, output=page, picture=tmp_path / "one.svg"))
    found, scenes, text = parsed(page)
    assert not found.loads and "<mine>" not in text and "<c>" not in text and "CC0" in text
    assert [scene["name"] for scene in scenes] == [
        f"set, {words}: {clip}, frames 5 to {last}"
        for words, last in (("keys every 15", 65), ("keys every 30", 65), ("gap of 15", 49))
        for clip in ("a", "<c>")
    ]
    for scene in scenes:
        truth, *others = scene["motions"]
        assert [motion["name"] for motion in scene["motions"]] == [TRUTH, "slerp", "<mine>"]
        assert all(motion["edges"] == truth["edges"] and motion["frames"] == truth["frames"] for motion in others)
        one, two = (
            np.frombuffer(base64.b64decode(m["points"]), "<i2").reshape(m["frames"], -1) * m["scale"] for m in others
        )
        away = np.abs(two - one)
        np.testing.assert_allclose(away[scene["keys"]], 0, atol=1e-3)
        gaps = np.setdiff1d(np.arange(truth["frames"]), scene["keys"])
        np.testing.assert_allclose(away[gaps], 0.25, atol=1e-3)
    assert text.count('<section id="spectra"') == text.count('<section id="strips"') == 1
    assert len(re.findall(r"mm from truth", text)) == 2 * 2  # two tasks, two methods
    assert (tmp_path / "one.svg").read_text().count("mm from truth") == 2


def test_spectra_are_means_over_all_windows(evaluations: tuple[Path, Path]):
    with FilledWindows(evaluations) as fills:
        tasks = list(tasks_of(fills))
        assert [(task, interval) for task, interval, _ in tasks] == [(t.name, t.interval) for t in TASKS]
        frequencies, densities = densities_of(fills, tasks[0][2])
    true = Poses.of(RIG, [swaying(seed, 61) for seed in range(3)]).positions.numpy()[:, :, measured_joints(RIG)]
    expected = velocity_density(true, 30.0)
    np.testing.assert_allclose(frequencies, expected[0])
    np.testing.assert_allclose(densities[TRUTH], expected[1].mean(axis=0), rtol=0.02, atol=1e-6)
    assert list(densities) == [TRUTH, "slerp", "<mine>"]


def test_other_windows_methods_that_come_twice_and_bare_evaluations_are_refused(evaluations, tmp_path: Path):
    other = kept(tmp_path / "other", "third", clips=("a", "b"))
    with pytest.raises(InputError, match="measured other windows than"):
        FilledWindows([evaluations[0], other])
    with pytest.raises(InputError, match="measures slerp again"):
        FilledWindows([evaluations[1], evaluations[0], evaluations[0]])
    with write_artefact(tmp_path / "bare", "metrics", stage="evaluate", config={}) as draft:
        write_metrics(draft.folder, [], "")
    with pytest.raises(InputError, match="keeps no filled windows"):
        run(Config(fills=(tmp_path / "bare",), output=tmp_path / "page.html"))
    with pytest.raises(UsageError, match="nothing to report"):
        run(Config(output=tmp_path / "page.html"))
    assert not (tmp_path / "page.html").exists()


def test_windows_in_which_nothing_moves_have_a_page(tmp_path: Path):
    with write_artefact(tmp_path / "still", "metrics", stage="evaluate", config={}) as draft:
        write_metrics(draft.folder, [], "# It\n")
        with FillsWriter(draft.folder, 30.0) as fills:
            one = Poses.of(RIG, [swaying(0, 1)])
            positions, rotations = (np.repeat(part.numpy(), 61, axis=1) for part in (one.positions, one.rotations))
            known = TASKS[0].known(61)
            fills.begin(FilledBatch(0, "set", "interpolation", 15, "", ("a",), (0,), known), RIG, positions[:, 0, 1])
            for method in (TRUTH, "slerp"):
                fills.add(method, positions, rotations)
    run(Config(fills=(tmp_path / "still",), output=tmp_path / "page.html"))
    _, scenes, text = parsed(tmp_path / "page.html")
    assert len(scenes) == 1 and '<section id="spectra"' in text
