"""Reports, written beside those that there are."""

import errno
import os

import pytest

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.lab.explore import Exploration
from skhoid.lab.report.page import Page as ReportPage
from skhoid.lab.workbench.bench import Searched, _is_found

pytestmark = pytest.mark.slow  # reports are made and drawn


def test_the_report_is_saved_and_given_out(fitted):
    names = []
    for _ in range(2):
        reply = fitted.call("report")
        names.append(reply["name"])
        page = fitted.client.get(reply["href"])
        assert page.text.startswith("<!DOCTYPE html>")
        assert "attachment" in page.headers["content-disposition"]
        assert str(fitted.bench.folder.path) in reply["text"]
    assert names == ["report.html", "report-2.html"]
    for name in ("session.json", "..%2fsession.json", "../lock", "report-3.html", "lock"):
        assert fitted.client.get(f"/api/report/{name}").status_code in (404, 405)


def test_a_full_disk_at_the_report(fitted, monkeypatch):
    def full(self, path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), os.fspath(path))

    with monkeypatch.context() as patched:
        patched.setattr(ReportPage, "save", full)
        reply = fitted.post("report", run=0)
    assert reply.status_code == 507
    message = reply.json()["message"]
    assert "The report was not saved" in message
    assert "No space left on device" in message
    assert fitted.call("report")["name"] == "report.html"


def test_only_what_the_search_found_has_its_report(runs):
    X, y = (part.rename(columns={"error": "e"}) if part.ndim == 2 else part for part in runs)
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"]).fit(X, y)
    exploration = Exploration.of_search(search, X, y)
    searched = Searched(search, (0, 1, 2), X, y)
    assert not _is_found(exploration, searched)
    exploration.act("add", {"effect": "bias", "run": 0})
    assert _is_found(exploration, searched)
    exploration.act("release", {"name": "bias__level", "value": 0.2, "run": 0})
    assert not _is_found(exploration, searched)
    exploration.act("refit", {"run": 0})  # with the number of the hand
    assert not _is_found(exploration, searched)
    exploration.act("free", {"name": "bias__level", "run": 0})
    assert _is_found(exploration, searched)
    exploration.act("use", {"runs": [0], "use": "hold", "run": 0})
    assert not _is_found(exploration, searched)


def test_the_report_is_of_the_fitted_runs_and_says_what_was_held_out(fitted):
    fitted.call("use", runs=[0], use="hold")
    page = fitted.client.get(fitted.call("report")["href"]).text
    held = fitted.call("state")["state"]["vaf"]["hold"]
    assert f"VAF {held:.1f} % on" in page
    assert "2 runs, 2048 rows" in page
