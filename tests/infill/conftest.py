"""Weights with random numbers, which fill as quickly as trained ones and need no training."""

import pytest

from tests.shared.inference.examples import write_random_weights


@pytest.fixture(scope="session")
def weights(tmp_path_factory) -> str:
    return str(write_random_weights(tmp_path_factory.mktemp("weights")))
