"""``explore()`` in a notebook: what the page asks, the kernel answers."""

import pickle
import sys
import time

import numpy as np
import pytest
from support.envelopes import unpack_text

from skhoid import OperatorRegressor, compare
from skhoid.lab.explore import payloads as wire

pytestmark = pytest.mark.slow  # a search first


@pytest.fixture
def widget(search, runs):
    pytest.importorskip("anywidget")
    made = search.explore(*runs)
    made.sent = []
    made.send = lambda content, buffers=None: made.sent.append(
        (content, wire.unpack(bytes(buffers[0])))
    )
    return made


def ask(widget, number, name, **args):
    widget._handle_custom_msg({"id": number, "name": name, "args": args}, [])
    return next(value for content, value in widget.sent if content["id"] == number)


def test_the_view_comes_first(widget):
    view = ask(widget, 1, "view")["reply"]["view"]
    assert [run["label"] for run in view["runs"]] == ["0", "1", "2"]
    assert view["can"]["drag"]
    assert not view["can"]["search"]


def test_an_effect_is_added_by_the_kernel(widget):
    assert widget.exploration.state()["to_add"] == []  # it opens at the result
    ask(widget, 0, "undo", run=1)
    reply = ask(widget, 1, "add", effect="bias", run=1)["reply"]
    model = widget.exploration.model
    assert [name for name, _ in model.effects_] == ["bias"]
    assert "No effect is called" in ask(widget, 2, "add", effect="nothing", run=0)["error"]
    assert reply["simulated"].shape == (1024,)
    assert reply["state"]["vaf"]["train"] == widget.exploration.state()["vaf"]["train"]


def test_the_noise_ceiling_comes_later_on_its_own(widget):
    ask(widget, 1, "add", effect="bias", run=0)
    for _ in range(200):
        unasked = [value for content, value in widget.sent if content["id"] is None]
        if unasked:
            break
        time.sleep(0.05)
    assert not unasked[0]["state"]["ceiling_pending"]


def test_a_search_that_was_pickled_needs_its_data(search, runs):
    pytest.importorskip("anywidget")
    X, y = runs
    other = pickle.loads(pickle.dumps(search))
    for given, message in [
        ((), "no longer in memory: pass them"),
        ((X,), "both X and y"),
        ((X, -y), r"y .* is not that output"),
        ((-X, y), "fitted to another X"),
    ]:
        with pytest.raises(ValueError, match=message):
            other.explore(*given)


def test_a_comparison_needs_no_kernel(runs):
    pytest.importorskip("anywidget")
    found = compare(OperatorRegressor().fit(*runs), *runs).explore()
    payload = unpack_text(found.payload)
    np.testing.assert_allclose(
        payload["traces"][0]["measured"], runs[1][0], atol=np.ptp(runs[1]) / 65_533
    )


def test_without_anywidget_it_says_what_to_install(search, runs, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(ImportError, match=r'pip install "skhoid\[notebook\]"'):
        search.explore(*runs)
