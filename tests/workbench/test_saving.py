"""Reports, written beside those that there are."""

import errno
import os

import pytest

from skhoid.reporting.page import Page as ReportPage

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
