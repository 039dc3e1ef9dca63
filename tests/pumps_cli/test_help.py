"""The help that a user reads: panels, usage lines, options, the rarely set ones, and what the shell completes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pumps_cli.app import tool_words
from stages.registry import PANELS, STAGES, Stage
from stages.shared.contract import DeviceConfig, SeededConfig
from stages.shared.settings.presets import preset_names, preset_path
from stages.shared.toml import read_toml
from stages.shared.weights.shipped import shipped_weights

ROOT = Path(__file__).resolve().parents[2]
TRAININGS = [stage for stage in STAGES if stage.command[0] == "train"]
TOOLS = [("artefact", "show"), ("artefact", "merge"), ("config", "show"), ("formats",), ("results",), ("stages",)]
_MOST_SHOWN = 20


def options_in(text: str) -> set[str]:
    """The options that the panels of a help page list."""
    rows = [line.strip("│ ") for line in text.splitlines() if line.startswith("│")]
    found = [re.match(r"(?:-\w, +)?--(?:\[no-\])?([\w.-]+)", row) for row in rows]
    return {match[1] for match in found if match}


def test_help_is_in_panels_for_each_kind_of_reader(pumps):
    shown = pumps("--help").out
    assert list(PANELS) == ["Animate", "Data", "Meshes", "Train", "Research"]
    assert re.findall(r"╭─ (\w+) ─", shown) == [*PANELS, "Options"]
    animate = shown[shown.index("─ Animate") : shown.index("─ Data")]
    assert [line.split()[1] for line in animate.splitlines() if re.match(r"│ \w", line)][:3] == [
        "demo",
        "infill",
        "retarget",
    ]


def test_every_word_is_in_one_panel():
    words = [*dict.fromkeys(stage.command[0] for stage in STAGES), *tool_words()]
    placed = [word for panel in PANELS.values() for word in panel]
    assert sorted(placed) == sorted(words)


@pytest.mark.parametrize("words", [stage.command for stage in STAGES] + TOOLS, ids=" ".join)
@pytest.mark.parametrize("width", [80, 120])
def test_no_help_has_noise_or_is_wider_than_the_terminal(pumps, monkeypatch, words: tuple[str, ...], width: int):
    monkeypatch.setenv("COLUMNS", str(width))
    shown = pumps(*words, "--help").out
    assert not re.search(r"<\w+>|list\[|\[required\]", shown)
    boxed = [line for line in shown.splitlines() if not line.startswith("Example: ")]  # which is copied as one line
    assert max(len(line) for line in boxed) <= width
    usage = " ".join(shown[: shown.index("\n\n")].split())
    assert usage.startswith(f"Usage: pumps {' '.join(words)} ") and "COMMAND" not in usage and "{" not in usage


@pytest.mark.parametrize(
    ("words", "usage"),
    [
        (["infill"], "pumps infill INPUT --output PATH [OPTIONS]"),
        (["ingest", "bvh"], "pumps ingest bvh SOURCES... --output PATH [OPTIONS]"),
        (["weights", "show"], "pumps weights show [NAME] [OPTIONS]"),
        (["retarget"], "pumps retarget INPUT --to PATH --output PATH [OPTIONS]"),
        (["results"], "pumps results METRICS [OPTIONS]"),
        (["stages"], "pumps stages [OPTIONS]"),
        (["artefact", "merge"], "pumps artefact merge PATHS... --output PATH [OPTIONS]"),
        (["train"], "pumps train COMMAND"),
        ([], "pumps COMMAND"),
    ],
)
def test_usage_lines_are_right(pumps, words: list[str], usage: str):
    shown = pumps(*words, "--help").out
    assert f"Usage: {usage}" == " ".join(shown.split("\n\n")[0].split())


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_options_that_mean_nothing_are_not_there(pumps, stage: Stage):
    options = options_in(pumps(*stage.command, *(["--help-all"] if stage in TRAININGS else ["--help"])).out)
    config = stage.config_type()
    assert ("seed" in options) == issubclass(config, SeededConfig)
    assert ("device" in options) == issubclass(config, DeviceConfig)
    in_presets = any((stage.form_of or stage.name) in read_toml(preset_path(name)) for name in preset_names())
    assert ("preset" in options) == in_presets
    assert {"quiet", "json", "debug", "help"} <= options


@pytest.mark.parametrize("stage", TRAININGS, ids=lambda stage: stage.name)
def test_trainings_show_what_people_set_and_the_rest_on_request(pumps, stage: Stage):
    few, every = (options_in(pumps(*stage.command, flag).out) for flag in ("--help", "--help-all"))
    own = few - {"help", "help-all", "quiet", "json", "debug", "preset", "config"}
    assert len(own) <= _MOST_SHOWN
    assert own & {"tpc", "motion", "mesh", "concepts"}, "what it learns from"
    assert {"output", "steps", "batch", "learning-rate", "device", "seed", "overwrite"} <= own
    rare = {"clip-norm", "warmup", "average"} - set(stage.without)
    assert few < every and rare <= every - few
    fields = {name.rstrip("_").replace("_", "-") for name in stage.config_type().model_fields}
    without = {name.replace("_", "-") for name in stage.without}
    assert {option.partition(".")[0] for option in every} >= fields - without


def test_an_option_that_help_leaves_out_works(pumps):
    ran = pumps("train", "ae", "--clip-norm", "much")
    assert ran.code == 2 and "--clip-norm = 'much'" in ran.err


def test_only_trainings_have_help_all(pumps):
    assert "help-all" not in options_in(pumps("infill", "--help").out)
    assert pumps("infill", "--help-all").code == 2


def test_version_has_a_short_form(pumps):
    assert pumps("-V").out == pumps("--version").out != ""


def completed(line: str) -> list[str]:
    """What bash offers after `line`."""
    words = line.split(" ")
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1), "_PUMPS_COMPLETE": "complete_bash"}
    program = [sys.executable, "-c", "from pumps_cli.app import main; main()"]
    ended = subprocess.run(
        program, cwd=ROOT, env={**os.environ, **asked}, capture_output=True, text=True, check=False
    )
    assert not ended.stderr
    return ended.stdout.split()


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("pumps infill --weights ", shipped_weights()),
        ("pumps infill --weights sm", [name for name in shipped_weights() if name.startswith("sm")]),
        ("pumps evaluate --weights ", shipped_weights()),
        ("pumps weights show ", shipped_weights()),
        ("pumps train ae --preset ", preset_names()),
        ("pumps train ae --preset t", ["table1", "table2", "tiny"]),
        ("pumps retarget --method ", ["turns", "solve", "network", "both"]),
        ("pumps retarget --device c", ["cpu", "cuda"]),
        ("pumps weights p", ["pack"]),
    ],
)
def test_the_shell_completes_values(line: str, offered: list[str]):
    assert completed(line) == offered


def test_help_loads_neither_torch_nor_other_heavy_libraries():
    program = (
        "import sys, contextlib\nfrom pumps_cli.app import main\n"
        "with contextlib.suppress(SystemExit): main({words})\n"
        "print(sorted({{'torch', 'numpy', 'h5py', 'pyarrow', 'scipy'}} & set(sys.modules)), file=sys.stderr)"
    )
    for words in (["--help"], ["infill", "--help"], ["train", "lms", "--help"]):
        ended = subprocess.run(
            [sys.executable, "-c", program.format(words=words)], cwd=ROOT, capture_output=True, text=True, check=True
        )
        assert ended.stderr.strip() == "[]", words
