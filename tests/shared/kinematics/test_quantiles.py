"""Percentiles and medians have the bits of NumPy's."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from stages.shared.kinematics.quantiles import median, percentile

_SHAPES = array_shapes(min_dims=1, max_dims=2, min_side=1, max_side=40)
_NUMBERS = st.one_of(st.floats(-1e6, 1e6, width=32), st.just(float("nan")))
_VALUES = st.one_of(
    arrays(np.float64, _SHAPES, elements=st.floats(-1e6, 1e6)),
    arrays(np.float64, _SHAPES, elements=_NUMBERS),
    arrays(np.float32, _SHAPES, elements=_NUMBERS),
)


@given(_VALUES, st.one_of(st.sampled_from([0.0, 1.0, 5.0, 50.0, 95.0, 99.0, 100.0]), st.floats(0, 100)))
def test_a_percentile_has_numpys_bits(values: np.ndarray, percent: float):
    assert np.array_equal(percentile(values, percent), np.percentile(values, percent, axis=0), equal_nan=True)


@given(_VALUES)
def test_a_median_has_numpys_bits(values: np.ndarray):
    assert np.array_equal(median(values), np.median(values, axis=0), equal_nan=True)


def test_the_values_are_not_reordered():
    values = np.array([3.0, 1.0, 2.0])
    assert percentile(values, 50) == median(values) == 2.0
    assert values.tolist() == [3.0, 1.0, 2.0]
