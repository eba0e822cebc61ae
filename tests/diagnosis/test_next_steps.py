"""Advice fits the model that is at hand."""

import ast
import re

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import LinearRegression
from support.hidden_effects import simulate_runs
from support.places import ROOT

from skhoid import ARXRegressor, DelaySearchCV, OperatorRegressor, compare
from skhoid.diagnosis.findings import NextSteps
from skhoid.recordings import check_channels

LATER, EARLIER = 0.08, -0.04
ESTIMATED = "The model estimates its delay: fit it on runs of the same condition, or search what"


@pytest.fixture(scope="module")
def runs():
    X, y, _ = simulate_runs("C1", 2, seed=0, sampling_rate=25.0, oversampling=4)
    return X, y


@pytest.mark.parametrize(
    ("model", "seconds", "step"),
    [
        (ARXRegressor(nk=8), LATER, r"Search the delay again \(DelaySearchCV\)"),
        (DelaySearchCV(ARXRegressor(), nk=[7, 8]), EARLIER, r"\(DelaySearchCV\)"),
        (OperatorRegressor(delay=0.2), LATER, "was given as 0.2 s: delay=None, or .*wrong_delay"),
        (OperatorRegressor(delay=0.2), EARLIER, "was given as 0.2 s: delay=None, or .*wrong_delay"),
        (OperatorRegressor(), LATER, ESTIMATED),
        (OperatorRegressor(delay=0.2, effects="wrong_delay"), LATER, ESTIMATED),
        (LinearRegression(), LATER, "0.08 s more"),
        (LinearRegression(), EARLIER, "0.04 s less"),
    ],
    ids=lambda value: repr(value) if hasattr(value, "fit") else "",
)
def test_delay(runs, model, seconds, step):
    X, y = runs
    with pytest.MonkeyPatch.context() as patch:
        # An operator's fit is slow, and its parameters say all that is asked here.
        patch.setattr(OperatorRegressor, "fit", lambda self, X, y: self)
        then = NextSteps(model.fit(X, y))
    assert re.search(step, then.delay(seconds))


def test_a_wrong_delay_of_an_operator_is_told(runs):
    X, y = runs
    found = compare(OperatorRegressor(delay=0.2).fit(X, y), X, y).findings
    (delay,) = [finding for finding in found if finding.name == "delay"]
    assert "off by 2 samples" in delay.evidence
    assert delay.next_step.startswith("Free the delay, which was given as 0.2 s")


# A call, an argument, a value, or a class: what only those who write Python understand.
PYTHON = re.compile(r"\w\(|[a-z_]\w*=(?!ms)|\bNaN\b|\b(None|False)\b|[A-Z]\w*(CV|Regressor|ARX)\b")


@pytest.mark.parametrize(
    "model",
    [
        ARXRegressor(nk=8),
        ARXRegressor(nk=8, fit_intercept=True),
        OperatorRegressor(),
        OperatorRegressor(delay=0.2, effects="bias"),
        LinearRegression(),
    ],
    ids=repr,
)
def test_at_the_command_line_steps_are_typed(runs, model):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(OperatorRegressor, "fit", lambda self, X, y: self)
        then = NextSteps(model.fit(*runs))
    steps = [then.leak(), then.bias(), then.level(), then.change(), then.drift(), then.unknown()]
    steps += [then.asymmetry(), then.overfit(), then.overfit(False), then.delay(LATER)]
    steps += [then.nonlinearity(harder) for harder in (True, False)]
    steps += [then.follow(signal) for signal in ("f_t", "dist", "e")]
    for step in steps:
        assert not PYTHON.search(step.typed), step.typed


def test_words_of_python_have_others_beside_them():
    for path in (
        ROOT / "skhoid" / "diagnosis" / "findings.py",
        ROOT / "skhoid/recordings/channels.py",
    ):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for call in ast.walk(tree):
            if not isinstance(call, ast.Call) or getattr(call.func, "id", "") != "Finding":
                continue
            for part in ast.walk(call.args[4]) if not _is_step(call.args[4]) else ():
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    assert not PYTHON.search(part.value), part.value


def _is_step(node):
    return any(isinstance(part, ast.Call) for part in ast.walk(node))


def test_one_is_not_many(runs):
    X, y = runs
    model = ARXRegressor(nk=8).fit(X, y)
    y = y.copy()
    y.iloc[200] = np.nan
    X = pd.DataFrame({"x": X["e"].to_numpy()})
    X.iloc[200] = np.nan
    notes = [str(note) for note in compare(model, runs[0], y).notes]
    assert "1 row in which the output is missing is left out" in notes
    (missing,) = check_channels(X, dt=0.04)
    assert missing.title == "x has 1 missing sample"
    assert "rows is missing or infinite, the longest stretch 1 row (0.04 s)" in missing.evidence
