"""The stage on a small artefact: a perfect decoder has no error, rows are told by settings, their order is judged."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.artefact import open_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import MetricRow, read_metrics
from stages.measure.ae import run as stage
from stages.measure.ae.config import Config
from stages.measure.ae.methods import FULL, PAPER, SKINNING, Method, change_of
from stages.measure.ae.picture import Panel, cloud_picture
from stages.measure.ae.run import run
from stages.measure.ae.summary import REFERENCE, AutoencoderResults, paper_pairs, summary_md
from stages.shared.inference.models import Autoencoder, load_autoencoder
from stages.shared.networks.layers.sizes import DecoderSizes, EncoderSizes
from stages.train.ae.config import Config as TrainConfig
from stages.train.ae.run import run as train
from tests.shared.training.tiny_clouds import write_clouds

ENCODER = EncoderSizes(width=4, blocks=2, neighbours=4, heads=2)
DECODER = {"width": 16, "layers": 1, "heads": 2, "noise": 4, "point_width": 8, "point_hidden": 8}
ROWS = {
    "full": {}, "element": {"dropout_kind": "element"}, "sinusoidal": {"positions": "sinusoidal"},
    "chamfer": {}, "vae": {"identities": "vae"}, "grid": {"identities": "grid"}, "skinning": {"head": "skinning"},
}  # fmt: skip


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A tpc artefact and all rows of the table, trained for a step each."""
    folder = tmp_path_factory.mktemp("measure_ae")
    places = {"tpc": write_clouds(folder / "tpc")}
    for name, choice in ROWS.items():
        places[name] = folder / name
        train(
            TrainConfig(
                tpc=places["tpc"], output=places[name], encoder=ENCODER, steps=1, batch=2, window=8, points=24,
                decoder=DecoderSizes(**{**DECODER, **choice}), loss="chamfer" if name == "chamfer" else "assignment",
                device="cpu",
            )
        )  # fmt: skip
    return places


def config(trained: dict[str, Path], output: Path, *names: str, **more) -> Config:
    weights = tuple(f"{name}={trained[name]}" for name in names)
    return Config(tpc=trained["tpc"], weights=weights, output=output, splits=("val",), device="cpu", **more)


def test_every_row_of_the_table_is_measured_and_known_for_what_it_is(trained, tmp_path):
    report = run(config(trained, tmp_path / "out", *ROWS, max_windows=3))
    rows, summary = read_metrics(tmp_path / "out")
    assert {row.method for row in rows} == {REFERENCE, *ROWS}
    assert {row.metric for row in rows} >= {"rec_mm", "rec_m2", "moving_mm", "chamfer_mm", "spread", "jerk_ratio"}
    assert all(np.isfinite(row.value) for row in rows)
    assert f"| full | {FULL} |" in summary and f"| {PAPER[FULL]:.4f} |" in summary
    assert f"| skinning | {SKINNING} |" in summary
    told = {m.name: m.change for m in stage.load_methods(config(trained, tmp_path, *ROWS))}
    assert set(told.values()) == {*PAPER, SKINNING} and told["full"] == FULL
    assert told["vae"].startswith("VAE") and told["grid"].startswith("2D grid") and "Chamfer" in told["chamfer"]
    assert "Of 15 pairs" in report.lines[-2] and "Of 15 pairs" in summary
    drawn = sorted(path.name for path in open_artefact(tmp_path / "out").folder.glob("*.svg"))
    assert drawn == ["clouds-1.svg", "clouds-2.svg"] and all(name in summary for name in drawn)


def test_the_same_command_gives_the_same_bytes(trained, tmp_path):
    for name in ("one", "two"):
        run(config(trained, tmp_path / name, "full", max_windows=2))
    first, second = (open_artefact(tmp_path / name).manifest for name in ("one", "two"))
    figures = [{k: v for k, v in m.files.items() if k != "summary.md"} for m in (first, second)]
    assert figures[0] == figures[1]


def test_what_gives_back_the_cloud_it_was_given_has_no_error(trained, tmp_path, monkeypatch):
    def perfect(autoencoder, windows, truth, groups, wanted, seed):
        return truth.clone()

    monkeypatch.setattr(stage, "_reconstruct", perfect)
    run(config(trained, tmp_path / "out", "full", pictures=0))
    rows, _ = read_metrics(tmp_path / "out")
    mean = {metric: np.mean([r.value for r in rows if r.method == "full" and r.metric == metric])
            for metric in ("rec_mm", "moving_mm", "chamfer_mm", "spread", "jerk_ratio")}  # fmt: skip
    assert mean["rec_mm"] == mean["moving_mm"] == 0 and mean["chamfer_mm"] < 2
    assert mean["spread"] == pytest.approx(1) and mean["jerk_ratio"] == pytest.approx(1)
    reference = [r.value for r in rows if r.method == REFERENCE and r.metric == "rec_mm"]
    assert min(reference) > 50, "two draws of the truth are far apart, and that is not an error"


def test_encoding_in_a_batch_is_encoding_one_by_one(trained):
    autoencoder: Autoencoder = load_autoencoder(trained["full"], "cpu")
    given = config(trained, Path("unused"), "full", max_windows=2)
    with stage.TpcReader(given.tpc) as reader:
        windows = stage.measured_windows(reader, ("val",), 8, 2)
    truth, other, groups = stage._draws(windows, 24, given)
    assert not torch.equal(truth, other)
    made = stage._reconstruct(autoencoder, windows, truth, groups, groups, 0)
    for index, window in enumerate(windows):
        latents, centroids = autoencoder.encode(truth[index], groups[index])
        seed = int(np.random.SeedSequence(window.seed(0)).generate_state(1)[0])
        alone = autoencoder.decode(
            latents, centroids, torch.arange(8.0), groups[index], autoencoder.draw_noise(24, seed)
        )
        torch.testing.assert_close(made[index], alone, atol=1e-4, rtol=1e-4)


def fake(levels: dict[str, float]) -> AutoencoderResults:
    """Rows of six clips at given levels of L_rec, with a little of each clip's own."""
    methods = [Method(words, Path(), None, words, {}, 0, 0.0) for words in levels]  # type: ignore[arg-type]
    rows = [
        MetricRow(f"clip{clip}", "s", "a", words, "reconstruction", 8, metric, level * (1 + 0.02 * clip))
        for words, level in levels.items()
        for clip in range(6)
        for metric in ("rec_m2", "rec_mm")
    ]
    given = Config(tpc=Path("t"), weights=(), output=Path("o"))
    return AutoencoderResults(given, methods, rows, 8, 24, 6)


def test_the_papers_order_is_judged_by_the_figures():
    assert {pair.verdict for pair in paper_pairs(fake(PAPER))} == {"as in the paper"}
    assert "order of rows holds" in summary_md(fake(PAPER), [])
    backward = fake({words: 1 / level for words, level in PAPER.items()})
    assert {pair.verdict for pair in paper_pairs(backward)} == {"the other way round"}
    assert "does not hold" in summary_md(backward, [])
    level = fake(dict.fromkeys(PAPER, 0.01))
    assert {pair.verdict for pair in paper_pairs(level)} == {"not told apart"}
    ours = fake({FULL: 0.01, SKINNING: 0.001})
    assert not paper_pairs(ours) and "paper's order" not in summary_md(ours, [])


def test_several_changes_are_no_row_of_the_paper():
    assert change_of({"decoder": {}, "loss": "assignment"}) == FULL
    both = change_of({"decoder": {"positions": "sinusoidal"}, "loss": "chamfer"})
    assert both == "sinusoidal positions, Chamfer objective" and both not in PAPER


def test_pictures_are_small_and_hold_every_point():
    points = torch.randn(9, 60, 3, generator=torch.Generator().manual_seed(0))
    groups = torch.arange(60) % 5
    text = cloud_picture([Panel("a <b>", points), Panel("c", points + 0.1)], groups, "x & y")
    root = ET.fromstring(text)
    dots = [e.get("d", "") for e in root.iter("{http://www.w3.org/2000/svg}path")]
    assert sum(d.count("M") for d in dots) == 2 * 3 * 60
    assert len(text) < 40_000


def test_what_cannot_be_measured_is_said(trained, tmp_path):
    with pytest.raises(UsageError, match="called 'full'"):
        run(config(trained, tmp_path / "x", "full", "full"))
    with pytest.raises(InputError, match="no rigid clip of 5000 frames"):
        run(config(trained, tmp_path / "x", "full", window=5000))
    with pytest.raises(InputError):
        run(Config(tpc=trained["tpc"], weights=(f"a={trained['tpc']}",), output=tmp_path / "x", splits=("val",)))
    assert not (tmp_path / "x" / "manifest.json").exists()
