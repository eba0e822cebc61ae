"""Which words a name holds, and what is taken for a label or a clock by them."""

import numpy as np
import pytest

from skhoid.runs.words import (
    advances_evenly,
    in_milliseconds,
    label_word,
    labelled_stretches,
    names_time,
    words_of,
)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Run No.", ["run", "no"]),
        ("runId", ["run", "id"]),
        ("RunID", ["run", "id"]),
        ("TIME_MS", ["time", "ms"]),
        ("times", ["time"]),
        ("t0", ["t"]),
        ("trial.number 2", ["trial", "number"]),
        ("e [deg]", ["e", "deg"]),
        (3, []),
        ("1", []),
    ],
)
def test_words(name, words):
    assert words_of(name) == words


@pytest.mark.parametrize("name", ["run", "Trial_ID", "reps", "Run#", "subject nr", "condition2"])
def test_names_of_labels(name):
    assert label_word(name)


@pytest.mark.parametrize("name", ["run_time", "rep force", "id", "running", "blocked", "r", "", 1])
def test_names_of_no_labels(name):
    assert not label_word(name)


@pytest.mark.parametrize(
    "name", ["t_s", "sec", "ms", "Time (ms)", "unix_time", "t [us]", "Timestamps", "elapsed s"]
)
def test_names_of_clocks(name):
    assert names_time(name)


@pytest.mark.parametrize("name", ["e_t", "f_t", "s", "x_s", "us", "timer", "t_e", "deg", "", None])
def test_names_of_no_clocks(name):
    assert not names_time(name)


def test_milliseconds():
    assert in_milliseconds("t_ms")
    assert in_milliseconds("Time [ms]")
    assert not in_milliseconds("time_s")
    assert not in_milliseconds(None)


def test_values_of_labels():
    values = np.repeat([3, 1, 2, 1], 20)
    assert labelled_stretches(values, "run") == 4
    assert labelled_stretches(values.astype(str).astype(object), "run") == 4
    assert labelled_stretches(values, "block") == 0
    assert labelled_stretches(values[:60], "block") == 3
    assert labelled_stretches(values + 0.5, "run") == 0
    assert labelled_stretches(values > 1, "run") == 0
    assert labelled_stretches(np.arange(80), "run") == 0
    assert labelled_stretches(np.array([[1]] * 80 + [None], dtype=object)[:80], "run") == 0
    assert labelled_stretches(values[:0], "run") == 0


def test_values_of_clocks():
    t = np.tile(np.arange(50) * 0.01, 3)
    assert advances_evenly(t)
    assert advances_evenly(t + 0.0002 * np.sin(np.arange(150)))
    assert not advances_evenly(t**2)
    assert not advances_evenly(-t)
    assert not advances_evenly(np.ones(9))
    assert not advances_evenly(t[:2])
