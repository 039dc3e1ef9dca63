"""What a user meets: help, flags, settings from several places, errors, exit codes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from data_schemas.errors import InputError, PumpsError
from data_schemas.version import PUMPS_VERSION
from pumps_cli import stage_command
from stages.registry import OLD_NAMES, OLD_WORDS, STAGES, Stage, stage_named
from stages.shared.contract import StageConfig, StageReport

Pumps = Callable[..., object]


class Recorder:
    """Stands in for a stage's run: keeps the config that it was called with."""

    def __init__(self) -> None:
        self.config: StageConfig | None = None
        self.error: BaseException | None = None

    def runner(self, stage: Stage) -> Callable[..., StageReport]:
        def run(config: StageConfig, *, progress: object) -> StageReport:
            self.config = config
            if self.error is not None:
                raise self.error
            return StageReport(lines=["a line"], figures={"clips": 3})

        return run


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    kept = Recorder()
    monkeypatch.setattr(stage_command.Stage, "runner", lambda stage: kept.runner(stage))
    return kept


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_every_help_says_what_it_does_and_gives_an_example(pumps, stage: Stage):
    ran = pumps(*stage.command, "--help")
    assert ran.code == 0
    assert stage.summary.split()[0] in ran.out
    assert "Example: pumps" in ran.out
    for flag in ("--quiet", "--json", "--debug", "--help"):
        assert flag in ran.out, flag


def test_help_names_every_command(pumps):
    shown = pumps("--help").out
    for word in {stage.command[0] for stage in STAGES} | {"artefact", "config", "results", "run", "stages"}:
        assert word in shown


@pytest.mark.parametrize("old", OLD_WORDS)
def test_an_old_word_still_works_says_so_and_is_in_no_help(pumps, recorder: Recorder, old: str):
    new = " ".join(stage_named(OLD_NAMES[old]).command)
    assert not any(line.strip(" │").startswith(f"{old} ") for line in pumps("--help").out.splitlines())
    told = f"`pumps {old}` is now `pumps {new}`; the old name goes in the next minor version.\n"
    ran = pumps(old, "--help")
    assert ran.code == 0 and ran.err == told and f"pumps {new}" in ran.out
    assert pumps(*new.split(), "--help").err == ""


def test_an_old_word_gives_the_new_command_its_flags(pumps, recorder: Recorder):
    ran = pumps("average-checkpoints", "a", "b", "-o", "mean")
    assert (ran.code, ran.out) == (0, "a line\n")
    given = recorder.config.model_dump()  # type: ignore[union-attr]
    assert [str(each) for each in given["checkpoints"]] == ["a", "b"]


def test_version(pumps):
    assert pumps("--version").out.strip() == f"pumps {PUMPS_VERSION}"


@pytest.mark.parametrize("words", [["ingst"], ["train", "vae"], ["encode", "--nonsense", "1"]])
def test_unknown_words_are_usage_errors(pumps, words: list[str]):
    assert pumps(*words).code == 2


def test_flags_reach_the_config(pumps, recorder: Recorder):
    words = ("--tpc", "t", "-o", "out", "--steps", "7", "--no-augment", "--encoder.width", "9")
    assert pumps("train", "ae", *words, "--learning-rate", "1e-3").code == 0
    config = recorder.config
    assert config is not None
    given = config.model_dump()
    assert (given["steps"], given["augment"], given["encoder"]["width"]) == (7, False, 9)
    assert (given["output"], given["learning_rate"]) == (Path("out"), 1e-3)


def test_repeated_flags_and_arguments_by_place(pumps, recorder: Recorder):
    assert pumps("ingest", "bvh", "a.bvh", "b.zip", "-o", "m", "--fps-override", "*x*=60").code == 0
    given = recorder.config.model_dump()  # type: ignore[union-attr]
    assert given["sources"] == ("a.bvh", "b.zip")
    assert given["fps_override"] == ("*x*=60",)


def test_later_settings_win(pumps, recorder: Recorder, tmp_path: Path):
    file = tmp_path / "mine.toml"
    file.write_text("steps = 11\nbatch = 3\n[encoder]\nwidth = 5\n")
    pumps("train", "ae", "--preset", "tiny", "--config", file, "--steps", "12", "--tpc", "t", "-o", "o")
    given = recorder.config.model_dump()  # type: ignore[union-attr]
    assert (given["steps"], given["batch"], given["encoder"]["width"]) == (12, 3, 5)
    assert given["encoder"]["blocks"] == 3, "the preset's, which no later layer names"


def test_a_file_may_hold_a_table_for_each_stage(pumps, recorder: Recorder, tmp_path: Path):
    file = tmp_path / "run.toml"
    file.write_text("[train-ae]\nsteps = 11\n[train-lms]\nsteps = 99\n")
    pumps("train", "ae", "--config", file, "--tpc", "t", "-o", "o")
    assert recorder.config.model_dump()["steps"] == 11  # type: ignore[union-attr]


def test_a_table_may_have_a_stages_old_name(pumps, recorder: Recorder, tmp_path: Path):
    file = tmp_path / "run.toml"
    file.write_text("[pick-clips]\ncount = 7\n[train-lms]\nsteps = 99\n")
    pumps("data", "pick", "--config", file, "--motion", "m", "-o", "o")
    assert recorder.config.model_dump()["count"] == 7  # type: ignore[union-attr]
    assert pumps("encode", "--config", file, "--tpc", "t", "--ae", "a", "-o", "o").code == 0, "not encode's"
    file.write_text("[pick-clips]\ncount = 7\n[data-pick]\ncount = 8\n")
    pumps("data", "pick", "--config", file, "--motion", "m", "-o", "o")
    assert recorder.config.model_dump()["count"] == 8, "the new name wins"  # type: ignore[union-attr]


def test_all_faults_are_told_at_once(pumps, recorder: Recorder, tmp_path: Path):
    file = tmp_path / "mine.toml"
    file.write_text("stepz = 11\nbatch = 'many'\n[encoder]\nwidht = 5\n")
    ran = pumps("train", "ae", "--config", file, "--points", "few")
    assert ran.code == 2 and recorder.config is None
    for part in (
        "did you mean steps?",
        "did you mean width?",
        "batch = 'many' in",
        "--points = 'few'",
        "--tpc is",
        "mine.toml",
    ):
        assert part in ran.err, part
    assert "Traceback" not in ran.err


def test_a_missing_argument_is_called_as_help_calls_it(pumps):
    ran = pumps("infill")
    assert ran.code == 2 and "INPUT is missing" in ran.err and "--output is missing" in ran.err


@pytest.mark.parametrize("text", ["steps = ", "steps = 1\nsteps = 2"])
def test_a_file_that_is_no_toml_is_bad_input(pumps, tmp_path: Path, text: str):
    file = tmp_path / "mine.toml"
    file.write_text(text)
    ran = pumps("train", "ae", "--config", file)
    assert ran.code == 3 and str(file) in ran.err


def test_a_file_that_is_missing_is_bad_input(pumps):
    ran = pumps("train", "ae", "--config", "nowhere.toml")
    assert ran.code == 3 and "nowhere.toml" in ran.err


def test_reports_as_text_json_or_nothing(pumps, recorder: Recorder):
    words = ("encode", "--tpc", "t", "--ae", "a", "-o", "o")
    assert pumps(*words).out == "a line\n"
    assert json.loads(pumps(*words, "--json").out)["figures"] == {"clips": 3}
    assert pumps(*words, "--quiet").out == ""


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (PumpsError("It could not."), 1, "It could not."),
        (InputError("x.bvh, line 3: no number.", "Mend line 3."), 3, "x.bvh, line 3: no number. Mend line 3."),
        (PermissionError(13, "Permission denied", "out"), 1, "Permission denied (out)"),
        (ValueError("surprise"), 1, "ValueError: surprise"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_errors_are_one_sentence_and_an_exit_code(pumps, recorder: Recorder, error, code: int, said: str):
    recorder.error = error
    words = ("encode", "--tpc", "t", "--ae", "a", "-o", "o")
    ran = pumps(*words)
    assert ran.code == code and said in ran.err and "Traceback" not in ran.err
    as_json = pumps(*words, "--json")
    assert json.loads(as_json.out)["exit_code"] == code
    assert "Traceback" in pumps(*words, "--debug").err


def test_stages_lists_them_in_order(pumps):
    lines = pumps("stages").out.splitlines()[1:]
    assert [line.split("  ")[0] for line in lines] == [" ".join(stage.command) for stage in STAGES]
    assert [each["name"] for each in json.loads(pumps("stages", "--json").out)] == [stage.name for stage in STAGES]


def test_doctor_tells_versions_and_the_device(pumps):
    ran = pumps("doctor", "--device", "cpu")
    assert ran.code == 0
    for word in ("pumps", "python", "torch", "device", "weights"):
        assert word in ran.out


def test_doctor_refuses_a_device_that_is_not_there(pumps):
    ran = pumps("doctor", "--device", "abacus")
    assert ran.code == 2 and "abacus" in ran.err
