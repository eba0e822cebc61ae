"""Studies: what a data set is, whatever surrounds it; what functions may return; what fails."""

import numpy as np
import pandas as pd
import pytest

from skhoid import (
    CompensatoryTask,
    MonteCarloStudy,
    RemnantIntensityError,
    make_tracking_runs,
)
from skhoid.effects import DeadZone
from skhoid.exceptions import StudyWarning

SHORT = {"duration": 5.12, "run_in": 2.0}  # s; to be quick
NOISE = SHORT | {"remnant_gain": 0.02}
CELLS = {"condition": ["C1", "C3"], "remnant_order": [1, "nm"]}
OWN = ["error", "seed"]


def fingerprint(data):
    """Numbers that any change of the data set changes."""
    found = {name: getattr(data.record, name).sum() for name in ("e", "u", "f_t")}
    if data.validation is not None:
        found["validation"] = data.validation.y.sum()
    return found | {"random_state": data.random_state}


def study(function=fingerprint, conditions=CELLS, n=4, **options):
    options = {"simulation": NOISE, "random_state": 7} | options
    return MonteCarloStudy(function, conditions, n, **options)


@pytest.fixture(scope="module")
def table():
    return study().run()


@pytest.mark.parametrize(
    "change",
    [
        {"conditions": {"condition": ["C2", "C3", "C1"], "remnant_order": ["nm", 3, 1]}},
        {"conditions": pd.DataFrame({"remnant_order": [1, "nm"], "condition": ["C3", "C1"]})},
        {"block_size": 1},
        {"block_size": 3, "n": 5},
    ],
    ids=["more cells, other order", "a table of cells", "single", "threes"],
)
def test_surroundings_change_no_data_set(table, change):
    keys = ["condition", "remnant_order", "replication"]
    both = table.merge(study(**change).run(), on=keys, suffixes=("", "_then"))
    assert len(both) >= 8
    for name in ("e", "u", "f_t", "random_state"):
        np.testing.assert_array_equal(both[name], both[f"{name}_then"])


def test_common_noise():
    conditions = {"condition": ["C1"], "remnant_gain": [0.01, 0.02]}
    options = {"common_noise": True, "simulation": SHORT | {"open_loop": True}}
    found = study(lambda data: data.record.n.std(), conditions, 3, **options).run()
    one, two = (found["value"][found["remnant_gain"] == gain] for gain in (0.01, 0.02))
    np.testing.assert_allclose(2 * one, two.to_numpy(), rtol=1e-12)
    assert one.nunique() == 3


@pytest.mark.parametrize(
    "options",
    [
        {"n_runs": 3},
        {"common_noise": True, "n_validation_runs": 1},
        {"simulation": NOISE | {"random_phases": True}, "n_runs": 2},
        {"simulation": SHORT | {"remnant_intensity": 0.1, "channels": ["e", "x"]}},
    ],
    ids=["runs", "validation", "phases", "tuned"],
)
def test_data_set_is_what_the_function_saw(options):
    seen = {}

    def keep(data):
        seen[data.replication] = data
        return 0

    chosen = study(keep, {"condition": ["C1", "C4"]}, 5, block_size=4, **options)
    chosen.run()
    again = chosen.data_set(1, 3)
    pd.testing.assert_frame_equal(again.X, seen[3].X, check_exact=True)
    pd.testing.assert_series_equal(again.y, seen[3].y, check_exact=True)
    pd.testing.assert_frame_equal(again.truth.parameters, seen[3].truth.parameters)
    assert again.random_state == seen[3].random_state
    assert len(again.record.u) == options.get("n_runs", 1)
    if "n_validation_runs" in options:
        assert len(again.validation.record.u) == options["n_validation_runs"]
        np.testing.assert_array_equal(again.validation.record.u, seen[0].validation.record.u)
        assert not np.isin(again.validation.record.u, [d.record.u for d in seen.values()]).any()
    if options.get("simulation", {}).get("random_phases"):
        assert len(np.unique(np.concatenate([d.record.f_t[:, 5] for d in seen.values()]))) == 10


def test_a_data_set_is_that_of_make_tracking_runs():
    chosen = study(conditions={"condition": ["C2"]}, common_noise=True, n=3)
    _, y = make_tracking_runs("C2", 3, random_state=7, **NOISE)
    for replication in range(3):
        np.testing.assert_array_equal(chosen.data_set(0, replication).y, y.loc[replication])


def test_batched_and_single_functions_see_the_same(table):
    def batch(block):
        found = {"replication": block.replications}
        return found | {n: getattr(block.record, n).sum(axis=1) for n in ("e", "u")}

    found = study(batch, batched=True, block_size=3).run()
    np.testing.assert_array_equal(found["u"], table["u"])
    assert list(found["replication"]) == list(table["replication"])


RESULTS = {
    "number": (lambda data: 2.5, {"value": ["f", 2.5]}),
    "dict": (lambda data: {"a": 1, "b": "x"}, {"a": ["i", 1], "b": ["O", "x"]}),
    "list": (lambda data: [{"a": 1}, {"a": 2.5}], {"a": ["f", 1.0]}),
    "table": (
        lambda data: pd.DataFrame({"a": [1, 2], "b": [None, "x"]}, index=[5, 6]),
        {"a": ["i", 1], "b": ["O", None]},
    ),
    "arrays": (lambda data: {"a": np.arange(2), "b": "x"}, {"a": ["i", 0], "b": ["O", "x"]}),
    "some missing": (
        lambda data: {"a": [True, None, None][data.replication], "b": data.replication or None},
        {"a": ["f", 1.0], "b": ["f", np.nan]},
    ),
    "mixed": (lambda data: {"a": 1 if data.replication else "one"}, {"a": ["O", "one"]}),
    "nothing": (lambda data: [], {}),
    "nothing at times": (lambda data: [{"a": 1}] * data.replication, {"a": ["i", 1]}),
}


@pytest.mark.parametrize("name", RESULTS)
def test_kinds_of_results(name, tmp_path):
    function, wanted = RESULTS[name]
    chosen = study(function, {"condition": ["C1"]}, 3, block_size=2, simulation=SHORT)
    found = chosen.run(tmp_path)
    assert list(found.columns) == ["condition", "replication", *wanted, *OWN]
    for column, (kind, first) in wanted.items():
        assert found[column].dtype.kind == kind
        np.testing.assert_array_equal(np.array(found[column].iloc[0], dtype=kind), first)
    assert found["replication"].dtype == np.int64
    assert found["error"].isna().all()
    assert all(value is None for value in found["error"])
    pd.testing.assert_frame_equal(chosen.run(tmp_path), found, check_exact=True)
    pd.testing.assert_frame_equal(chosen.run(), found, check_exact=True)


def test_cells_of_all_kinds():
    task = CompensatoryTask.of_condition("C1", **SHORT)
    conditions = [
        {"condition": "C1", "remnant_order": 1, "effects": None, "form": max},
        {"condition": "C1", "remnant_order": "nm", "effects": DeadZone(width=0.1), "form": min},
        {"condition": "C1", "remnant_order": 2, "effects": DeadZone(width=0.2), "form": min},
        {"condition": "C1", "remnant_order": 2, "effects": None, "form": lambda x: x.iloc[0]},
        {"condition": "C1", "remnant_order": 2, "effects": None, "form": lambda x: x.iloc[1]},
    ]
    chosen = study(lambda data, form: form(data.y), conditions, 2)
    found = chosen.run()
    cells = found.drop_duplicates(chosen.cells.columns.tolist())[chosen.cells.columns]
    pd.testing.assert_frame_equal(cells.reset_index(drop=True), chosen.cells)
    assert list(chosen.cells["remnant_order"]) == ["1", "nm", "2", "2", "2"]
    assert list(chosen.cells["effects"])[:3] == [None, "DeadZone(width=0.1)", "DeadZone(width=0.2)"]
    assert chosen.cells["form"].nunique() == 4
    assert not chosen.cells["form"].str.contains(" at 0x").any()
    tasks = [task, CompensatoryTask.of_condition("C2", **SHORT)]
    found = study(conditions={"condition": tasks}, simulation={}, n=1).run()
    assert found["condition"].str.fullmatch("CompensatoryTask [0-9a-f]{6}").all()
    assert found["condition"].nunique() == 2


def failing(data):
    if data.replication == 3:
        raise RuntimeError("no luck")
    return {"u": data.record.u.sum(), "even": data.replication % 2 == 0}


def failing_block(block):
    if 3 in block.replications:
        raise RuntimeError("no luck")
    return {"replication": block.replications, "u": block.record.u.sum(axis=1), "even": True}


@pytest.mark.parametrize(("function", "batched"), [(failing, False), (failing_block, True)])
def test_one_failing_data_set(table, function, batched, tmp_path):
    chosen = study(function, n=6, batched=batched, block_size=5)
    with pytest.warns(
        StudyWarning, match=r"4 of 24 data sets failed.*replication 3 of condition=C1"
    ):
        found = chosen.run(tmp_path)
    failed = found["error"].notna()
    assert list(found["replication"][failed]) == [3] * 4
    assert set(found["error"][failed]) == {"RuntimeError: no luck"}
    assert found["seed"][failed].nunique() == 4
    assert all(value is None for value in found["seed"][~failed])
    kept = found[~failed & (found["replication"] < 4)]
    rest = table[table["replication"] != 3]
    np.testing.assert_array_equal(kept["u"], rest["u"])
    assert found["even"].dtype == float  # truth values with some missing
    with pytest.warns(StudyWarning):
        pd.testing.assert_frame_equal(chosen.run(tmp_path), found, check_exact=True)


BAD = {
    "text": (lambda data: "x", "TypeError: The function of a study must return"),
    "complex": (lambda data: {"H": 1j}, "complex numbers"),
    "array inside": (lambda data: [{"a": np.arange(2)}], "arrays or lists"),
    "its own column": (lambda data: {"condition": 1}, "'condition', which is a column"),
    "error": (lambda data: {"error": 0.1}, "'error', which is a column"),
    "replication": (lambda data: {"replication": 0.1}, "'replication', which is a column"),
}


@pytest.mark.parametrize("name", BAD)
def test_results_that_cannot_be_kept(name):
    function, message = BAD[name]
    with pytest.warns(StudyWarning, match=message):
        found = study(function, {"condition": ["C1"]}, 2).run()
    assert list(found.columns) == ["condition", "replication", *OWN]
    assert len(found) == 2


@pytest.mark.parametrize(
    ("result", "message"),
    [({"u": [1.0]}, "column 'replication'"), ({"replication": [9]}, "of other blocks")],
)
def test_batched_results_that_cannot_be_kept(result, message):
    with pytest.warns(StudyWarning, match=message):
        study(lambda block: result, {"condition": ["C1"]}, 2, batched=True).run()


def test_a_cell_that_cannot_be_simulated():
    def add(data):
        return {"u": data.record.u.sum()}

    conditions = {"condition": ["C1"], "remnant_intensity": [0.1, 0.9]}
    chosen = study(add, conditions, 2, simulation=SHORT)
    with pytest.warns(StudyWarning, match="RemnantIntensityError: No gain gives P_n = 0.9"):
        found = chosen.run()
    assert list(found["error"].isna()) == [True, True, False, False]
    with pytest.raises(RemnantIntensityError):
        chosen.data_set(1, 0)
    unstable = {"condition": ["C1"], "perturbation": [{"K_e": 0.0}, {"K_e": 9.0}]}
    with pytest.warns(StudyWarning, match="UnstableLoopError"):
        found = study(add, unstable, 3).run()
    assert list(found["error"].isna()) == [True] * 3 + [False] * 3


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"conditions": {}}, ValueError, "at least one cell"),
        ({"conditions": {"condition": ["C1", "C1"]}}, ValueError, "occurs twice"),
        ({"conditions": {"remnant_gian": [1]}}, ValueError, "Did you mean 'remnant_gain'"),
        ({"conditions": {"n_runs": [1]}}, ValueError, "n_runs of the study"),
        ({"function": lambda data, nk: nk}, ValueError, "the function needs 'nk'"),
        ({"function": 3}, TypeError, "callable with a data set"),
        ({"n": 0}, ValueError, "n_replications must be a whole number"),
    ],
)
def test_studies_that_make_no_sense(options, error, message):
    with pytest.raises(error, match=message):
        study(**options)
