"""No regular expression of pumps takes more than linear time on any text (`tests.regular_expressions`)."""

from __future__ import annotations

import re

import pytest

from tests.docs.pages import ROOT
from tests.regular_expressions import expressions_of, faults_of

PACKAGES = ("data_schemas", "stages", "pumps", "pumps_cli", "benchmarks")
NESTED, BESIDE, SEARCHED = "inside another", "side by side", "a search begins"


def test_every_expression_of_the_sources_takes_linear_time() -> None:
    files = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    found = [(path, *each) for path in files for each in expressions_of(path)]
    assert len(found) > 20
    faults = [
        f"{path.relative_to(ROOT)}:{line}: {pattern!r}: {fault}"
        for path, line, pattern, flags, searched in found
        for fault in faults_of(pattern, flags, searched=searched)
    ]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("pattern", "searched", "fault"),
    [
        (r"(a+)+b", False, NESTED),
        (r"(?:\w*,)*x", False, NESTED),
        (r"(?:(?:ab)*c)*", False, NESTED),
        (r"[ \t]*:?[ \t]*x", False, BESIDE),
        (r"(?P<joint>.+?)[\s._:/-]*\(?x\)?\s*$", False, BESIDE),
        (rb"[^,;]*[._ -]?[xyz],", True, SEARCHED),
        (r"\s*Frames[ \t]*\s*?\n", False, BESIDE),
        (r"\s+$x", True, SEARCHED),
        (r".*x.*y", False, BESIDE),
        (r"(a*)(b*|c)(a*)d", False, BESIDE),
    ],
)  # fmt: skip
def test_slow_expressions_are_found(pattern: str | bytes, searched: bool, fault: str) -> None:
    assert any(fault in each for each in faults_of(pattern, searched=searched))


@pytest.mark.parametrize(
    ("pattern", "searched"),
    [
        (r"\d+\.\d+", False),
        (r"[-+]?\d{1,15}", True),
        (r"^[ \t]*[A-Za-z_]\S*", True),
        (r'"(?:[^"\\]|\\.)*"?', True),
        (r"(?:ab|cd)+", True),
        (r"\w*[._]q[._]*w", False),
    ],
)
def test_linear_expressions_are_not(pattern: str, searched: bool) -> None:
    assert faults_of(pattern, re.MULTILINE, searched=searched) == []
