"""What notebooks show: ``_repr_html_`` in a page of its own."""

import pytest
from support.chromium import NOTEBOOK

from skhoid import ARXRegressor, OperatorRegressor, compare, make_tracking_runs
from skhoid.reporting import report


@pytest.fixture(scope="session")
def shown():
    X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    model = ARXRegressor(nk=15).fit(X, y)
    return {
        "report": report(model, X, y, effects=None),
        "arx": model,
        "operator": OperatorRegressor().fit(X, y),
        "comparison": compare(model, X, y),
    }


@pytest.mark.parametrize("width", [400, 1400])
@pytest.mark.parametrize("name", ["report", "arx", "operator", "comparison"])
def test_shows_itself(browser, shown, tmp_path, name, width):
    path = tmp_path / "notebook.html"
    path.write_text(NOTEBOOK.format(shown[name]._repr_html_()), encoding="utf-8")
    browser.open(path, width=width)
    assert browser.console() == []
    assert browser.requests() == []
    assert browser.overflow() <= 0
    assert browser.violations() == []
