"""Which column is which signal."""

import numpy as np
import pandas as pd
import pytest

from skhoid import ARXRegressor, compare, make_tracking_runs
from skhoid.exceptions import RunIndexError
from skhoid.runs.roles import (
    check_named,
    column_of_role,
    columns_by_role,
    columns_of_role,
    input_columns,
    output_name,
    role_of,
    roles_of,
    target_is_sum,
    with_error,
    with_target,
)

NAMES = ["e", "x", "f_t", "motion_acc", "disturbance", "ex", "target", 3]


def test_a_role_is_the_name_exactly_or_by_its_beginning():
    assert roles_of(NAMES) == dict(
        zip(NAMES, ["e", "x", "f_t", "motion_acc", "disturbance", "", "", ""], strict=True)
    )


def test_given_roles_come_before_names():
    given = {"target": "f_t", "f_t": "", 3: "motion", "e": "x"}
    assert roles_of(NAMES, given)["target"] == "f_t"
    assert [role_of(name, given) for name in ("e", "x", "f_t", 3)] == ["x", "x", "", "motion"]
    assert columns_of_role(NAMES, "x", given) == [0, 1]
    assert column_of_role(NAMES, "f_t", given) == 6
    assert column_of_role(NAMES, "e", given) is None


def test_columns_by_role_are_those_with_one():
    assert columns_by_role(["a", "x", "dist1"], {"a": "e"}) == {"e": 0, "x": 1, "dist1": 2}


@pytest.mark.parametrize("role", ["eror", "E", None, 3])
def test_an_unknown_role_is_named_with_those_there_are(role):
    with pytest.raises(ValueError, match=rf"'a' the role {role!r}; the roles are 'e', 'x', 'f_t'"):
        roles_of(["a"], {"a": role})


def test_two_columns_of_one_role_are_named():
    with pytest.raises(ValueError, match=r"2 columns of X have the role 'x': \['x', 'cursor'\]"):
        columns_by_role(["x", "cursor"], {"cursor": "x"})
    assert columns_by_role(["x", "cursor"], {"cursor": "x", "x": ""}) == {"x": 1}


def test_roles_of_columns_that_are_not_there():
    check_named(["e"], None)
    check_named(["e"], {"u": "x"}, "u")
    with pytest.raises(RunIndexError, match=r"names 'u', which is not a column .* are \['e'\]"):
        check_named(["e"], {"u": "x"})
    with pytest.raises(TypeError, match="roles must be a dict"):
        check_named(["e"], "e")


def test_linear_inputs():
    assert input_columns(["x", "error"], 2, None, None, {"error": "e"}) == [1]
    assert input_columns(["a", "b", "c"], 3, None, "b") == [0, 2]
    assert input_columns(None, 3, [-1, 0], None) == [2, 0]


def test_the_target_is_the_sum_and_the_error_the_difference():
    e, x, f_t = np.array([1.0, 2.0]), np.array([0.5, -1.0]), np.array([1.5, 1.0])
    assert with_target({"e": e, "x": x})["f_t"].tolist() == f_t.tolist()
    assert with_error({"f_t": f_t, "x": x})["e"].tolist() == e.tolist()
    assert with_target({"e": e, "x": x, "f_t": e})["f_t"] is e
    assert with_error({"e": x, "x": x, "f_t": e})["e"] is x
    for some in ({"e": e}, {"x": x}, {"f_t": f_t}, {}):
        assert with_target(some) == with_error(some) == some
    assert target_is_sum({"e", "x", "dist"})
    assert not target_is_sum({"e", "x", "f_t"})


@pytest.mark.parametrize(
    ("y", "name"),
    [
        (np.zeros(2), "u"),
        (pd.Series([0.0]), "u"),
        (pd.Series([0.0], name="stick"), "stick"),
        (pd.DataFrame({"stick": [0.0]}), "stick"),
        (None, "u"),
    ],
)
def test_an_output_without_a_name_is_u(y, name):
    assert output_name(y) == name


def test_an_output_without_a_name_is_u_wherever_it_is_shown():
    X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    bare = y.to_numpy()
    model = ARXRegressor(nk=15).fit(X, bare)
    assert set(model.parameters_["unit"]) == {"-", "[u]/deg"}
    assert "u from e" in model.summary()
    assert compare(model, X, bare).output == "u"
