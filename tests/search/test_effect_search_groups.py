"""``groups`` of the four searches: given to the splitter as GridSearchCV does."""

import numpy as np
import pytest
from sklearn.model_selection import GroupKFold, LeaveOneGroupOut

from skhoid import (
    ARXRegressor,
    DelaySearchCV,
    EffectSearchCV,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARXCV,
    make_tracking_runs,
    run_labels,
)

SEARCHES = {
    "delay": lambda cv: DelaySearchCV(ARXRegressor(1, 1), nk=[1, 15], criterion="vaf", cv=cv),
    "order": lambda cv: OrderSearchCV(ARXRegressor(1, 1), na=[1, 2], nb=[1], nk=[15], cv=cv),
    "memory": lambda cv: RecursiveARXCV(na=2, nb=2, nk=15, memory_horizons=[64, 512], cv=cv),
    "effects": lambda cv: EffectSearchCV(
        OperatorRegressor(0.28), effects=["bias"], max_effects=1, cv=cv
    ),
}


class Remembering(GroupKFold):
    def split(self, X, y=None, groups=None):
        self.groups_ = groups
        return super().split(X, y, groups)


@pytest.fixture(scope="module")
def runs():
    X, y = make_tracking_runs(n_runs=4, duration=10.24, sampling_rate=50, random_state=0)
    return X, y, np.array(["a", "a", "b", "c"])[run_labels(X) - 1]


@pytest.mark.filterwarnings("ignore::skhoid.NothingExplainedWarning")
@pytest.mark.parametrize("name", SEARCHES)
def test_groups_reach_the_splitter(runs, name):
    X, y, people = runs
    splitter = Remembering(3)
    SEARCHES[name](splitter).fit(X, y, groups=people)
    np.testing.assert_array_equal(np.array(["a", "b", "c"])[splitter.groups_], people)


@pytest.mark.filterwarnings("ignore::skhoid.NothingExplainedWarning")
@pytest.mark.parametrize("name", ["delay", "order", "memory"])
def test_without_a_splitter_each_group_is_left_out(runs, name):
    X, y, people = runs
    found = SEARCHES[name](None).fit(X, y, groups=people).cv_results_
    same = SEARCHES[name](LeaveOneGroupOut()).fit(X, y, groups=people).cv_results_
    assert sum(key.startswith("split") and key.endswith("_test_score") for key in found) == 3
    np.testing.assert_array_equal(found["mean_test_score"], same["mean_test_score"])
