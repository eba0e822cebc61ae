"""What identifies a study: seeds and folders outlive the move and the rewriting of code."""

import copy
import importlib.util
import json
import sys

import numpy as np
import pandas as pd
import pytest

from skhoid import MonteCarloStudy, tracking_condition
from skhoid.effects import DeadZone

SHORT = {"duration": 5.12, "run_in": 2.0, "remnant_gain": 0.02}


def drawn(data, nk=29):
    return data.random_state


def identity(value):
    """What a study's description says of a value in its cells."""
    study = MonteCarloStudy(drawn, [{"condition": "C1", "nk": value}])
    return study.description["cells"][0]["nk"]


def test_seeds_of_numbers_text_and_dataclasses():
    """The numbers are those of commit 992cbae, but the last: dead zones have a place since."""
    cells = [
        {"condition": "C1"},
        {"condition": "C3", "remnant_order": "nm", "nk": 30},
        {"condition": tracking_condition("C4"), "perturbation": {"K_e": 0.1}},
        {"condition": "C2", "effects": DeadZone(width=0.1)},
    ]
    study = MonteCarloStudy(drawn, cells, 2, simulation=SHORT, random_state=7)
    assert list(study.run()["value"]) == [
        3854802803, 792157817, 2384964344, 2460302152, 244030074, 3394935553, 4136073076,
        2104981057,
    ]  # fmt: skip


MODULE = """
import enum, functools

SCALE = 2.0

class Shade(enum.Enum):
    DARK = 1

class Model:
    def __init__(self, nk): self.nk, self.shade = nk, Shade.DARK
    def __call__(self, data): return self.nk
    def method(self, data): return type(self).__name__

def power(data):
    return SCALE * (data.y**2).mean()

def local(data):
    class Inner: pass
    return Inner

functions = [Model(3), Model(3).method, Model, power, local, functools.partial(local, Model),
             lambda data: (__name__, __file__, Model)]
others = [Model(4), Model(4).method, Shade, local, Model.method, functools.partial(local, Shade),
          lambda data: (__name__, Model)]
"""


@pytest.fixture
def modules(tmp_path, monkeypatch):
    """The same module twice, under other names and in other places."""
    made = []
    for name in ("one", "two"):
        path = tmp_path / f"{name}.py"
        path.write_text(MODULE, encoding="utf-8")
        spec = importlib.util.spec_from_file_location(name, path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        monkeypatch.setitem(sys.modules, name, module)  # so that objects of it can be pickled
        made.append(module)
    return made


def test_no_description_holds_a_module(modules):
    one, two = ([[identity(x) for x in y] for y in (m.functions, m.others)] for m in modules)
    assert one == two
    assert all(first != second for first, second in zip(*one, strict=True))


def test_a_module_that_moves_changes_neither_seeds_nor_folders(modules, tmp_path):
    options = {"simulation": SHORT, "random_state": 5}
    one, two = (
        MonteCarloStudy(m.power, {"condition": ["C1", "C2"]}, 2, **options) for m in modules
    )
    assert one.description == two.description
    table = one.run(tmp_path / "new")
    pd.testing.assert_frame_equal(two.run(), table, check_exact=True)
    pd.testing.assert_frame_equal(two.run(tmp_path / "new"), table, check_exact=True)
    assert json.loads((tmp_path / "new" / "study.json").read_text())["entropy"] == "5"


def made(step):
    def function(data):
        return step

    return function


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (made(1), made(2)),
        ((lambda data: 1), (lambda data: 2)),
        (DeadZone(width=0.1), DeadZone(width=0.2)),
        (np.arange(3), np.arange(3.0)),
        (pd.Series([1, 2]), pd.Series([1, 3])),
    ],
)
def test_different_values_have_different_identities(one, other):
    assert identity(one) != identity(other)
    assert identity(one) == identity(copy.deepcopy(one))
