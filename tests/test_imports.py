"""Which way imports run, and what must not be loaded for help."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from stages.registry import STAGES
from stages.shared.toml import read_toml

ROOT = Path(__file__).resolve().parent.parent
HOUSE = ("data_schemas", "stages", "pumps_cli", "pumps")  # a package imports only what stands before it
BANNED = {"data_schemas": {"torch", "typer", "rich", "click"}, "stages": {"typer", "rich", "click", "roma"}}


def imported_names(path: Path) -> set[str]:
    """Full names of what a module imports, anywhere in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno} imports relatively"
            names.add(node.module or "")
    return names


@pytest.mark.parametrize("package", HOUSE)
def test_imports_run_one_way(package: str):
    above = set(HOUSE[HOUSE.index(package) + 1 :]) | BANNED.get(package, set())
    for path in sorted((ROOT / package).rglob("*.py")):
        wrong = {name for name in imported_names(path) if name.split(".")[0] in above | {"tests"}}
        assert not wrong, f"{path.relative_to(ROOT)} imports {', '.join(sorted(wrong))}"


def test_stage_packages_do_not_import_each_other():
    packages = {stage.package for stage in STAGES}
    for package in packages:
        for path in (ROOT / package.replace(".", "/")).glob("*.py"):
            others = {name for name in imported_names(path) for other in packages - {package} if within(name, other)}
            assert not others, f"{path.relative_to(ROOT)} imports {', '.join(sorted(others))}"


def within(name: str, package: str) -> bool:
    """Whether the name is the package or in it."""
    return f"{name}.".startswith(f"{package}.")


def test_every_stage_is_where_its_words_say_and_under_the_contracts():
    """Each of them is named there, or its group is; and what is named there is a stage or a group of stages."""
    contracts = read_toml(ROOT / "pyproject.toml")["tool"]["importlinter"]["contracts"]
    floors = next(each for each in contracts if each.get("containers") == ["stages"])
    groups = next(each for each in contracts if each["type"] == "independence")
    above, below = floors["layers"]
    rooms = set(above.split(" | "))  # "|": they import each other no more than a lower floor imports a higher one
    assert below == "shared" and floors["exhaustive"] and floors["exhaustive_ignores"] == ["registry"]
    for stage in STAGES:
        _, room, *rest = stage.package.split(".")
        assert room in rooms and len(rest) <= 1, stage.package
        assert not rest or f"stages.{room}.*" in groups["modules"], stage.package
        assert (ROOT / stage.package.replace(".", "/") / "run.py").is_file(), stage.package
    packages = {stage.package for stage in STAGES}
    for room in rooms:
        inner = {f"stages.{room}.{path.parent.name}" for path in (ROOT / "stages" / room).glob("*/__init__.py")}
        assert (inner or {f"stages.{room}"}) <= packages, f"in stages/{room} lies what no command runs"


def loaded_by(code: str) -> set[str]:
    """Names of the modules loaded by `code` in a new interpreter: top-level ones, and all of torch."""
    shown = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print('\\nLOADED', *sys.modules)"],
        capture_output=True, text=True, cwd=ROOT, check=True,
    ).stdout  # fmt: skip
    names = shown.rpartition("LOADED")[2].split()
    return {name.split(".")[0] for name in names} | {name for name in names if name.startswith("torch.")}


def test_help_loads_no_heavy_library():
    code = "from pumps_cli.app import main\ntry: main(['--help'])\nexcept SystemExit: pass"
    heavy = {"torch", "numpy", "scipy", "h5py", "pyarrow", "pydantic"}
    assert not loaded_by(code) & heavy


def test_help_of_every_command_loads_no_torch():
    tools = ["artefact", "config", "demo", "formats", "results", "run", "stages"]
    words = [list(stage.command) for stage in STAGES] + [[tool] for tool in tools]
    code = (
        "from pumps_cli.app import main\n"
        f"for words in {words!r}:\n"
        "    try: main([*words, '--help'])\n"
        "    except SystemExit as leaving: assert not leaving.code, words"
    )
    assert not loaded_by(code) & {"torch", "h5py", "pyarrow", "scipy"}


def test_commands_load_no_more_of_torch_than_they_need(tmp_path: Path):
    """Reading, showing and exporting need no network; filling compiles nothing: `torch._dynamo` costs a second."""
    clip = str(ROOT / "stages" / "shared" / "clips" / "kick.bvh")
    ran = (
        "from pumps_cli.app import main\n"
        "for words in {words!r}:\n"
        "    try: main(words)\n"
        "    except SystemExit as leaving: assert not leaving.code, words"
    )
    without = [
        ["inspect", clip],
        ["export", clip, "-o", str(tmp_path / "kick.glb")],
        ["ingest", "auto", clip, "-o", str(tmp_path / "ingest")],
        ["data", "pick", "--motion", str(tmp_path / "ingest"), "--splits", "test", "-o", str(tmp_path / "picked")],
        ["artefact", "show", str(tmp_path / "ingest")],
        ["weights", "list"],
        ["config", "write", "--run", str(tmp_path / "run"), "--source", clip],
    ]
    assert "torch" not in loaded_by(ran.format(words=without))
    filling = [
        ["infill", clip, "--keyframes", "every:15", "-o", str(tmp_path / "filled.bvh")],
        ["retarget", clip, "--to", clip, "-o", str(tmp_path / "retargeted.bvh")],
    ]
    loaded = loaded_by(ran.format(words=filling))
    assert "torch" in loaded and not {"torch._dynamo", "torch._inductor", "roma"} & loaded


def test_the_studio_shows_a_motion_without_torch():
    clip = str(ROOT / "stages" / "shared" / "clips" / "kick.bvh")
    code = "import uvicorn, stages.studio.app\nfrom pathlib import Path\nfrom stages.studio.scene import scene_of"
    assert "torch" not in loaded_by(f"{code}\nscene_of(Path({clip!r}))")


@pytest.mark.parametrize("given, sleeps", [({}, True), ({"OMP_WAIT_POLICY": "active"}, False)])
def test_waiting_threads_soon_sleep_unless_the_user_says_otherwise(given: dict[str, str], sleeps: bool):
    """As the OpenMP that torch loads tells it itself, after the command was called."""
    code = "from pumps_cli.app import main\ntry: main(['stages'])\nexcept SystemExit: pass\nimport torch"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("OMP_", "GOMP_", "KMP_"))}
    told = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, cwd=ROOT, check=True, env={**kept, "OMP_DISPLAY_ENV": "verbose", **given},
    ).stderr  # fmt: skip
    if "GOMP_SPINCOUNT" not in told:
        pytest.skip("this build of torch brings another OpenMP than GNU's")
    assert ("GOMP_SPINCOUNT = '2000'" in told) == sleeps


def test_no_module_of_the_house_is_too_long():
    long = {
        str(path.relative_to(ROOT)): lines
        for package in HOUSE
        for path in (ROOT / package).rglob("*.py")
        if (lines := len(path.read_text(encoding="utf-8").splitlines())) > 400
    }
    assert not long
