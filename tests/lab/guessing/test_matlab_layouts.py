"""MATLAB files in the layouts that labs use: what is read is what was written."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat
from support.mat5 import opaque
from support.mat73 import write_mat73

from skhoid import read_runs
from skhoid.lab.cli import main

DT = 0.01


def column(values):
    return np.asarray(values)[:, None]


def cells(*items):
    found = np.empty((1, len(items)), object)
    for number, item in enumerate(items):
        found[0, number] = item
    return found


def structs(*items):
    found = np.empty((1, len(items)), dtype=[(name, object) for name in items[0]])
    for number, item in enumerate(items):
        found[0, number] = tuple(item.values())
    return found


def recording(seed, n):
    rng = np.random.default_rng(seed)
    target = np.convolve(rng.standard_normal(n), np.ones(50) / 7, "same")
    x = np.convolve(target, np.r_[np.zeros(15), np.ones(20) / 20])[:n]
    u = np.convolve(target - x, np.r_[np.zeros(20), np.ones(10) / 10])[:n]
    u += 0.01 * rng.standard_normal(n)
    return {"t": np.arange(n) * DT, "e": target - x, "u": u, "target": target, "x": x}


ONE = recording(0, 600)
SEVERAL = [recording(seed, 400 + 50 * seed) for seed in range(3)]
t, e, u, target, x = ONE.values()
M = np.c_[t, target, x, u]
NAMES = ["time", "target", "x", "stick"]


def fields(number, *names):
    return {name: column(SEVERAL[number][name]) for name in names or ("t", "e", "u")}


OF_ONE = {
    "names in a cell": {"data": M, "names": cells(*NAMES)},
    "names in rows of text": {"X": M, "varnames": np.array([f"{name:6}" for name in NAMES])},
    "names in one text": {"X": M, "header": ",".join(NAMES)},
    "rows": {"channels": M.T, "channelNames": cells(*NAMES)},
    "importdata": {"A": {"data": M, "textdata": cells(*NAMES), "colheaders": cells(*NAMES)}},
    "EEGLAB": {
        "EEG": {
            "data": np.c_[e, u].T,
            "srate": 100.0,
            "chanlocs": structs({"labels": "error", "type": ""}, {"labels": "stick", "type": ""}),
            "times": t[None] * 1000,
        }
    },
    "dSPACE": {
        "rec001": {
            "X": {"Name": "time", "Data": t},
            "Y": structs(
                *({"Name": n, "Unit": "", "Data": v[None]} for n, v in (("error", e), ("stick", u)))
            ),
        }
    },
    "structure with time": {
        "out": {
            "time": t,
            "signals": structs(
                *({"values": column(v), "label": n} for n, v in (("error", e), ("stick", u)))
            ),
        }
    },
    "one structure for each": {
        name: {"time": column(t), "signals": {"values": column(v), "label": ""}}
        for name, v in (("e", e), ("u", u))
    },
    "signals by name": {
        "sig": structs(*({"name": n, "data": column(v)} for n, v in (("error", e), ("stick", u)))),
        "fs": 100.0,
    },
    "a struct for each signal": {
        "log": {n: {"time": column(t), "value": column(v)} for n, v in (("error", e), ("stick", u))}
    },
    "iddata as struct": {
        "z": {"InputData": column(e), "OutputData": column(u), "Ts": DT, "InputName": cells("e")}
    },
    "empties and labels": {
        "t": column(t),
        "error": column(e),
        "stick": column(u),
        "run": 3.0,
        **{
            f"empty{k}": np.zeros(shape) for k, shape in enumerate([(3, 0), (0, 0), (1, 0), (0, 5)])
        },
        "subject": "S01",
        "condition": "lead",
        "markers": np.arange(17.0),
        "notes": cells(),
    },
    "timeseries as structs": {
        name: {"Name": name, "Time": column(t), "Data": v[None, None]}
        for name, v in (("e", e), ("u", u))
    },
    "matrices of one build": {
        "inputs": np.c_[t, e],
        "inputNames": cells("time", "error"),
        "outputs": np.c_[t, u],
        "outputNames": cells("time", "stick"),
    },
    "a struct a sample": {
        "S": structs(
            *({"time": a, "error": b, "stick": c} for a, b, c in zip(t, e, u, strict=True))
        )
    },
    "a cell of vectors": {
        "header": cells("time", "error", "stick"),
        "log": cells(column(t), column(e), column(u)),
    },
    "scope": {
        "ScopeData": {
            "time": column(t),
            "signals": structs(
                *(
                    {"values": column(v), "label": "", "title": n}
                    for n, v in (("error", e), ("stick", u))
                )
            ),
        }
    },
    "structs in structs": {
        "D": {"Position": {"target": column(target), "actual": column(x)}, "Stick": u, "fs": 100}
    },
}
OF_SEVERAL = {
    "structs of one build": {f"run{k + 1}": fields(k) for k in range(3)},
    "below another": {"data": {f"trial_{k}": fields(k) | {"gain": 2.0} for k in range(3)}},
    "a cell of structs": {"runs": cells(*map(fields, range(3)))},
    "a cell of matrices": {
        "data": cells(*(np.c_[r["t"], r["e"], r["u"]] for r in SEVERAL)),
        "header": "time,error,stick",
    },
    "cells side by side": {
        name: cells(*(column(r[key]) for r in SEVERAL))
        for name, key in (("time", "t"), ("error", "e"), ("stick", "u"))
    },
    "matrices": {
        **{f"trial{k}": np.c_[r["t"], r["e"], r["u"]] for k, r in enumerate(SEVERAL)},
        "labels": cells("t", "error", "stick"),
    },
    "numbered vectors": {f"{n}{k}": v for k in range(3) for n, v in fields(k).items()},
    "structs in a struct array": {
        "trial": structs(
            *({"t": fields(k)["t"], "sig": fields(k, "e", "u"), "id": f"r{k}"} for k in range(3))
        )
    },
    "named matrices": {
        "trial": structs(
            *(
                {"name": f"S{k}", "data": np.c_[r["t"], r["e"], r["u"]]}
                for k, r in enumerate(SEVERAL)
            )
        ),
        "labels": cells("t", "error", "stick"),
    },
    "people": {"anna": {"run1": fields(0), "run2": fields(1)}, "ben": {"run1": fields(2)}},
    "a field that one run has": {
        "run1": fields(0, "t", "e", "u", "x"),
        "run2": fields(1),
        "run3": fields(2),
    },
}


def check(path, expected, atol=1e-9):
    X, y = read_runs(path)
    np.testing.assert_allclose(X["e"], np.concatenate([r["e"] for r in expected]), atol=1e-12)
    np.testing.assert_array_equal(y, np.concatenate([r["u"] for r in expected]))
    time = np.concatenate([r["t"] for r in expected])
    np.testing.assert_allclose(X.index.get_level_values("time"), time, atol=atol)
    assert X.index.unique("run").size == len(expected)


@pytest.mark.parametrize("content", OF_ONE.values(), ids=OF_ONE)
def test_one_run(tmp_path, content):
    savemat(tmp_path / "a.mat", content)
    check(tmp_path / "a.mat", [ONE])


@pytest.mark.parametrize("content", OF_SEVERAL.values(), ids=OF_SEVERAL)
def test_several_runs(tmp_path, content):
    savemat(tmp_path / "a.mat", content)
    check(tmp_path / "a.mat", SEVERAL)


V73 = {
    "struct array": ({"trial": [fields(k) for k in range(3)]}, SEVERAL),
    "cell of structs": ({"runs": tuple(map(fields, range(3)))}, SEVERAL),
    "names in a cell": ({"D": M, "channels": tuple(NAMES)}, [ONE]),
    "dSPACE": (
        {
            "rec": {
                "X": [{"Name": "", "Data": t[None]}],
                "Y": [{"Name": "Model/Error", "Data": e[None]}, {"Name": "stick", "Data": u[None]}],
            }
        },
        [ONE],
    ),
    "structure with time": (
        {
            "logs": {
                "time": column(t),
                "signals": [{"values": column(v), "label": n} for n, v in (("e", e), ("u", u))],
            }
        },
        [ONE],
    ),
    "empties and text": (
        {"d": {"t": column(t), "e": column(e), "u": column(u), "z": np.zeros((0, 3)), "s": "ab"}},
        [ONE],
    ),
}


@pytest.mark.parametrize(("content", "expected"), V73.values(), ids=V73)
def test_version_73(tmp_path, content, expected):
    write_mat73(tmp_path / "a.mat", content)
    check(tmp_path / "a.mat", expected)


@pytest.mark.parametrize("name", ["CMD(:,{})", "CMD:{}"])
@pytest.mark.parametrize("clock", ["", "Ts", "T_e", "Ta"])
def test_columns_of_a_matrix_are_named(tmp_path, name, clock):
    own = M[:, 1:] if clock else M
    savemat(tmp_path / "a.mat", {"CMD": own, clock or "Ts": DT})
    *_, a, b, c = (name.format(k + 1) for k in range(own.shape[1]))
    X, y = read_runs(tmp_path / "a.mat", inputs={a: "f_t", b: "x"}, output={c: "u"})
    np.testing.assert_array_equal(X["x"], x)
    np.testing.assert_array_equal(y, u)
    assert X.index.get_level_values("time")[1] == pytest.approx(DT)


@pytest.mark.parametrize("named", ["rec.Y(2).Data", "k{2}.u", "w(:,2)", "w:2"])
def test_what_one_types_in_matlab_is_found(tmp_path, named):
    content = {
        "t": column(t),
        "e": column(e),
        "rec": {"Y": structs({"Data": e[None]}, {"Data": u[None]})},
        "k": cells({"u": e[None], "n": "a"}, {"u": u[None], "n": "b"}),
        "w": np.c_[e, u],
        "v": np.c_[e, u],
    }
    savemat(tmp_path / "a.mat", content)
    _, y = read_runs(tmp_path / "a.mat", inputs="e", output={named: "u"}, time="t")
    np.testing.assert_array_equal(y, u)


def test_numpy_archives_are_alike(tmp_path):
    np.savez(tmp_path / "a.npz", data=M, columns=np.array(NAMES))
    check(tmp_path / "a.npz", [ONE])
    np.savez(tmp_path / "b.npz", **{f"{n}{k}": v for k in range(3) for n, v in fields(k).items()})
    check(tmp_path / "b.npz", SEVERAL)
    np.savez(tmp_path / "c.npz", record=np.c_[e, u], other=np.c_[u, e], fs=100.0)
    X, y = read_runs(tmp_path / "c.npz", inputs={"record:1": "e"}, output={"record(:,2)": "u"})
    np.testing.assert_array_equal(X["e"], e)
    np.testing.assert_array_equal(y, u)


def test_matrices_of_one_shape_are_runs_also_beside_as_many_labels(tmp_path):
    three = np.random.default_rng(0).standard_normal((2, 400, 3))
    content = {"e": three[0], "u": three[1], "dt": DT, "conditions": cells("a", "b", "c")}
    savemat(tmp_path / "a.mat", content)
    X, y = read_runs(tmp_path / "a.mat")
    assert X.index.unique("run").size == 3
    np.testing.assert_array_equal(y, three[1].T.ravel())


@pytest.mark.parametrize("form", [739_000.0, 45_000.0])  # datenum, Excel
def test_a_clock_in_days(tmp_path, capsys, form):
    savemat(tmp_path / "a.mat", {"time": form + t / 86400, "e": e, "u": u})
    X, _ = read_runs(tmp_path / "a.mat")
    np.testing.assert_allclose(X.index.get_level_values("time"), t, atol=2e-5)
    assert '"time" is read as seconds from its first row' in capsys.readouterr().out


@pytest.mark.parametrize("late", [1, 30, 31.5])
def test_signals_with_clocks_of_their_own(tmp_path, capsys, late):
    """The later signal begins some rows after the other, and not always on its instants."""
    own = t[40:] + late * DT
    stick = np.interp(own, t, u)
    content = {
        "log": {
            "error": {"time": t, "value": e},
            "stick": {"time": own[own < 5], "value": stick[own < 5]},
        }
    }
    savemat(tmp_path / "a.mat", content)
    X, y = read_runs(tmp_path / "a.mat")
    assert "clocks that differ" in capsys.readouterr().out
    time = X.index.get_level_values("time").to_numpy()
    first = np.flatnonzero(np.isclose(X["e"].iloc[0], e))[0]
    np.testing.assert_allclose(X["e"], np.interp(t[first] + time, t, e), atol=1e-9)
    np.testing.assert_allclose(y, np.interp(t[first] + time, t, u), atol=0.05)  # noise of 0.01
    assert t[first] >= own[0] - 1e-9


CONVERTED = {
    "timeseries": "squeeze",
    "timetable": "writetimetable|writetable",
    "table": "writetable",
    "iddata": "InputData",
    "Simulink.SimulationData.Dataset": "numElements",
    "Simulink.SimulationOutput": "out.logsout",
    "lab.Recording": "plain arrays",
}


@pytest.mark.parametrize(("matlab_class", "line"), CONVERTED.items())
def test_an_object_is_named_with_what_converts_it(tmp_path, capsys, matlab_class, line):
    path = tmp_path / "a.mat"
    savemat(path, {"tout": column(t)})
    with path.open("ab") as file:
        file.write(opaque(b"out", matlab_class.encode()))
    assert main(["diagnose", str(path)]) == 2
    said = capsys.readouterr().err
    assert "'out' is a MATLAB object" in said
    assert matlab_class in said
    assert any(part in said for part in line.split("|"))


@pytest.mark.parametrize("version", ["v7", "v7.3"])
@pytest.mark.parametrize("kind", ["timedelta", "datetime"])
@pytest.mark.filterwarnings("ignore")  # of mat-io
def test_a_timetable_is_opened_by_mat_io(tmp_path, version, kind):
    matio = pytest.importorskip("matio")
    times = pd.to_timedelta(t, unit="s")
    times = times if kind == "timedelta" else pd.Timestamp("2024-05-01") + times
    table = pd.DataFrame({"error": e, "stick": u}, index=times.rename("Time"))
    matio.save_to_mat(str(tmp_path / "a.mat"), {"T": table}, version=version)
    check(tmp_path / "a.mat", [ONE], atol=1e-6)  # instants are in ms, as floats


@pytest.mark.parametrize("label", ["SCENARIO", "condition", "run", "trial", "subject"])
@pytest.mark.parametrize("kind", [np.uint8, np.float32, bool])
def test_a_label_without_signals_is_a_list_of_problems(tmp_path, capsys, label, kind):
    a, b = np.random.default_rng(0).standard_normal((2, 400))
    savemat(tmp_path / "a.mat", {"sigA": a, "sigB": b, label: np.zeros(400, kind)})
    assert main(["diagnose", str(tmp_path / "a.mat")]) == 2
    assert "problems" in capsys.readouterr().err
