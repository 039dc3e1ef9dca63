"""The page: whole, self-contained, and true to the motions and figures it was given."""

from __future__ import annotations

import base64
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.checkpoint import write_checkpoint
from data_schemas.errors import InputError, PumpsError, UsageError
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import ClipRow, MotionWriter
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.trainings import TrainedArchive, TrainingData
from stages.report.config import Config
from stages.report.curves import curves_html
from stages.report.results import results_html, table_html
from stages.report.run import run
from stages.report.scenes import slerped
from stages.shared.kinematics.forward import positions_of
from stages.shared.statistics.method_notes import MeasuredWeights, MethodFacts
from stages.shared.statistics.table import Entry, Row, Table
from stages.shared.statistics.tables import cells, overview_tables
from tests.report.pages import bvh_text, parsed


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    (folder / "walk.bvh").write_text(bvh_text())
    log = [{"step": s, "seconds": s / 10, "split": "train", "loss": 9.0 / s} for s in range(1, 400)]
    log += [{"step": s, "seconds": s / 10, "split": "val", "loss": 12.0 / s} for s in range(100, 400, 100)]
    with write_artefact(folder / "ae", "checkpoint", stage="train-ae", config={}, licences=["CC <NC>"]) as draft:
        weights = {"w": np.zeros(1, np.float32)}
        write_checkpoint(draft.folder, weights=weights, config={}, optimiser=None, log=log, card="")
    with write_artefact(folder / "metrics", "metrics", stage="evaluate", config={}) as draft:
        both = (("slerp", 0.5), ("ours", 0.4))
        rows = [
            MetricRow(f"c{clip}", "s", "set", method, "interpolation", 15, "l2p_m", value + 0.001 * clip)
            for method, value in both
            for clip in range(3)
        ]
        write_metrics(draft.folder, rows, "# Evaluation")
    return folder


def points_of(motion: dict) -> np.ndarray:
    raw = np.frombuffer(base64.b64decode(motion["points"]), "<i2")
    return raw.reshape(motion["frames"], motion["nodes"], 3) * motion["scale"]


def test_the_page_is_whole_and_loads_nothing(made: Path, tmp_path: Path) -> None:
    output = tmp_path / "deep" / "report.html"
    motions = (f"truth={made / 'walk.bvh'}", f"PUMPS={made / 'walk.bvh'}")
    report = run(Config(metrics=made / "metrics", checkpoints=(made / "ae",), motions=motions, output=output))
    page, scenes, text = parsed(output)
    assert page.loads == []
    assert not re.search(r"url\(|@import|import\(|fetch\(|XMLHttpRequest|https?://", text)
    assert [m["name"] for m in scenes[0]["motions"]] == ["truth", "slerp", "PUMPS"]
    assert scenes[0]["keys"] == [0, 15, 30, 40]
    assert '<span class="better">×0.80*</span>' in text
    assert "CC &lt;NC&gt;" in text and "Training: ae" in text and "polyline" in text
    assert report.figures["scenes"] == 1
    assert [path.name for path in output.parent.iterdir()] == ["report.html"]


def test_positions_are_those_of_forward_kinematics(made: Path, tmp_path: Path) -> None:
    output = tmp_path / "r.html"
    run(Config(motions=(f"truth={made / 'walk.bvh'}",), output=output))
    _, scenes, _ = parsed(output)
    truth = scenes[0]["motions"][0]
    points = points_of(truth)
    steps = np.diff(points[:, truth["root"]], axis=0)
    np.testing.assert_allclose(steps, np.broadcast_to([0.02, 0, 0], steps.shape), atol=3e-4)
    lengths = [np.linalg.norm(points[:, b] - points[:, a], axis=1) for a, b, *_ in truth["edges"]]
    np.testing.assert_allclose([np.ptp(each) for each in lengths], 0, atol=5e-4)
    assert sum(edge[4] for edge in truth["edges"]) == 1  # one head
    assert scenes[0]["floor"] == pytest.approx(0.0, abs=0.15)
    assert scenes[0]["height"] > 1.0


def test_slerp_meets_its_keys_and_only_them() -> None:
    skeleton = Skeleton(
        ("a", "b"), np.array([-1, 0], np.int32), np.array([[0, 0, 0], [0, 1.0, 0]]), np.ones((2, 3)) * 0.1,
        np.zeros(2, np.int8), np.ones(2, bool), 0,
    )  # fmt: skip
    t = np.arange(31)
    turns = Rotation.from_rotvec(np.stack([np.sin(t / 3), 0 * t, 0.05 * t], 1)).as_quat().astype(np.float32)
    motion = Motion(np.stack([turns, turns], 1), np.outer(t**2, [0.01, 0, 0]).astype(np.float32), 30.0)
    keys = np.array([0, 10, 30])
    made, true = (positions_of(skeleton, m) for m in (slerped(skeleton, motion, keys), motion))
    np.testing.assert_allclose(made[keys], true[keys], atol=1e-5)
    assert np.abs(made - true)[15].max() > 0.05


def test_artefacts_give_a_scene_for_each_shared_clip(tmp_path: Path) -> None:
    skeleton = Skeleton(
        ("hips", "tip"), np.array([-1, 0], np.int32), np.array([[0, 0, 0], [0, 1.0, 0]]), np.ones((2, 3)) * 0.1,
        np.zeros(2, np.int8), np.ones(2, bool), 0,
    )  # fmt: skip
    still = np.tile(np.array([0, 0, 0, 1], np.float32), (50, 2, 1))
    for folder, clips in (("truth", ["a", "b", "set.c"]), ("made", ["b", "set.c"])):
        with (
            write_artefact(tmp_path / folder, "motion", stage="ingest", config={}, licences=["CC <NC>"]) as draft,
            MotionWriter(draft.folder) as writer,
        ):
            name = writer.add_skeleton(skeleton)
            for clip in clips:
                row = ClipRow(clip, f"{clip}.bvh", "0" * 64, name, 50, 30.0, 50 / 30, "test", "")
                writer.add_clip(row, Motion(still, np.zeros((50, 3), np.float32), 30.0))
    both = (f"truth={tmp_path / 'truth'}", f"made={tmp_path / 'made'}")
    run(Config(motions=both, output=tmp_path / "r.html", slerp=False, max_seconds=1))
    _, scenes, text = parsed(tmp_path / "r.html")
    assert "2 motion artefacts, written by ingest" in text and "CC &lt;NC&gt;" in text  # where they come from
    assert 'id="results"' not in text
    assert [scene["name"] for scene in scenes] == ["b", "set.c"]
    assert [m["name"] for m in scenes[0]["motions"]] == ["truth", "made"]
    assert scenes[0]["motions"][0]["frames"] == 31
    in_set = tuple(f"set/{text}" for text in both)
    run(Config(motions=in_set, output=tmp_path / "r.html", slerp=False, overwrite=True))
    assert [scene["name"] for scene in parsed(tmp_path / "r.html")[1]] == ["set: b", "set: c"]


def test_hostile_names_stay_text(made: Path, tmp_path: Path) -> None:
    config = Config(
        motions=(f"</script><script>alert(1)</script>x={made / 'walk.bvh'}",),
        title="<img src=x onerror=alert(1)>",
        output=tmp_path / "r.html",
    )
    run(config)
    page, scenes, text = parsed(config.output)
    assert scenes[0]["motions"][0]["name"].startswith("script>") or "alert(1)" in scenes[0]["name"]
    assert "<script>alert" not in text and "<img" not in text
    assert page.loads == []


def test_clear_errors(made: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nothing to report"):
        run(Config(output=tmp_path / "r.html"))
    with pytest.raises(UsageError, match="NAME=PATH"):
        run(Config(motions=("walk.bvh",), output=tmp_path / "r.html"))
    with pytest.raises(InputError, match="cannot be read"):
        run(Config(motions=("truth=absent.bvh",), output=tmp_path / "r.html"))
    with pytest.raises(InputError, match="does not exist"):
        run(Config(metrics=tmp_path / "absent", output=tmp_path / "r.html"))
    with pytest.raises(InputError, match="frames 0 to 40"):
        run(Config(motions=(f"t={made / 'walk.bvh'}",), keyframes="0,99", output=tmp_path / "r.html"))
    (tmp_path / "file").write_text("")
    with pytest.raises(PumpsError, match="cannot be written"):
        run(Config(metrics=made / "metrics", output=tmp_path / "file" / "r.html"))


def test_curves_of_odd_logs() -> None:
    assert "no curves" in curves_html([])
    assert "no curves" in curves_html([{"step": 1, "loss": 2.0}])
    flat = [{"step": s, "split": "val", "loss": 0.0} for s in (1, 2, 3)]
    assert "polyline" in curves_html(flat)
    nan = [{"step": s, "split": "train", "loss": float("nan")} for s in (1, 2, 3)]
    assert "no curves" in curves_html(nan)
    negative = [{"step": s, "split": "train", "loss": -1.0 / s} for s in range(1, 9)]
    assert "NaN" not in curves_html(negative) and "nan" not in curves_html(negative)


def test_a_table_in_html() -> None:
    rows = (
        Row(("L2P", "<ours>"), (Entry("0.4", "[0.3, 0.5]", "×0.80*", "better"), Entry())),
        Row(("", "a|b"), (Entry("0.5", ratio="×1.00", verdict="same"), Entry("0.6", ratio="×1.2*", verdict="worse"))),
        Row(("L2Q", "ours"), (Entry("1"), Entry("2"))),
    )
    text = table_html(Table(("metric", "method"), ("15", "30"), rows))
    best = '<td class="number">0.4 <small>[0.3, 0.5]</small> <span class="better">×0.80*</span></td>'
    assert f"<td>L2P</td><td>&lt;ours&gt;</td>{best}" in text
    assert '<td class="number"></td>' in text and '<span class="worse">×1.2*</span>' in text and "a|b" in text
    assert text.count('<tr class="group">') == 1 and '<tr class="group"><td>L2Q' in text
    assert '<th>method</th><th class="number">15</th>' in text


def test_results_come_from_rows_and_the_manifest_alone(tmp_path: Path) -> None:
    rows = [
        MetricRow(f"c{clip}", "s", archive, method, "interpolation", 15, metric, value + 0.01 * clip)
        for archive in ("one", "two")
        for clip in range(3)
        for method, value in (("slerp", 1.0), ("mine", 0.5))
        for metric in ("l2p_m", "mpjpe_mm", "foot_skate_mps")
    ]
    data = TrainingData(clips=3, seconds=3600.0, skeletons=1, archives=[TrainedArchive(name="walks, <slow>.zip")])
    weights = [MeasuredWeights(name="mine", source="runs/a`b", data=data)]
    facts = MethodFacts(weights=weights, breakdown=True, borrowed_statistics=["abc"]).model_dump()
    settings = {"splits": ["test"], "max_windows": 4, "where": None}
    with write_artefact(tmp_path / "m", "metrics", stage="evaluate", config=settings) as draft:
        write_metrics(draft.folder, rows, "# A page\n\nthat nobody reads | here")
        draft.summary |= facts
    text = results_html(open_artefact(tmp_path / "m", "metrics"))
    assert "nobody reads" not in text and "6 clips on 1 skeleton, measured by evaluate. Methods: slerp, mine." in text
    assert "<code>mine</code>: weights <code>runs/a`b</code>, trained on 3 clips, 1.00 hours" in text
    assert "walks, &lt;slow&gt;.zip" in text and "<code>solve-true-cloud</code>" in text and "skeletons abc" in text
    shown = table_html(overview_tables(cells(rows))[0][1])
    assert shown in text and '<span class="better">×0.50*</span>' in text
    headings = ["<details><summary>one", "<details><summary>two", "<details open><summary>all archives"]
    assert [text.count(each) for each in headings] == [1, 1, 1]
    assert text.count("<h3>Feel</h3>") == 3 and text.count("<h3>Interpolation, frames between keys</h3>") == 3
    assert "<dt>splits</dt><dd>test</dd><dt>max_windows</dt><dd>4</dd><dt>where</dt><dd>none</dd>" in text


def test_metrics_of_other_stages_are_shown_by_their_own_names(tmp_path: Path) -> None:
    rows = [MetricRow(f"c{n}", "s", "set", "a network", "clouds", 24, "rec_mm", 10.0 + n) for n in range(3)]
    with write_artefact(tmp_path / "m", "metrics", stage="measure-ae", config={}) as draft:
        write_metrics(draft.folder, rows, "# A page")
    text = results_html(open_artefact(tmp_path / "m", "metrics"))
    assert "<h3>clouds</h3>" in text and "<td>rec_mm</td><td>a network</td>" in text
    assert '<td class="number">11.0 <small>[' in text and "as a share of" not in text


def test_damaged_facts_are_named(tmp_path: Path) -> None:
    with write_artefact(tmp_path / "m", "metrics", stage="evaluate", config={}) as draft:
        write_metrics(draft.folder, [MetricRow("c", "s", "a", "m", "interpolation", 15, "l2p_m", 0.4)], "# A page")
        draft.summary["weights"] = "all"
    with pytest.raises(InputError, match=r"manifest\.json is damaged"):
        results_html(open_artefact(tmp_path / "m", "metrics"))


BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.mark.skipif(BROWSER is None, reason="no browser here to run the page in")
def test_the_player_starts_in_a_browser(made: Path, tmp_path: Path) -> None:
    output = tmp_path / "r.html"
    run(Config(motions=(f"truth={made / 'walk.bvh'}", f"PUMPS={made / 'walk.bvh'}"), output=output))
    flags = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    done = subprocess.run(
        [str(BROWSER), *flags, "--dump-dom", f"file://{output}#frame=15"], capture_output=True, text=True, timeout=120
    )
    assert "<b>15</b> of 40" in done.stdout
    assert "<em>keyframe</em>" in done.stdout
    assert "slerp" in done.stdout and "PUMPS 0.0 mm" in done.stdout


def test_named_clip_rows_survive(made: Path, tmp_path: Path) -> None:
    config = Config(
        motions=(f"one/truth={made / 'walk.bvh'}", f"two/truth={made / 'walk.bvh'}"), output=tmp_path / "r"
    )
    run(replace_output(config, tmp_path / "r.html"))
    _, scenes, _ = parsed(tmp_path / "r.html")
    assert [scene["name"] for scene in scenes] == ["one", "two"]


def replace_output(config: Config, output: Path) -> Config:
    return config.model_copy(update={"output": output})


def test_tracks_move_in_slerp_too() -> None:
    skeleton = Skeleton(
        ("world", "hips"), np.array([-1, 0], np.int32), np.array([[0, 0, 0], [0, 1.0, 0]]), np.ones((2, 3)) * 0.1,
        np.array([-1, 0], np.int8), np.ones(2, bool), 1,
    )  # fmt: skip
    still = np.tile(np.array([0, 0, 0, 1], np.float32), (11, 2, 1))
    tracks = np.arange(11, dtype=np.float32)[:, None, None] ** 2 * [[[1, 0, 0]]]
    motion = Motion(still, np.zeros((11, 3), np.float32), 30.0, np.array([1], np.int32), tracks.astype(np.float32))
    made = slerped(skeleton, replace(motion), np.array([0, 10]))
    np.testing.assert_allclose(positions_of(skeleton, made)[:, 1, 0], np.arange(11) * 10, atol=1e-4)
