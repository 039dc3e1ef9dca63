"""Which clips are picked to be filled, and that they come out byte for byte."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from stages.data.pick.config import Config
from stages.data.pick.run import pick, run
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"


def row(clip: str, **changes: object) -> ClipRow:
    """A clip of the test split, four seconds long, with changes."""
    values = {
        "source": f"{clip}.bvh", "sha256": "", "skeleton": "s", "frames": 120, "fps": 30.0, "seconds": 4.0,
        "split": "test", "licence": "", "flags": "",
    }  # fmt: skip
    return ClipRow(clip=clip, **{**values, **changes})  # type: ignore[arg-type]


def picked(rows: list[ClipRow], **settings: object) -> list[str]:
    """Names of the clips that are picked."""
    return [each.clip for each in pick(rows, Config(motion=Path("m"), output=Path("o"), **settings))]  # type: ignore[arg-type]


def test_only_the_wanted_split_and_count():
    rows = [row("d"), row("c", split="train"), row("b"), row("a", split="val")]
    assert picked(rows) == ["b", "d"]
    assert picked(rows, count=1) == ["b"]
    assert picked(rows, splits=("train", "val")) == ["a", "c"]


def test_archives_and_skeletons_take_turns():
    rows = [row(f"a{n}", source=f"one.zip!a{n}.bvh") for n in range(5)] + [row("z", source="two.zip!z.bvh")]
    assert picked(rows, count=3) == ["a0", "z", "a1"]


def test_handy_clips_come_first():
    rows = [row("a", seconds=300.0), row("b", seconds=1.0), row("c", flags="unit-uncertain trimmed"), row("d")]
    assert picked(rows) == ["d", "a", "b"]
    rows += [row("e", flags="unit-uncertain")]  # ingest needs no option for it
    assert picked(rows) == ["d", "e", "a"]


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("picking") / "ingest"
    sources = tuple(str(CLIPS / f"{name}.bvh") for name in ("jump", "kick", "walk"))
    ingest(IngestConfig(sources=sources, splits=CLIPS / "splits.json", output=output, workers=1))
    return output


def test_files_come_out_as_they_were_and_stale_ones_go(motion: Path, tmp_path: Path):
    run(Config(motion=motion, output=tmp_path / "picked"))
    with pytest.raises(UsageError, match="exists"):
        run(Config(motion=motion, output=tmp_path / "picked"))
    found = {path.name: path.read_bytes() for path in (tmp_path / "picked").glob("*.bvh")}
    assert sorted(found.values()) == sorted((CLIPS / f"{name}.bvh").read_bytes() for name in ("jump", "kick"))
    report = run(Config(motion=motion, output=tmp_path / "picked", count=1, overwrite=True))
    kept = [f"{name}.bvh" for name in report.figures["clips"]]
    assert (tmp_path / "picked" / "clips.txt").read_text().splitlines() == kept
    assert [path.name for path in (tmp_path / "picked").glob("*.bvh")] == kept
    assert report.figures["removed"] == sorted({*found} - {*kept})


def test_no_file_goes_that_pumps_did_not_write(motion: Path, tmp_path: Path):
    """Files that a list names, a clip that was edited, a link in its place, paths out of the folder."""
    folder = tmp_path / "picked"
    first = run(Config(motion=motion, output=folder))
    (kept,) = run(Config(motion=motion, output=tmp_path / "one", count=1)).figures["clips"]
    (edited,) = {*first.figures["clips"]} - {kept}
    (folder / f"{edited}.bvh").write_text("edited by hand")
    (tmp_path / "outside.bvh").write_text("mine")
    (folder / "mine.bvh").write_text("mine")
    (folder / "target.bvh").write_text("mine")
    (folder / "link.bvh").symlink_to("target.bvh")
    digest = hashlib.sha256(b"mine").hexdigest()
    with open(folder / ".clips.sha256", "a") as digests:
        digests.write(f"{digest}  ../outside.bvh\n{digest}  {tmp_path}/outside.bvh\n{digest}  link.bvh\n")
    with open(folder / "clips.txt", "a") as names:
        names.write("mine.bvh\n../outside.bvh\n")
    report = run(Config(motion=motion, output=folder, count=1, overwrite=True))
    assert report.figures["removed"] == []
    assert (folder / f"{edited}.bvh").read_text() == "edited by hand"
    assert (tmp_path / "outside.bvh").read_text() == (folder / "mine.bvh").read_text() == "mine"
    assert (folder / "link.bvh").is_symlink()
    assert f"{edited}.bvh" in report.lines[1] and "mine.bvh" in report.lines[1] and "outside" not in report.lines[1]


def test_no_clip_of_the_split_is_bad_input(motion: Path, tmp_path: Path):
    with pytest.raises(InputError, match="val"):
        run(Config(motion=motion, output=tmp_path, splits=("val",)))
