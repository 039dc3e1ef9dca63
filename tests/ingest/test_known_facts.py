"""Rates that the catalogue states for archives that it knows by name; a user's --fps-override goes before them."""

from __future__ import annotations

from pathlib import Path
from zipfile import ZipFile

import pytest

from data_schemas.motion import MotionReader
from stages.ingest.config import Config
from stages.ingest.run import run
from tests.shared.formats.bvh_texts import BvhText


def _archive(path: Path) -> Path:
    with ZipFile(path, "w") as archive:
        for member in ("indian/01.bvh", "salsa/01.bvh", "salsa/02.bvh"):
            archive.writestr(f"{path.stem}/{member}", BvhText(frames=40, seed=len(member)).data())
    return path


@pytest.mark.parametrize(
    ("name", "given", "rates", "told"),
    [
        ("cmu-dance.zip", (), {"indian": 30, "salsa": 60}, "2 files read at 60 frames a second"),
        ("cmu-dance.zip", ("*salsa*=50",), {"indian": 30, "salsa": 50}, ""),
        ("another.zip", (), {"indian": 30, "salsa": 30}, ""),
    ],
)
def test_the_catalogues_rate_holds_unless_another_is_given(
    tmp_path: Path, name: str, given: tuple[str, ...], rates: dict[str, int], told: str
) -> None:
    report = run(Config(sources=(str(_archive(tmp_path / name)),), output=tmp_path / "motion", fps_override=given))
    with MotionReader(tmp_path / "motion") as reader:
        assert {row.clip.split(".")[1]: row.fps for row in reader.clips} == rates
        assert all(("fps-override" in row.flags) == (row.fps != 30) for row in reader.clips)
    assert any(told in line for line in report.lines) and (
        bool(told) == any("as the catalogue" in line for line in report.lines)
    )


def test_the_catalogue_states_the_licence_of_archives_that_it_knows(tmp_path: Path) -> None:
    run(Config(sources=(str(_archive(tmp_path / "reactidle.zip")),), output=tmp_path / "motion"))
    with MotionReader(tmp_path / "motion") as reader:
        assert {row.licence for row in reader.clips} == {"MIT: ReActIdle, Copyright (c) 2025 [RSAIT]"}
