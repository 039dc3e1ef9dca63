"""A bad file is skipped with its reason and counted; the others are read, and only what is read is hashed."""

from __future__ import annotations

import os
import signal
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest

from data_schemas.artefact import open_artefact
from data_schemas.errors import InputError
from data_schemas.source_table import read_sources
from stages.ingest import inputs
from stages.ingest.config import Config
from stages.ingest.run import run
from stages.shared.formats import reading
from stages.shared.formats.reading import Job, read_all
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import Source
from tests.shared.formats.bvh_texts import BvhText


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with two good clips."""
    (tmp_path / "takes").mkdir()
    for name, seed in (("a", 1), ("z", 2)):
        (tmp_path / "takes" / f"{name}.bvh").write_bytes(BvhText(frames=30, seed=seed).data())
    return tmp_path / "takes"


def _outcomes(folder: Path, output: Path, **settings) -> dict[str, tuple[str, str]]:
    run(Config(sources=(str(folder),), output=output, **settings))
    rows = read_sources(open_artefact(output).folder)
    return {Path(row.source).name: (row.outcome, row.reason) for row in rows}


def _last_row_with(text: BvhText, number: str) -> bytes:
    lines = text.text().rstrip("\n").split("\n")
    lines[-1] = " ".join([number, *lines[-1].split()[1:]])
    return ("\n".join(lines) + "\n").encode()


@pytest.mark.parametrize("number", ["1e41", "-1e41", "1e300", "nan", "inf"])
def test_numbers_that_no_motion_can_hold_cost_their_own_file_only(folder, tmp_path, number):
    (folder / "m.bvh").write_bytes(_last_row_with(BvhText(frames=30, seed=3), number))
    found = _outcomes(folder, tmp_path / "motion")
    assert (found["a.bvh"][0], found["z.bvh"][0], found["m.bvh"][0]) == ("kept", "kept", "skipped")
    assert "m.bvh" in found["m.bvh"][1]


@pytest.mark.parametrize(
    "fault", [ZeroDivisionError("division by zero"), RecursionError(), MemoryError(), KeyError(3)]
)
def test_a_reader_that_fails_costs_its_own_file_only(folder, tmp_path, monkeypatch, fault):
    real = reading.read_recordings

    def failing(data, source, chosen, asked):
        if source.name.endswith("z.bvh"):
            raise fault
        return real(data, source, chosen, asked)

    monkeypatch.setattr(reading, "read_recordings", failing)
    found = _outcomes(folder, tmp_path / "motion")
    assert found["a.bvh"][0] == "kept" and found["z.bvh"][0] == "skipped"
    assert ("memory" if isinstance(fault, MemoryError) else type(fault).__name__) in found["z.bvh"][1]
    report = run(Config(sources=(str(folder),), output=tmp_path / "again"))
    assert report.figures["files"] == {"kept": 1, "skipped": 1}


def test_a_file_that_may_not_be_read_costs_itself_only(folder, tmp_path, monkeypatch):
    real = Path.read_bytes

    def refusing(self):
        if self.name == "z.bvh":
            raise PermissionError(13, "Permission denied", str(self))
        return real(self)

    monkeypatch.setattr(Path, "read_bytes", refusing)
    found = _outcomes(folder, tmp_path / "motion")
    assert found["a.bvh"][0] == "kept" and found["z.bvh"] == (
        "skipped",
        f"{folder / 'z.bvh'} cannot be read: Permission denied.",
    )


def test_a_damaged_archive_costs_itself_only(folder, tmp_path):
    (folder / "cut.zip").write_bytes(b"PK\x03\x04 and no more")
    with zipfile.ZipFile(folder / "climbs.zip", "w") as archive:
        archive.writestr("../../walk.bvh", "x")
    found = _outcomes(folder, tmp_path / "motion")
    assert {name: outcome for name, (outcome, _) in found.items()} == {
        "a.bvh": "kept", "z.bvh": "kept", "cut.zip": "skipped", "climbs.zip": "skipped",
    }  # fmt: skip
    assert "leads out" in found["climbs.zip"][1]
    with pytest.raises(InputError, match=r"cut\.zip|climbs\.zip"):
        _outcomes(folder, tmp_path / "strict", strict=True)


@dataclass(frozen=True)
class Deadly(Source):
    """A source that ends the process that reads it."""

    def read(self) -> bytes:
        os.kill(os.getpid(), signal.SIGKILL)
        return b""


def test_a_file_that_kills_its_process_costs_itself_only(folder, monkeypatch):
    monkeypatch.setattr(reading, "_POOL_FROM_BYTES", 0)
    good = [Source(str(path), "", path.name, path.stat().st_size) for path in sorted(folder.iterdir())]
    sources = [*good, Deadly("/nowhere/deadly.bvh", "", "deadly.bvh", 10), *good]
    outcomes = list(read_all([Job(source, "auto", Asked()) for source in sources], 2))
    assert [outcome.source.name for outcome in outcomes] == [source.name for source in sources]
    assert [outcome.status for outcome in outcomes] == ["kept", "kept", "skipped", "kept", "kept"]
    assert outcomes[2].reason == "The process that read /nowhere/deadly.bvh was ended, perhaps for want of memory."


def test_only_what_is_read_is_hashed(folder, tmp_path, monkeypatch):
    (folder / "film.mp4").write_bytes(b"not read")
    (folder / "a.json").write_text("{}")
    hashed: list[str] = []
    for place in ("sha256_of_file", "digest_of_source"):
        real = getattr(inputs, place)
        monkeypatch.setattr(inputs, place, lambda path, real=real: (hashed.append(path.name), real(path))[1])
    _outcomes(folder, tmp_path / "motion")
    assert hashed == ["a.json"]  # the clips were hashed when they were read

    (first,) = open_artefact(tmp_path / "motion").manifest.inputs
    assert (first.kind, first.path) == ("folder", "../takes")
    (folder / "film.mp4").write_bytes(b"changed")
    _outcomes(folder, tmp_path / "film")
    assert open_artefact(tmp_path / "film").manifest.inputs[0].digest == first.digest
    (folder / "a.bvh").write_bytes(BvhText(frames=30, seed=9).data())
    _outcomes(folder, tmp_path / "clip")
    assert open_artefact(tmp_path / "clip").manifest.inputs[0].digest != first.digest


def test_inputs_keep_the_digests_of_files_and_archives(folder, tmp_path):
    with zipfile.ZipFile(tmp_path / "more.zip", "w") as archive:
        archive.writestr("b.bvh", BvhText(frames=30, seed=4).data())
    config = Config(sources=(str(folder / "a.bvh"), str(tmp_path / "more.zip")), output=tmp_path / "motion")
    run(config)
    found = [(each.path, each.kind, each.digest) for each in open_artefact(tmp_path / "motion").manifest.inputs]
    assert found == [
        ("../takes/a.bvh", *inputs.digest_of_source(folder / "a.bvh")),
        ("../more.zip", *inputs.digest_of_source(tmp_path / "more.zip")),
    ]
