"""Presets, layers, TOML, and the config folder of a run."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_schemas import old_names
from data_schemas.errors import InputError, UsageError
from stages.registry import NAMES, OLD_NAMES, OLD_WORDS, PIPELINE, downstream_of, stage_named
from stages.retarget.config import Config as Retarget
from stages.shared.settings.layers import COMMAND_LINE, Layer, settle
from stages.shared.settings.presets import check_preset, preset_layers, preset_names, preset_path
from stages.shared.settings.run_folder import write_run_config
from stages.shared.toml import parse_value, read_toml, toml_text

PLAIN = st.one_of(
    st.booleans(), st.integers(-(2**60), 2**60), st.floats(allow_nan=False), st.text(st.characters(codec="utf-8"))
)
TABLES = st.recursive(
    st.dictionaries(st.text(min_size=1), st.one_of(PLAIN, st.lists(PLAIN, max_size=3)), max_size=4),
    lambda inner: st.dictionaries(st.text(min_size=1), st.one_of(PLAIN, inner), max_size=3),
    max_leaves=8,
)


@given(TABLES)
def test_toml_round_trip(tmp_path_factory: pytest.TempPathFactory, values: dict):
    path = tmp_path_factory.getbasetemp() / f"round-{os.getpid()}.toml"
    path.write_text(toml_text(values), encoding="utf-8", newline="")
    assert read_toml(path) == values


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("1e-3", 1e-3),
        ("true", True),
        ("[5, 15]", [5, 15]),
        ("'a b'", "a b"),
        ("every:15", "every:15"),
        ("", ""),
    ],
)
def test_values_on_the_command_line(text: str, value: object):
    assert parse_value(text) == value


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_is_right_and_opens_with_its_command(name: str):
    check_preset(name)
    head = preset_path(name).read_text().split("\n\n")[0]
    assert head.startswith("#") and "make " in head


def test_presets_build_on_each_other():
    assert [layer.origin for layer in preset_layers("demo", "train-ae")] == ["preset tiny", "preset demo"]


def test_unknown_preset_names_those_there_are():
    with pytest.raises(UsageError, match="tiny"):
        preset_layers("huge", "train-ae")


def test_what_follows_from_a_change():
    assert downstream_of({"evaluate"}) == {"evaluate", "report"}
    assert downstream_of({"ingest"}) == {stage.name for stage in PIPELINE}
    assert "train-ae" not in downstream_of({"train-lms"})


def test_what_a_stage_is_given_in_a_run_is_what_it_needs():
    for stage in PIPELINE:
        places = {place.rpartition("=")[2].split("/")[0] for _, place in stage.inputs} - {".", "{weights}"}
        assert places <= set(stage.needs), stage.name
        assert {field for field, _ in stage.inputs} <= set(stage.config_type().model_fields)


def test_every_need_is_an_earlier_stage():
    seen: set[str] = set()
    for stage in PIPELINE:
        assert set(stage.needs) <= seen
        seen.add(stage.name)


def test_a_run_has_one_file_a_stage_and_all_are_readable(tmp_path: Path):
    write_run_config(tmp_path, ["tiny"], [])
    for stage in PIPELINE:
        values = read_toml(tmp_path / "config" / f"{stage.name}.toml")
        assert set(values) <= set(stage.config_type().model_fields)
        assert "output" not in values, "paths of a run are given by its makefile"


def test_only_what_changed_is_written(tmp_path: Path):
    assert len(write_run_config(tmp_path, ["tiny"], [])) == len(PIPELINE) + 1, "and the makefile"
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "config").iterdir()}
    assert write_run_config(tmp_path, ["tiny"], []) == []
    changed = write_run_config(tmp_path, ["tiny"], ["train-lms.steps=5"])
    assert [path.name for path in changed] == ["train-lms.toml"]
    for path, then in before.items():
        assert (path.stat().st_mtime_ns == then) == (path.name != "train-lms.toml")


def test_old_names_mean_stages_of_today(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(old_names, "_told", set())
    assert set(OLD_NAMES.values()) <= set(NAMES) and not set(OLD_NAMES) & set(NAMES)
    assert set(OLD_WORDS) <= set(OLD_NAMES)
    with pytest.warns(old_names.OldName, match="stage pick-clips of --set is now data-pick"):
        write_run_config(tmp_path, ["tiny"], ["pick-clips.count=7"])
    assert read_toml(tmp_path / "config" / "data-pick.toml")["count"] == 7


def test_a_node_of_a_recipe_may_have_a_stages_old_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(old_names, "_told", set())
    recipe = tmp_path / "own.toml"
    recipe.write_text(
        'preset = "tiny"\n[data]\nembedded = "alone"\n[goals.run]\nnodes = ["calibrate"]\n'
        '[nodes.calibrate]\nstage = "ingest"\nsettings = { licence = "CC0" }\n'
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_run_config(tmp_path / "run", settings=["calibrate.licence=MIT"], recipe=str(recipe))
    assert read_toml(tmp_path / "run" / "config" / "calibrate.toml")["licence"] == "MIT"


def test_settings_of_several_stages_are_judged_together(tmp_path: Path):
    with pytest.raises(UsageError) as caught:
        write_run_config(tmp_path, ["tiny"], ["train-ae.steps=no", "evaluate.windw=3"])
    assert "steps" in str(caught.value) and "did you mean window?" in str(caught.value)
    assert not (tmp_path / "config").exists()


def test_settings_that_do_not_go_together_are_told_in_one_sentence():
    given = {"input": "kick.bvh", "to": "rig.bvh", "output": "out.bvh", "method": "network"}
    with pytest.raises(UsageError, match="--network goes with the methods network and both"):
        settle(Retarget, [Layer(COMMAND_LINE, given)], what="pumps retarget", arguments=("input",))


@pytest.mark.parametrize("text", ["steps=3", "nowhere.steps=3", "train-ae.steps", "train-ae=3"])
def test_a_setting_needs_stage_field_and_value(tmp_path: Path, text: str):
    with pytest.raises(UsageError, match=r"STAGE\.FIELD=VALUE"):
        write_run_config(tmp_path, ["tiny"], [text])


def test_one_value_of_several_may_stand_bare(tmp_path: Path):
    write_run_config(tmp_path, ["tiny"], ["ingest.fps_override=*salsa*=60", "evaluate.intervals=5"])
    assert read_toml(tmp_path / "config/ingest.toml")["fps_override"] == ["*salsa*=60"]
    assert read_toml(tmp_path / "config/evaluate.toml")["intervals"] == [5]


def sources_of(run: Path) -> str:
    return (run / "config" / "sources.txt").read_text()


def test_sources_change_with_content_and_not_with_time(tmp_path: Path):
    data, run = tmp_path / "data", tmp_path / "run"
    (data / "sub").mkdir(parents=True)
    clip = data / "sub" / "a.bvh"
    clip.write_text("HIERARCHY")
    (data / "notes.md").write_text("not a recording")
    write_run_config(run, ["tiny"], [], [str(data)])
    first = sources_of(run)
    assert first.endswith(f"  {clip}\n") and first.count("\n") == 1
    os.utime(clip, (1, 1))
    assert write_run_config(run, ["tiny"], [], [str(data)]) == [], "touched, not changed"
    clip.write_text("HIERARCHZ")
    assert [path.name for path in write_run_config(run, ["tiny"], [], [str(data)])] == ["sources.txt"]
    (data / "b.bvh").write_text("")
    write_run_config(run, ["tiny"], [], [str(data)])
    assert sources_of(run).count("\n") == 2


def test_the_splits_file_is_a_source_too(tmp_path: Path):
    (tmp_path / "a.bvh").write_text("HIERARCHY")
    splits = tmp_path / "splits.json"
    splits.write_text("{}")
    settings = [f"ingest.splits={splits}"]
    write_run_config(tmp_path / "run", ["tiny"], settings, [str(tmp_path / "a.bvh")])
    splits.write_text("{ }")
    assert write_run_config(tmp_path / "run", ["tiny"], settings, [str(tmp_path / "a.bvh")])


def test_a_missing_source_is_bad_input(tmp_path: Path):
    with pytest.raises(InputError, match="nowhere"):
        write_run_config(tmp_path / "run", ["tiny"], [], [str(tmp_path / "nowhere.zip")])


def test_stage_named_says_which_there_are():
    with pytest.raises(KeyError, match="train-ae"):
        stage_named("train")
