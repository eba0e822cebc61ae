"""The index of runs is the one that pandas makes by sorting all times."""

import numpy as np
import pandas as pd
import pytest

from skhoid.runs import run_index


@pytest.mark.parametrize("labels", [[1, 2, 3], ["b", "a", "c"], [3, 1, 2], ["x", 1, 2.5]])
@pytest.mark.parametrize(
    "times",
    [
        [[0.0, 0.1, 0.2]] * 3,
        [[0.0, 0.1], [0.0, 0.1, 0.2], [0.0]],
        [[0.0, 0.1], [0.2, 0.3], [0.4]],
        [[0.0, 0.1], [0.05, 0.1], [7.0]],
        [[0.3, 0.1], [0.1, 0.1], [2.0]],
    ],
    ids=["one clock", "of several lengths", "going on", "apart", "unsorted"],
)
def test_the_index_of_runs(labels, times):
    lengths = np.array([len(time) for time in times])
    time = np.concatenate(times)
    found = run_index(labels, lengths, time)
    expected = pd.MultiIndex.from_arrays(
        [pd.Index(labels).repeat(lengths), time], names=["run", "time"]
    )
    assert found.equals(expected)
    assert found.names == expected.names
    for level, other in zip(found.levels, expected.levels, strict=True):
        pd.testing.assert_index_equal(level, other)
    for codes, other in zip(found.codes, expected.codes, strict=True):
        assert codes.dtype == other.dtype
        np.testing.assert_array_equal(codes, other)


def test_the_index_keeps_its_own_times():
    time = np.arange(3.0)
    index = run_index(["a"], np.array([3]), time)
    time[:] = 7.0
    assert index.get_level_values("time").to_list() == [0.0, 1.0, 2.0]
