"""Summaries of fitted models, as text and in notebooks."""

from __future__ import annotations

import math
import pickle
import re
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from sklearn import config_context
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from skhoid import (
    ARXRegressor,
    DelaySearchCV,
    EffectSearchCV,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARX,
    RecursiveARXCV,
    make_tracking_runs,
)
from skhoid.text import WIDTH, Estimate, estimates_table, number

COLUMNS = ["coef", "std err", "z", "P>|z|", "[0.025", "0.975]"]
NASTY = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        "C1",
        n_runs=3,
        remnant_intensity=0.1,
        sampling_rate=50,
        channels=("e", "f_t"),
        random_state=0,
    )


@pytest.fixture(scope="module")
def arx(runs):
    return ARXRegressor(2, 2, 15, fit_intercept=True).fit(*runs)


@pytest.fixture(scope="module")
def operator(runs):
    return OperatorRegressor(delay=0.28, effects="bias").fit(*runs)


def make_table(text: str) -> dict[str, list[str]]:
    """Cells by parameter of the first table of a summary."""
    lines = text.splitlines()
    head = next(i for i, line in enumerate(lines) if "std err" in line)
    assert lines[head].replace("std err", "std_err").split()[:6] == [
        c.replace(" ", "_") for c in COLUMNS
    ]
    rows = {}
    for line in lines[head + 1 :]:
        if set(line) <= {"-", "="}:
            return rows
        name, *cells = line.split()
        rows[name] = cells
    raise AssertionError("the table has no end")


def gather_facts(text: str) -> str:
    return " ".join(text.split("-" * WIDTH)[0].split())


def check_numbers(rows, names, values, errors, intervals=None):
    assert list(rows) == list(names)
    values, errors = np.array(values), np.array(errors)
    if intervals is None:
        intervals = np.stack([values - 1.96 * errors, values + 1.96 * errors], axis=1)
    for cells, value, sd, ends in zip(rows.values(), values, errors, intervals, strict=True):
        coef, shown, z, p, low, high = cells[:6]
        assert float(coef) == pytest.approx(value, abs=0.06 * sd)
        assert float(shown) == pytest.approx(sd, rel=0.06)
        assert float(z) == pytest.approx(value / sd, abs=0.006)
        right = 2 * norm.sf(abs(value / sd))
        assert p == "<0.001" if right < 0.001 else float(p) == pytest.approx(right, abs=6e-4)
        assert (float(low), float(high)) == pytest.approx(tuple(ends), abs=0.06 * sd)


def check_lines(text):
    assert max(map(len, text.splitlines())) <= WIDTH
    assert not re.search(r"\bnan\b", text)


@pytest.mark.parametrize(
    "model",
    [
        ARXRegressor(2, 2, 15),
        ARXRegressor(2, 1, 15, fit_intercept=True, covariance="hac"),
        ARXRegressor(1, [2, 1], [15, 0], inputs=["e", "f_t"]),
        ARXRegressor(2, 2, 15, method="iv", instruments=["f_t"]),
        RecursiveARX(2, 2, 15, memory_time=5.0),
    ],
    ids=lambda model: str(model).split(" at 0x")[0],  # addresses differ from process to process
)
def test_numbers_are_those_of_the_model(model, runs):
    model.fit(*runs)
    text = model.summary()
    check_lines(text)
    check_numbers(make_table(text), model.parameter_names_, model.coef_, model.standard_errors_)
    assert pickle.loads(pickle.dumps(model)).summary() == text
    # The sd shown is that of the covariance.
    np.testing.assert_allclose(model.standard_errors_**2, np.diag(np.asarray(model.covariance_)))


def test_header_of_a_batch_model(arx, runs):
    X, _ = runs
    facts = gather_facts(arx.summary())
    assert "na = 2, nb = 2, nk = 15, intercept" in facts
    assert "Output: u (deg) Input: e (deg)" in facts
    assert f"Rows: {arx.n_rows_used_} Runs: 3" in facts
    assert "Delay, nk: 15 samples, 0.3 s" in facts
    assert f"Residual sd: {number(math.sqrt(arx.noise_variance_))} deg" in facts
    n, p = arx.n_rows_used_, 5
    fit = n * np.log(arx.noise_variance_ * (n - p) / n)
    assert f"AIC: {fit + 2 * p:.1f} BIC: {fit + p * np.log(n):.1f}" in facts
    assert f"{np.abs(np.roots([1, *arx.a_])).max():.4f}" in facts
    assert make_table(arx.summary())["b0"][-1] == "deg/deg"
    assert X.attrs["units"]["e"] == "deg"


def test_path_of_a_recursive_model(runs):
    model = RecursiveARX(2, 2, 15, memory_horizon=100).fit(*runs)
    text = model.summary(*runs)
    check_lines(text)
    lines = text.split("Path over")[1].splitlines()
    for line, values in zip(lines[2:6], model.coef_path_.T, strict=True):
        name, first, low, at_low, high, at_high, last = line.split()
        low_at, high_at = np.argmin(values), np.argmax(values)
        assert name in model.parameter_names_
        assert [float(x) for x in (first, low, high, last)] == pytest.approx(
            values[[0, low_at, high_at, -1]], rel=1e-3
        )
        assert [float(at_low), float(at_high)] == pytest.approx(model.time_path_[[low_at, high_at]])
    facts = gather_facts(text)
    assert "Memory: N0 = 100 samples, 2 s (λ = 0.99)" in facts
    assert f"{model.n_updates_} updates Runs: 3, pooled" in facts
    assert "Protection: forgetting held back at 0 instants" in facts


def test_operator_with_an_effect(operator):
    text = operator.summary()
    check_lines(text)
    rows = make_table(text)
    assert list(rows) == operator.parameters_.index.tolist()
    assert rows["tau_e"] == ["0.28", *"-----", "s"]  # given
    free = operator.parameters_[operator.parameters_["sd"] > 0]
    shown = {n: rows[n] for n in free.index}
    intervals = free[["low", "high"]].to_numpy()
    check_numbers(shown, free.index, free["value"], free["sd"], intervals)
    assert rows["K_e"][-1] == "deg/deg"
    facts = gather_facts(text)
    assert "Effects: bias" in facts
    assert f"VAF, fit: {operator.vaf_:.1f} %" in facts
    assert f"BIC: {operator.bic_:.1f}" in facts
    assert operator.effects_.steps[0][1].formula in " ".join(text.split())


def test_small_and_large_numbers_keep_the_digits_that_count():
    assert number(-1.94235678, 0.00031) == "-1.94236"
    assert number(1.25e-9, 3e-11) == "1.25e-09"
    assert number(123456.0, 3400.0) == "123456"
    assert number(np.nan) == "-"
    frame = pd.DataFrame(
        {"value": [1.0], "sd": [np.nan], "low": [np.nan], "high": [np.nan], "unit": ["-"]},
        index=["a1"],
    )
    assert estimates_table(frame).rows == [["a1", "1", *"-----"]]


UNFITTED = [
    ARXRegressor(2, 2, 15),
    RecursiveARX(2, 2, 15),
    RecursiveARXCV([64, np.inf], nk=15),
    OperatorRegressor(),
    DelaySearchCV(ARXRegressor(), nk=[6, 7]),
    OrderSearchCV(ARXRegressor(), na=[1, 2], nb=[1], nk=[15]),
    EffectSearchCV(OperatorRegressor(), effects=["bias"]),
]


@pytest.mark.parametrize("model", UNFITTED, ids=lambda m: type(m).__name__)
def test_notebook_display(model, runs):
    with pytest.raises(NotFittedError):
        model.summary()
    plain = model._repr_html_()
    assert "skhoid-summary" not in plain
    fitted = clone(model).fit(*runs)
    html = fitted._repr_html_()
    assert fitted._repr_mimebundle_()["text/html"].count("skhoid-summary") == html.count(
        "skhoid-summary"
    )
    assert "sk-top-container" in html
    found = Shown.of(html)
    assert "std err" in found.headers
    last = getattr(fitted, "best_estimator_", fitted)
    names = getattr(last, "parameters_", None)
    names = last.parameter_names_ if names is None else names.index.tolist()
    assert found.rows[: len(names)] == names
    with config_context(display="text"):
        assert not hasattr(fitted, "_repr_html_")
        assert "text/html" not in fitted._repr_mimebundle_()


@pytest.mark.parametrize("kind", ["two inputs", "search", "operator"])
def test_names_cannot_run(kind, runs):
    X, y = runs
    X = X[["e", "f_t"]].rename(columns={"e": NASTY, "f_t": "<img src=x onerror=alert(2)>"})
    X.attrs = {"units": {NASTY: NASTY, X.columns[1]: "<u>"}}
    y = y.rename("\"'><svg onload=alert(3)>")
    y.attrs = {"units": {y.name: NASTY}}
    model = {
        "two inputs": ARXRegressor(2, 2, 15),
        "search": DelaySearchCV(ARXRegressor(), nk=[6, 7]),
        "operator": OperatorRegressor(inputs=[NASTY]),
    }[kind]
    html = model.fit(X, y)._repr_html_()
    for tag in ("<script>alert", "<img", "<svg", "<u>"):
        assert tag not in html
    assert "alert(1)" in html  # it is shown, as text
    shown = Shown.of(html)
    assert set(shown.tags) <= {"style", "div", "p", "table", "caption", "thead", "tbody"} | {
        "tr", "th", "td", "strong", "ul", "li"
    }  # fmt: skip


class Shown(HTMLParser):
    """Tags, column headers and row headers of what stands below scikit-learn's diagram."""

    def __init__(self):
        super().__init__()
        self.tags, self.headers, self.rows, self.scope = [], [], [], ""

    @classmethod
    def of(cls, html):
        parser = cls()
        parser.feed(html[html.rindex("<style>") :])
        return parser

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.scope = dict(attrs).get("scope", "")

    def handle_endtag(self, tag):
        self.scope = ""

    def handle_data(self, data):
        if self.scope:
            (self.headers if self.scope == "col" else self.rows).append(data)


@pytest.mark.parametrize(
    ("value", "sd", "unit", "shown"),
    [
        (0.31234, 0.0041, "deg", "0.3123 ± 0.0041 deg"),
        (2.0, 0.1, "-", "2.00 ± 0.10"),
        (0.28, 0.0, "s", "0.28 s"),
        (0.28, np.nan, "s", "0.28 s (at its bound)"),
        (1234.56, 78.9, "", "1235 ± 79"),
    ],
)
def test_an_estimate_in_a_sentence(value, sd, unit, shown):
    ends = {"low": value - 2 * sd, "high": value + 2 * sd}
    found = Estimate.of(pd.Series({"value": value, "sd": sd, **ends, "unit": unit}))
    assert str(found) == shown
    assert found.known == bool(sd > 0)
    assert {found.low, found.high} == {"-"} or found.known


def test_an_estimate_at_its_bound_has_an_interval_on_one_side():
    row = pd.Series({"value": 0.0, "sd": np.nan, "low": 0.0, "high": 0.25, "unit": "s"})
    found = Estimate.of(row)
    assert str(found) == "0 s (at its bound)"
    assert (found.low, found.high) == ("0", "0.25")
    inside = Estimate.of(pd.Series({**row, "value": 0.1}))
    assert str(inside) == "0.1 s (not determined)"
    assert {inside.low, inside.high} == {"-"}
