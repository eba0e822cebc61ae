"""What counts in a step: bounds, numbers that the data do not determine, folds, the mean, leaks."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.person_in_loop import answered, pursued
from support.searching import search_of

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.effects import Dimension, Effect, Parameter
from skhoid.search import candidates, forward
from skhoid.search.candidates import (
    LEAST_DELTA_BIC,
    LEAST_GAIN,
    Candidate,
    SearchStep,
    hardly_there,
    likeliest_alternatives,
    mark_confused,
    plainest_first,
    weigh_likely,
    without_name,
)
from skhoid.search.forward import Search, output_error_fit, share_about_mean
from skhoid.search.in_loop import InLoop
from skhoid.search.statuses import Against, Reason


class Fitted:
    """A model whose numbers are known."""

    def __init__(self, values, undetermined=(), at_bound=()):
        self._values, self._undetermined, self._at_bound = values, undetermined, at_bound
        free = [SimpleNamespace(name="gain"), SimpleNamespace(name="time")]
        own = SimpleNamespace(free=free, neutral={"time": 0.0}, unseen_at={}, free_form=False)
        self.effects = SimpleNamespace(steps=[("preview", own)])

    def values(self):
        return self._values

    def undetermined(self):
        return list(self._undetermined)

    def at_bound(self):
        return list(self._at_bound)


def candidate(name="preview", place="path", **options):
    own = SimpleNamespace(name=name, place=place, neutral={}, free_form=False)
    return Candidate(name, own, **options)


VALUES = {"K_e": 1.0, "preview__gain": 0.4, "preview__time": 0.8, "preview-2__time": 1.5}


def test_no_name_where_the_data_do_not_determine_it():
    model = Fitted(VALUES, ["K_e", "preview__gain", "preview__time"])
    reason = without_name(candidate(model=model))
    assert reason.text == "the data do not determine its time"


def test_a_name_where_they_determine_what_it_does():
    assert without_name(candidate(model=Fitted(VALUES, ["K_e", "preview__gain"]))) is None


def test_no_name_where_its_numbers_end_at_a_bound():
    model = Fitted(VALUES, at_bound=["K_e", "preview__time"])
    assert without_name(candidate(model=model)).text == "time at the bound"


def test_no_name_where_nothing_shows_of_it():
    model = Fitted(VALUES, at_bound=["preview__gain"])
    model.effects.steps[0][1].unseen_at = {"gain": 0.4}
    assert without_name(candidate(model=model)).text == "nothing shows of it with gain = 0.4"
    model.effects.steps[0][1].unseen_at = {"gain": 0.1}  # the other bound
    assert without_name(candidate(model=model)) is None


def test_a_name_where_only_others_end_there():
    model = Fitted(VALUES, ["preview-2__time"], ["K_e", "preview-2__time"])
    assert without_name(candidate(model=model)) is None


def test_a_name_where_a_number_ends_that_is_no_size():
    model = Fitted(VALUES, at_bound=["preview__gain"])
    assert without_name(candidate(model=model)) is None


@pytest.mark.parametrize(
    ("value", "sd", "smooth", "reason"),
    [
        (0.8, 0.3, True, "within its standard errors it may be zero: time = 0.8 ± 0.3"),
        (0.8, 0.2, True, ""),
        (-0.8, 0.3, True, "within its standard errors it may be zero: time = -0.8 ± 0.3"),
        (0.8, np.nan, True, ""),
        (0.8, 0.3, False, ""),
    ],
)
def test_no_name_whose_numbers_may_as_well_be_none(value, sd, smooth, reason):
    model = Fitted({"K_e": 1.0, "preview__gain": 0.4, "preview__time": value})
    model.simulator = SimpleNamespace(names=list(model.values()), smooth=smooth)
    model.covariance = lambda: np.diag([0.1, 0.0, sd]) ** 2
    tried = candidate(model=model)
    tried.effect.neutral = {"time": 0.0}
    assert (hardly_there(tried) or (None, ""))[1] == reason


def test_a_name_whose_numbers_are_nowhere_neutral():
    assert hardly_there(candidate(model=Fitted(VALUES))) is None


@pytest.mark.parametrize("value", [0.0, 1.0, 0.9995])
def test_nothing_and_all_are_bounds_like_other_values(value):
    model = Fitted({**VALUES, "preview__time": value}, at_bound=["preview__time"])
    assert without_name(candidate(model=model)) is None


def passing(name="higher_order", **options):
    options = {"delta_bic": 100.0, "gain": 2.0, "vaf": 85.0, "n_parameters": 2, **options}
    return candidate(name, **options)


@pytest.mark.parametrize(
    ("changes", "passes"),
    [
        ({}, True),
        ({"delta_bic": LEAST_DELTA_BIC}, False),
        ({"gain": LEAST_GAIN}, True),
        ({"gain": LEAST_GAIN - 1e-9}, False),
        ({"gain": 0.01, "least_gain": 0.005}, True),
        ({"refused": Against(Reason.AT_BOUND, "a number at the bound")}, False),
        ({"in_loop": InLoop()}, True),
        ({"in_loop": InLoop(90.0, 50.0, 1.0)}, True),
        ({"in_loop": InLoop(90.0, 50.0, -0.1)}, False),
        ({"in_loop": InLoop(90.0, 5.0, 1.0)}, False),
        ({"joint": 10.0}, True),  # the loop has not been asked
        ({"joint": 10.0, "delta_bic": 0.0}, False),
        ({"joint": 50.0, "delta_bic": 0.0}, True),
        ({"joint": 50.0, "delta_bic": 0.0, "gain": 0.1}, False),
        ({"joint": 10.0, "in_loop": InLoop()}, False),
        ({"joint": 15.0, "in_loop": InLoop()}, False),  # linear or not
        ({"joint": 15.0, "in_loop": InLoop(bends=True, beside="nothing")}, True),
        ({"joint": 15.0, "in_loop": InLoop(bends=True)}, False),  # beside others
        ({"joint": 15.0, "in_loop": InLoop(bends=False, beside="nothing")}, False),  # linear
        ({"joint": 50.0, "in_loop": InLoop(90.0, -5.0, 0.01)}, False),  # linear: the loop decides
        ({"joint": 50.0, "in_loop": InLoop(90.0, 50.0, -0.1)}, False),
        ({"joint": 10.0, "in_loop": InLoop(90.0, 25.0, 0.2)}, True),
        ({"joint": 10.0, "in_loop": InLoop(90.0, 15.0, 0.2)}, False),
        ({"joint": 10.0, "in_loop": InLoop(90.0, 15.0, 0.5)}, True),
        ({"joint": 450.0, "gain": 19.0, "in_loop": InLoop(90.0, 3.0, 0.0)}, True),  # blind
        # ... of which dynamics are not: the target excites them
        (
            {"place": "inside", "joint": 450.0, "gain": 19.0, "in_loop": InLoop(90.0, 3.0, 0.0)},
            False,
        ),
        ({"joint": 70.0, "delta_bic": 150.0, "gain": 0.6, "in_loop": InLoop(90.0, 3.0, 0.0)}, True),
        (
            {"joint": 70.0, "delta_bic": 150.0, "gain": 0.4, "in_loop": InLoop(90.0, 3.0, 0.0)},
            False,
        ),
        (
            {"joint": 59.0, "delta_bic": 150.0, "gain": 4.0, "in_loop": InLoop(90.0, 3.0, 0.0)},
            False,
        ),
        ({"joint": 450.0, "gain": 19.0, "in_loop": InLoop(90.0, 3.0, -0.5)}, False),
        ({"joint": 50.0, "in_loop": InLoop(90.0, -5.0, -0.1, True)}, True),
        ({"joint": 50.0, "in_loop": InLoop(90.0, -25.0, 1.0, True)}, False),
        ({"joint": 15.0, "in_loop": InLoop(90.0, 0.0, 1.0, True, "nothing")}, True),
        ({"joint": 15.0, "in_loop": InLoop(90.0, 0.0, 1.0, True)}, False),
        ({"joint": 400.0, "in_loop": InLoop(90.0, -70.0, -0.1, True)}, True),
        ({"joint": 10.0, "in_loop": InLoop(90.0, 50.0, 1.0, True)}, False),
        ({"joint": 50.0, "in_loop": InLoop(bends=True)}, True),
        ({"joint": 50.0, "in_loop": InLoop(bends=False)}, False),  # beside what jumps or sticks
        ({"joint": 60.0, "delta_bic": 60.0, "in_loop": InLoop(bends=False)}, True),
        ({"joint": 45.0, "in_loop": InLoop(bends=True, beside="bent")}, False),
        ({"joint": 60.0, "in_loop": InLoop(bends=True, beside="bent")}, True),
        ({"joint": 60.0, "delta_bic": -60.0, "in_loop": InLoop(bends=False)}, False),
        ({"joint": 30.0, "delta_bic": -60.0, "in_loop": InLoop()}, False),
        ({"joint": np.nan, "in_loop": InLoop()}, True),
        ({"joint": np.nan, "in_loop": InLoop(bends=True)}, False),
        ({"joint": np.nan, "gain": 6.0, "in_loop": InLoop(bends=True)}, True),
        (
            {"joint": 450.0, "gain": 19.0, "delta_bic": -900.0, "in_loop": InLoop(90.0, 3.0, 0.0)},
            False,
        ),
        ({"joint": np.nan, "in_loop": InLoop(bends=False)}, False),
        ({"joint": np.nan, "gain": 6.0, "in_loop": InLoop(bends=False)}, True),
        ({"joint": 50.0, "in_loop": InLoop(-np.inf, -np.inf, -np.inf)}, False),
        ({"joint": 10.0, "in_loop": InLoop(-np.inf, -np.inf, -np.inf)}, False),
        ({"trace": "levels", "delta_bic": -10.0, "gain": -0.1}, True),
        ({"trace": "levels", "gain": -0.3}, False),
        ({"trace": "levels", "refused": Against(Reason.AT_BOUND, "it loses")}, False),
    ],
)
def test_what_passes(changes, passes):
    assert passing(**changes).passes == passes


@pytest.mark.parametrize(
    ("changes", "passes"),
    [
        ({"in_loop": InLoop(90.0, 110.0, 0.15, False)}, True),
        ({"in_loop": InLoop(90.0, 90.0, 0.3, False)}, False),
        ({"in_loop": InLoop(90.0, 15.0, 1.5, False)}, True),
        ({"in_loop": InLoop(90.0, 5.0, 1.5, False)}, False),
        ({"in_loop": InLoop(90.0, 200.0, 0.05, False)}, False),
        ({"joint": 450.0, "gain": 19.0, "in_loop": InLoop(90.0, 3.0, 0.0, False)}, False),
    ],
)
def test_an_answer_to_the_target_needs_more_in_the_loop(changes, passes):
    """What the remnant imitates most; to such an answer the loop is not blind."""
    assert passing("feedforward", **changes).passes == passes


class Judge:
    """A loop that refutes some, and counts whom it was asked about."""

    def __init__(self, refuted):
        self.refuted, self.asked = refuted, []

    def judged(self, model):
        self.asked.append(model)
        return InLoop(80.0, 50.0, -1.0 if model in self.refuted else 1.0)

    def compared(self, model):
        asked = [*self.asked]
        found = self.judged(model)
        self.asked = asked  # of rows held out
        return found, None


@pytest.fixture
def no_leaks(monkeypatch):
    monkeypatch.setattr(candidates, "leak_of", lambda model: None)


def step_of(candidates, loop=None, refit=None):
    def gaining(model):
        return 80.0 if model == "parent" else 81.0

    return SearchStep("parent", "parent", 80.0, np.zeros(0), candidates, loop, refit or gaining)


def test_rank_asks_the_loop_until_one_passes(no_leaks):
    loop = Judge({"a", "b"})
    found = [
        passing(n, model=n, delta_bic=e) for n, e in zip("abcd", (90, 80, 70, 60), strict=True)
    ]
    found[3].delta_bic = 10.0  # far behind: not asked
    step = step_of(found[::-1], loop=loop)
    step.rank()
    assert loop.asked == ["a", "b", "c"]
    assert step.best.name == "c"
    assert [c.name for c in step.candidates] == ["c", "a", "b", "d"]
    step.rank()
    assert loop.asked == ["a", "b", "c"]  # once each


def test_of_linear_effects_the_loop_says_which(no_leaks):
    """Outside it the remnant decides as well which follows the error best."""

    class Loop(Judge):
        def judged(self, model):
            return replace(
                super().judged(model), delta_bic={"a": 60.0, "b": 90.0, "c": 75.0}[model]
            )

    found = [passing(n, model=n, delta_bic=e) for n, e in zip("abc", (90, 80, 70), strict=True)]
    step = step_of(found, loop=Loop({"c"}))
    step.rank()
    assert [c.name for c in step.candidates] == ["b", "a", "c"]


def test_rivals_that_the_loop_does_not_prefer_are_not_asked_about_rows_left_out(no_leaks):
    class Loop(Judge):
        def judged(self, model):
            return replace(super().judged(model), delta_bic={"a": 60.0, "b": 75.0}[model])

    found = [passing(n, model=n, delta_bic=e) for n, e in zip("ab", (90, 60), strict=True)]
    loop = Loop(set())
    step = step_of(found, loop=loop)
    step.rank()
    assert loop.asked == ["a"]
    assert [c.name for c in step.candidates] == ["a", "b"]
    assert found[1].in_loop is None


def weighing(joint):
    """What finds the unbiased ΔBIC of candidates by their names, and whom it was asked about."""
    asked = []

    def weigh(some):
        for one in some:
            asked.append(one.name)
            one.joint, one.unweighed = joint[one.name], False

    return weigh, asked


def unweighed(values):
    return [passing(n, model=n, delta_bic=e, unweighed=True) for n, e in values.items()]


def test_the_unbiased_likelihood_is_found_of_what_may_be_the_best(no_leaks):
    found = unweighed({"a": 900.0, "b": 800.0, "c": 150.0, "d": 90.0})
    weigh, asked = weighing({"a": 100.0, "b": 300.0, "c": 90.0, "d": 40.0})
    weigh_likely(found, weigh)
    assert asked == ["a", "b"]
    step = step_of(found)
    step.weigh = weigh
    step.rank()
    assert [c.name for c in step.candidates] == ["b", "a", "c", "d"]
    assert asked == ["a", "b"]
    assert [c.name for c in step.rivals()] == ["a"]
    assert asked == ["a", "b", "c"]  # it might have had enough


def test_it_is_found_of_whatever_is_judged(no_leaks):
    """What stands behind those that are refuted, and what is asked for by name."""
    found = unweighed({"a": 900.0, "b": 100.0})
    weigh, asked = weighing({"a": 500.0, "b": 50.0})
    step = step_of(found, loop=Judge({"a"}))
    step.weigh = weigh
    step.rank()
    assert asked == ["a", "b"]
    assert step.best.name == "b"
    alone = unweighed({"c": 50.0})
    weigh, asked = weighing({"c": 10.0})
    step = step_of([], loop=Judge(set()))
    step.weigh = weigh
    assert step.judge(alone[0])
    assert asked == ["c"]


def test_of_alternatives_the_unbiased_likelihood_is_found_where_it_may_decide():
    at_error, at_output = (passing("map", delta_bic=e, unweighed=True) for e in (200.0, 190.0))
    best = passing("bias", delta_bic=9000.0, unweighed=True)
    weigh, asked = weighing({"map": 60.0, "bias": 4000.0})
    weigh_likely([at_error, at_output, best], weigh)
    assert asked == ["bias"]
    at_error.joint, at_error.unweighed = 60.0, False
    weigh_likely([at_error, at_output, best], weigh)
    assert asked == ["bias", "map"]


def test_what_bends_is_not_put_in_order_by_the_loop(no_leaks):
    class Bent(Judge):
        def judged(self, model):
            found = super().judged(model)
            return replace(found, delta_bic={"a": 5.0, "b": 90.0}[model], bends=True)

    found = [passing(n, model=n, delta_bic=e) for n, e in zip("ab", (90, 80), strict=True)]
    for one in found:
        one.joint = 60.0
    step = step_of(found, loop=Bent(set()))
    step.rank()
    assert [c.name for c in step.candidates] == ["a", "b"]


def test_of_the_alternatives_of_an_effect_the_likeliest_is_kept():
    at_error = passing("dead_zone", delta_bic=300.0)
    at_output = passing("dead_zone", delta_bic=280.0)
    at_error.joint, at_output.joint = 40.0, 90.0
    lost = passing(
        "dead_zone", delta_bic=900.0, refused=Against(Reason.AT_BOUND, "width at the bound")
    )
    other = passing("bias", delta_bic=30.0)
    assert likeliest_alternatives([lost, at_error, other, at_output]) == [at_output, other]
    at_output.gain = 0.0
    assert likeliest_alternatives([lost, at_error, at_output]) == [at_error]


def test_rank_asks_no_loop_about_what_the_output_shows(no_leaks):
    loop = Judge({"a"})
    step = step_of([passing("a", model="a", trace="levels at equal distances")], loop=loop)
    step.rank()
    assert step.best.name == "a"
    assert not loop.asked


def test_rank_of_nothing():
    step = step_of([])
    step.rank()
    assert step.best is None
    step = step_of([candidate(inapplicable="does not apply")])
    step.rank()
    assert step.best is None


def test_a_step_that_loses_when_refitted_is_not_taken(no_leaks):
    vafs = {"parent": 80.0, "a": 79.5, "b": 81.0}
    step = step_of(
        [passing("a", model="a", delta_bic=200.0), passing("b", model="b")], refit=vafs.get
    )
    step.rank()
    assert step.best.name == "b"
    refused = step.candidates[-1]
    assert refused.refused.text == "fitted without the rows, it loses 0.5 points there"


@pytest.mark.parametrize(("vaf", "taken"), [(79.9, True), (79.7, False)])
def test_what_the_output_shows_may_lose_a_little_when_refitted(no_leaks, vaf, taken):
    vafs = {"parent": 80.0, "a": vaf}
    step = step_of([passing("a", model="a", trace="levels")], refit=vafs.get)
    step.rank()
    assert (step.best is not None) == taken


@pytest.fixture(scope="module")
def opened():
    """A step of a search of someone with a dead zone."""
    search, baseline = search_of(*answered(dead=0.5), ["dead_zone", "bias"])
    return search, search.step(baseline)


def test_a_step_refits_without_each_fold(opened):
    """The dead zone predicts held-out runs better when both are fitted without them."""
    search, step = opened
    best = step.best
    assert best.name == "dead_zone"
    gain = search.refit(best.model) - step.refitted_vaf
    assert gain > LEAST_GAIN
    assert search.refit(best.model) == pytest.approx(best.vaf, abs=0.5)


def test_a_real_step_is_refused_by_what_refits_say(opened):
    _, step = opened
    again = [replace(c, refused=None) for c in step.candidates if c.name == "dead_zone"]
    ranked = replace(step, candidates=again, refit=lambda m: 50.0 - len(m.effects))
    ranked.rank()
    assert ranked.best is None
    assert "fitted without the rows" in again[0].refused.text


def test_output_error_fit_is_no_worse_a_simulation(opened):
    search, step = opened
    plain = output_error_fit(step.best.model)
    assert plain.sse <= search.criterion.sse(step.best.model.output) * (1 + 1e-9)


def test_share_about_the_mean():
    X, y = answered(mean=10.0)
    search, _ = search_of(X, y, ["bias"])
    assert search.share == pytest.approx(1 / 101, rel=0.2)
    assert share_about_mean(search.criterion) == search.share
    search, _ = search_of(X, y - 10.0, ["bias"])
    assert search.share == pytest.approx(1.0, abs=0.02)


@pytest.mark.slow
def test_an_effect_behind_a_large_mean_is_found():
    """With a mean of ten, a dead zone explains hundredths of a point of the whole power."""
    X, y = answered(dead=0.5, mean=10.0)
    found = EffectSearchCV(OperatorRegressor(), effects=["bias", "dead_zone", "asym_gain"])
    found.fit(X, y)
    assert found.best_effects_ == ["bias", "dead_zone"]
    gain = found.ranking_.query("effect == 'dead_zone' and status == 'added'")["vaf_gain"]
    assert 0 < gain.item() < LEAST_GAIN


@pytest.mark.slow
def test_nothing_is_found_behind_a_large_mean():
    X, y = answered(mean=10.0, seed=3)
    found = EffectSearchCV(OperatorRegressor(), effects=["bias", "dead_zone", "asym_gain"])
    assert found.fit(X, y).best_effects_ == ["bias"]


class OfTheAnswer(Effect):
    """What the controlled element does shows what went into it."""

    name = "of_the_answer"
    place = "sum"
    physics = "The acceleration of the controlled element is in the output."
    formula = "u + gain d2x/dt2"
    parameters = (Parameter("gain", Dimension(u=1), -20.0, 20.0, (0.5,), "on it"),)

    def __init__(self, *, gain=None):
        self.gain = gain

    def apply(self, signal, record, gain):
        (name,) = record.with_role("x")
        x = record.channels[name]
        ahead, behind = np.roll(x, -1, axis=0), np.roll(x, 1, axis=0)
        second = (ahead - 2 * x + behind) / record.dt**2
        second[0] = second[-1] = 0.0
        return signal + gain * second


def test_a_model_that_rebuilds_the_output_from_x_is_refused():
    X, y, _ = pursued("1/(s(s+1))", 5, n_runs=3, duration=30.0)
    found = EffectSearchCV(
        OperatorRegressor(), effects=[OfTheAnswer()], controlled_element="1/(s(s+1))"
    ).fit(X, y)
    row = found.ranking_.iloc[0]
    assert row["vaf_gain"] > LEAST_GAIN
    assert row["delta_bic"] > LEAST_DELTA_BIC
    assert "of_the_answer" not in found.best_effects_
    assert row["status"] == "not better"
    assert "rebuilds the output from the element's response" in row["reason"]


def test_plainest_first_where_hardly_anything_is_left():
    first, plain = passing("a", vaf=98.0, n_parameters=3), passing("b", vaf=98.0, n_parameters=1)
    found = [first, plain]
    plainest_first(found)
    assert [c.name for c in found] == ["b", "a"]
    found = [replace(first, vaf=90.0), plain]
    plainest_first(found)
    assert [c.name for c in found] == ["a", "b"]
    plainest_first([])


def test_confused_are_those_of_about_the_same_delta_bic():
    found = [
        passing("a", delta_bic=100.0),
        passing("b", delta_bic=95.0),
        passing("c", delta_bic=60.0),
    ]
    found.append(passing("d", delta_bic=99.0, refused=Against(Reason.AT_BOUND, "a bound")))
    mark_confused(found)
    assert [c.confused_with for c in found] == [["b"], ["a"], [], []]


@pytest.mark.parametrize(
    ("names", "sse", "is_known"),
    [
        (["K_e", "bias__level"], 1.0, True),
        (["K_e", "bias__level"], 3.0, False),  # worse
        (["K_e", "bias__level", "bias__time"], 1.0, False),  # another form of it, with more numbers
    ],
)
def test_one_effect_fewer_is_as_the_search_had_it_where_that_has_the_same_numbers(
    names, sse, is_known, monkeypatch
):
    def fitted(names, sse):
        simulator = SimpleNamespace(names=names)
        return SimpleNamespace(
            simulator=simulator, effects=SimpleNamespace(names=["bias"]), sse=sse
        )

    more = fitted(["K_e", "bias__level", "dead_zone__width"], 0.5)
    without, known = fitted(["K_e", "bias__level"], 2.0), fitted(names, sse)
    monkeypatch.setattr(forward, "without", lambda *args: without)
    monkeypatch.setattr(forward, "in_order", lambda model, names: model)
    search = SimpleNamespace(_parents={frozenset(["bias"]): known})
    assert (Search.fewer(search, more, "dead_zone", {}) is known) == is_known
