"""Old names work, and are told once."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from data_schemas import old_names
from stages.shared.settings.presets import file_layer


@pytest.fixture
def settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(old_names, "_told", set())
    path = tmp_path / "mine.toml"
    path.write_text("[pick-clips]\ncount = 1\n")
    return path


def test_a_command_prints_one_line_of_an_old_table(settings: Path, pumps, tmp_path: Path):
    words = ("data", "pick", "--config", settings, "--motion", tmp_path / "none", "-o", tmp_path / "out")
    first = pumps(*map(str, words))
    line = f"The table [pick-clips] of {settings} is now [data-pick]; the old name goes in the next minor version."
    assert first.err.splitlines().count(line) == 1 and ".py" not in first.err
    assert line not in pumps(*map(str, words)).err


def test_a_command_that_shows_tracebacks_tells_them_too(settings: Path, pumps, tmp_path: Path):
    words = ("data", "pick", "--config", settings, "--motion", tmp_path / "none", "-o", tmp_path / "out", "--debug")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("ignore")
        pumps(*words)
    assert [each.category for each in told] == [old_names.OldName]


def test_an_old_stage_of_set_is_told(settings: Path, pumps, tmp_path: Path):
    ran = pumps("config", "write", "--preset", "tiny", "--run", tmp_path / "run", "--set", "pick-clips.count=1")
    line = "The stage pick-clips of --set is now data-pick; the old name goes in the next minor version."
    assert ran.err.splitlines().count(line) == 1


def test_python_warns_once(settings: Path):
    with pytest.warns(DeprecationWarning, match=r"\[data-pick\]"):
        assert file_layer(settings, "data-pick").values == {"count": 1}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert file_layer(settings, "data-pick").values == {"count": 1}
