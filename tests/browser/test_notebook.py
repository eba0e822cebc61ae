"""What notebooks show: ``_repr_html_`` in a page of its own."""

import pytest
from support.chromium import NOTEBOOK

from skhoid import (
    ARXRegressor,
    EffectSearchCV,
    OperatorRegressor,
    compare,
    make_tracking_runs,
)
from skhoid.lab.report import report


@pytest.fixture(scope="session")
def shown():
    X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    model = ARXRegressor(nk=15).fit(X, y)
    compared = compare(model, X, y)
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"]).fit(X, y)
    return {
        "report": report(model, X, y, effects=None),
        "arx": model,
        "operator": OperatorRegressor().fit(X, y),
        "comparison": compared,
        "summary": model.summary(),
        "summary of a comparison": compared.summary(),
        "search": search,
        "summary of a search": search.summary(),
        "finding": compared.findings[0],
    }


SHOWN = (
    "report",
    "arx",
    "operator",
    "comparison",
    "summary",
    "summary of a comparison",
    "search",
    "summary of a search",
    "finding",
)


@pytest.mark.parametrize("colours", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1400])
@pytest.mark.parametrize("name", SHOWN)
def test_shows_itself(browser, shown, tmp_path, name, width, colours):
    path = tmp_path / "notebook.html"
    path.write_text(NOTEBOOK.format(shown[name]._repr_html_()), encoding="utf-8")
    browser.open(path, width=width, colours=colours)
    assert browser.console() == []
    assert browser.requests() == []
    assert browser.overflow() <= 0
    assert browser.violations() == []
