"""The benchmarks' own arithmetic: limits of the machine, and which of two versions is slower."""

import pytest

from tests.pipeline.benchmark_scripts import benchmark_script

RATES = {"matrix_float32_gflop_per_s": 50.0, "memory_gb_per_s": 5.0, "cache_gb_per_s": 20.0}


def test_the_limit_is_the_longer_of_products_and_moving():
    benchmark_script("training_step")  # puts `measuring` on the path
    from measuring.page import limit_cells, limit_of

    assert limit_of(100.0, 10.0, RATES, bfloat16=False) == ("products", 2.0)
    assert limit_of(10.0, 10.0, RATES, bfloat16=False) == ("moving", 0.5)
    assert limit_of(10.0, 10.0, {**RATES, "matrix_bfloat16_gflop_per_s": 10.0}, bfloat16=True) == ("products", 1.0)
    # A GPU has no rate of its own for its caches.
    without_caches = {name: rate for name, rate in RATES.items() if name != "cache_gb_per_s"}
    assert limit_of(10.0, 10.0, without_caches, bfloat16=False) == ("moving", 2.0)
    assert limit_cells(("moving", 0.5), 2.0) == ["moving", "0.500", "25 %"]


def test_precisions_that_the_device_lacks_are_not_timed_twice():
    script = benchmark_script("training_step")
    settings = script.settings_of("paper")[0]
    both = script.cases_of("paper", settings, compiled=False, bfloat16=True)
    one = script.cases_of("paper", settings, compiled=False, bfloat16=False)
    assert len(both) == len({case.name for case in both}) > len(one) == len({case.name for case in one})
    assert {case.mixed for case in both} == {True, False} and {case.mixed for case in one} == {False}


def test_two_versions_names_what_became_slower(tmp_path, monkeypatch, capsys):
    """One case takes three times as long in this checkout, one as long as before, and one cannot be built before."""
    script = benchmark_script("two_versions")
    before = tmp_path / "before"
    (before / "stages").mkdir(parents=True)
    (before / "stages" / "__init__.py").touch()
    builders = f"""
HERE = root == {str(script.HERE)!r}
def work(times):
    return lambda: sum(range(2_000_000 * times))
def only_here():
    assert HERE, "not in this version"
    return work(1)
"""
    monkeypatch.setattr(script, "BUILDERS", builders)
    cases = {"same": "work(2)", "worse": "work(6 if HERE else 2)", "new": "only_here()"}
    lines, slower = script.comparison(before, cases, rounds=3, most=1.8)
    assert slower == ["worse"]
    assert [line.split(" | ")[0] for line in lines[2:]] == ["| same", "| worse"]
    assert "new: left out" in capsys.readouterr().err


def test_a_tenth_more_time_is_no_fault_and_any_more_is(tmp_path, monkeypatch):
    """By processes that stand in for two versions and tell given seconds, before and after."""
    script = benchmark_script("two_versions")
    stand_in = """
import sys
after, seconds = sys.argv[1] == sys.argv[2], eval(sys.argv[3])
for _ in seconds: print("ready", flush=True)
for line in sys.stdin: print(eval(seconds[int(line)])[after], flush=True)
"""
    monkeypatch.setattr(script, "SERVER", stand_in)
    monkeypatch.setattr(script, "BUILDERS", str(script.HERE.resolve()))
    cases = {"faster": "(1.0, 0.5)", "noise": "(1.0, 1.09)", "slower": "(1.0, 1.11)"}
    lines, slower = script.comparison(tmp_path, cases, rounds=2, most=1.1)
    assert slower == ["slower"] and [line.endswith("| slower |") for line in lines[2:]] == [False, False, True]


def test_a_version_whose_process_fails_is_an_error(tmp_path):
    script = benchmark_script("two_versions")
    with pytest.raises(SystemExit, match="ended early"):
        script.comparison(tmp_path, {"any": "len"}, rounds=1, most=1.1)  # holds no code


def test_what_is_no_commit_is_named():
    script = benchmark_script("two_versions")
    for name in ("", "no-such-commit"):
        with pytest.raises(SystemExit, match="no commit"), script.checked_out(name):
            pass


def test_make_bench_runs_scripts_that_exist():
    script = benchmark_script("guards")
    assert all((script.HERE / f"{name}.py").is_file() for name in script.GUARDS)
