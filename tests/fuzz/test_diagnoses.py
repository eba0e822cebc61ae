"""Comparisons, searches for effects, and groups of runs: a whole result, or an error that helps."""

import re

import numpy as np
from hypothesis import strategies as st
from support.drawn_models import REGRESSORS, SEARCHES, models
from support.fuzzing import fuzz, outcome
from support.hostile import BAD_NAMES, good, worsened

import skhoid
from skhoid import ARXRegressor, EffectSearchCV, OperatorRegressor, RecursiveARXCV

LONG = st.sampled_from([60, 100, 150])
COMPARED = {
    "repeats": [None, True, False, ["a", "b"]],
    "run_in": [None, 0.0, 0.5],
    "domain": [None, "human", "machine"],
    "roles": [None, {"e": "e"}, {"stick": "f_t"}, {"nothing": "x"}],
    "dt": [None, 0.01],
}
SEARCHED = {
    "effects": [["bias"], ["tremor"], ["dead_zone", "tv_gain"], "preview", ["saturation"], []],
    "cv": [None, 2, 3],
    "display": [None, "compensatory", "preview"],
    "controlled_element": [None, "1/s", "1/(s(s+1))"],
    "max_effects": [0, 1, 2],
    "domain": [None, "human", "machine"],
    "lost_control": ["leave_out", "keep"],
    "max_rows": [1, 100, None],
}


MILD = ["column", "dtype", "output", "put", "rows", "runs"]  # others are mostly refused


def options_of(data, values):
    """Up to three options, now and then one without sense."""
    names = data.draw(st.lists(st.sampled_from(sorted(values)), max_size=3, unique=True))
    chosen = {name: data.draw(st.sampled_from(values[name])) for name in names}
    if names and not data.draw(st.integers(0, 9)):
        chosen[names[0]] = data.draw(st.sampled_from(BAD_NAMES))
    return chosen


@fuzz(batch=10, fitted=good(lengths=LONG), model=models(*REGRESSORS, bad=False), data=st.data())
def test_compare(fitted, model, data):
    """Of the runs it was fitted on, and of what was made of them."""
    model, error = outcome(model.fit, fitted.X, fitted.y)
    if error is not None:
        return
    given = data.draw(worsened(fitted, MILD, most=1))
    comparison, error = outcome(
        skhoid.compare, model, given.X, given.y, **options_of(data, COMPARED)
    )
    if error is not None:
        return
    text, error = outcome(comparison.summary)
    assert error is None, error
    assert not re.search(r"\bnan\b", str(text))
    _, error = outcome(comparison._repr_html_)
    assert error is None, error


@fuzz(
    batch=3,
    fitted=good(lengths=LONG),
    core=models(ARXRegressor, OperatorRegressor, bad=False),
    data=st.data(),
)
def test_effect_search(fitted, core, data):
    recording = data.draw(worsened(fitted, MILD, most=1))
    X, y = recording.X, recording.y
    options = {"effects": ["bias"], **options_of(data, SEARCHED)}
    search, error = outcome(EffectSearchCV(core, **options).fit, X, y)
    if error is not None:
        return
    predicted, error = outcome(search.predict, X)
    assert error is None, error
    assert np.isfinite(predicted).all()
    assert {"effect", "status", "reason"} <= set(search.ranking_)
    text, error = outcome(search.summary)
    assert error is None, error
    assert not re.search(r"\bnan\b", str(text))


@fuzz(
    recording=good(min_runs=2, lengths=LONG),
    search=models(*SEARCHES, RecursiveARXCV, bad=False),
    data=st.data(),
)
def test_groups(recording, search, data):
    """The runs themselves change nothing, and a group that cuts a run is refused."""
    X, y = recording.X, recording.y
    search.set_params(cv=None)
    plain, error = outcome(search.fit, X, y)
    if error is not None:
        return
    predicted = plain.predict(X)
    runs = skhoid.run_labels(X)
    given = {
        "runs": runs,
        "cut": np.arange(len(X)),
        "short": runs[:-1],
        "nan": np.where(np.arange(len(X)) == 5, np.nan, 1.0),
        "table": np.column_stack([runs, runs]),
        "number": 1.0,
        "text": "run",
    }
    kind = data.draw(st.sampled_from(sorted(given)))
    grouped, error = outcome(search.fit, X, y, groups=given[kind])
    assert (error is None) == (kind == "runs"), f"{kind}: {error}"
    if error is None:
        np.testing.assert_array_equal(grouped.predict(X), predicted)
