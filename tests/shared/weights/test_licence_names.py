from __future__ import annotations

import pytest

from stages.shared.weights.licence_names import licence_names
from stages.shared.weights.shipped import shipped_weights


@pytest.mark.parametrize(
    ("licences", "names"),
    [
        (["CC BY-NC 4.0 (c) A Company Inc.", "CC BY-NC 4.0 (c) Another"], "CC BY-NC 4.0"),
        (["CC0 1.0: Characters", "MIT: Poses, Copyright (c) 2025 Somebody", "test only"], "CC0 1.0, MIT, test only"),
        (["MIT, Copyright 2025 Somebody", "A Database: free. Not to be sold."], "MIT, A Database"),
        (["free for any use."], "free for any use"),
        ([": terms without a name"], ": terms without a name"),
        ([], "none named"),
    ],
)
def test_names_stand_without_holders_and_terms(licences: list[str], names: str) -> None:
    assert licence_names(licences) == names


def test_a_sentence_without_a_name_is_cut() -> None:
    assert licence_names(["to be used by nobody but those who " + "are named " * 20]).endswith("...")
    assert len(licence_names(["word " * 400])) <= 60


def test_no_licence_of_the_weights_that_ship_is_left_out() -> None:
    from stages.shared.weights.facts import facts_of

    for name in shipped_weights():
        licences = facts_of(name)["licences"]
        names = licence_names(licences).split(", ")
        assert len(names) <= len(licences) and len(", ".join(names)) <= 100
        assert all(any(licence.startswith(each) for each in names) for licence in licences)
