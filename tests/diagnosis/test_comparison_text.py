"""A comparison as text, as HTML and as numbers."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.comparisons import altered
from support.page import parse

from skhoid import ARXRegressor, compare, make_tracking_runs
from skhoid.recordings import Finding
from skhoid.text import Note

EVIL = "<script>alert('x')</script> & more"


@pytest.fixture(scope="module")
def comparison():
    X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    return compare(ARXRegressor(nk=15).fit(X, y), X, y)


def test_text_html_and_numbers_tell_the_same(comparison):
    finding = Finding("bias", "An offset", "p < 1e-6", "A trim", "Subtract it", "")
    c = replace(comparison, findings=[finding], notes=[Note("kind", "one row is left out", "f()")])
    text, page = " ".join(c.summary().split()), parse(c._repr_html_()).text
    for said in (f"{c.vaf:.1f} %", "An offset", "p < 1e-6", "A trim", "Subtract it", "f()"):
        assert said in text
        assert said in page
    found = json.loads(json.dumps(c.as_dict()))
    assert found["vaf"] == c.vaf
    assert found["findings"][0]["title"] == "An offset"
    assert found["notes"] == ["one row is left out"]


def test_names_in_the_data_are_text(comparison):
    finding = Finding("bias", EVIL, EVIL, EVIL, EVIL, "")
    runs = comparison.by_run.assign(run=EVIL)
    c = altered(comparison, output=EVIL, findings=[finding], by_run=runs, notes=[Note("a", EVIL)])
    page = c._repr_html_()
    assert "<script" not in page
    assert parse(page).text.count(EVIL) == 1 + 4 + len(runs) + 1


def test_of_many_runs_those_of_lowest_vaf_are_listed(comparison):
    runs = comparison.by_run.loc[[0] * 40].reset_index(drop=True)
    runs["vaf"] = np.random.default_rng(0).permutation(40).astype(float)
    text = altered(comparison, by_run=runs).summary()
    head, _, listed = text.partition("Runs, the 12 with the lowest VAF of 40\n")
    assert head
    rows = [line.split() for line in listed.splitlines()[1:13]]
    assert [float(row[2]) for row in rows] == list(range(12))
    assert "lowest" not in altered(comparison, by_run=runs[:12]).summary()
