"""Progress of a search for effects, by scikit-learn's callbacks."""

import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Bias

callback = pytest.importorskip("sklearn.callback", reason="came with scikit-learn 1.9")


class Counts:
    """A callback that counts the subtasks of each task."""

    def __init__(self):
        self.begun, self.ended = {}, {}

    def setup(self, estimator, context):
        pass

    def teardown(self, estimator, context):
        pass

    def on_fit_task_begin(self, estimator, context):
        self.begun[context.task_name] = self.begun.get(context.task_name, 0) + 1

    def on_fit_task_end(self, estimator, context):
        self.ended[context.task_name] = self.ended.get(context.task_name, 0) + 1


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        n_runs=2,
        duration=20.48,
        remnant_intensity=0.05,
        sampling_rate=50,
        effects=Bias(level=0.1),
        random_state=0,
    )


def test_each_candidate_is_told_thrice(runs, capsys):
    counts = Counts()
    search = EffectSearchCV(OperatorRegressor(), effects=["bias", "drift"])
    search.set_callbacks(counts)
    search.fit(*runs)
    assert counts.begun == counts.ended
    assert capsys.readouterr() == ("", "")  # no bar is drawn unless it is asked for
    n_steps = search.ranking_["step"].nunique()
    assert counts.begun["effects tried"] >= n_steps
    tried = (search.ranking_["status"] != "does not apply").sum()
    assert counts.begun[""] == 3 * tried


def test_a_bar_is_drawn_where_it_is_asked_for(runs, capsys):
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"])
    search.set_callbacks(callback.ProgressBar()).fit(*runs)
    assert "EffectSearchCV - effects tried" in capsys.readouterr().out
