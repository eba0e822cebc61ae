"""A misspelt choice is an error that lists the choices, in every public class."""

import inspect

import numpy as np
import pytest
from sklearn.utils._param_validation import StrOptions

import skhoid
from skhoid import ARXRegressor, EffectSearchCV, OperatorRegressor, VAFScorer, make_tracking_runs
from skhoid.effects import DeadZone, Effects, FreeHysteresis, FreeMap, FreePath
from skhoid.effects.catalogue import CLASSES

X, Y = make_tracking_runs(
    "C1", 2, duration=10.24, sampling_rate=50, channels=("e", "x", "f_t"), random_state=0
)
ALL = [*CLASSES, FreeMap, FreeHysteresis, FreePath]
CHOICES = [(c, name) for c in ALL for name in {**c.choices, **c.options}]
NUMBERS = [
    (c, name)
    for c in ALL
    for name in inspect.signature(c).parameters
    if name in {p.name for p in c().parameters}
    or (name in c.arguments and c.arguments[name].kind.startswith("float"))
]
USES = {
    "an operator": lambda effect: OperatorRegressor(effects=effect).fit(X, Y),
    "an ARX model": lambda effect: ARXRegressor(1, 1).with_effect(effect).fit(X, Y),
    "a simulation": lambda effect: make_tracking_runs("C1", 1, effects=effect),
    "a composition": lambda effect: Effects.of("bias") + effect,
    "a search": lambda effect: EffectSearchCV(OperatorRegressor(), effects=[effect]).fit(X, Y),
}


@pytest.mark.parametrize(
    ("effect", "argument", "use"),
    [(*choice, "an operator") for choice in CHOICES] + [(DeadZone, "at", use) for use in USES],
)
def test_choices_of_effects(effect, argument, use):
    options = {**effect.choices, **effect.options}[argument]
    misspelt = f"{options[0]}x" if isinstance(options[0], str) else 7
    with pytest.raises(ValueError, match=f"{effect.__name__}: {argument} must be") as told:
        USES[use](effect(**{argument: misspelt}))
    assert all(repr(option) in str(told.value) for option in options)
    assert "None" in str(told.value)
    if isinstance(misspelt, str):
        assert f"Did you mean {options[0]!r}?" in str(told.value)


@pytest.mark.parametrize("effect", [c for c, name in CHOICES if name == "at"])
def test_the_place_of_a_misspelt_at_lists_the_places(effect):
    with pytest.raises(ValueError, match=r"at must be .*'command'"):
        effect(at="comand").place  # noqa: B018


@pytest.mark.parametrize(
    ("effect", "argument", "given"),
    [(*number, "wide") for number in NUMBERS] + [(*NUMBERS[0], given) for given in (np.nan, [0.3])],
)
def test_numbers_of_effects(effect, argument, given):
    with pytest.raises(ValueError, match=f"{effect.__name__}: {argument} must be a number"):
        OperatorRegressor(effects=effect(**{argument: given})).fit(X, Y)


def estimators():
    for name in skhoid.__all__ if hasattr(skhoid, "__all__") else dir(skhoid):
        one = getattr(skhoid, name)
        for argument, allowed in getattr(one, "_parameter_constraints", {}).items():
            listed = allowed if isinstance(allowed, list) else []
            options = [a for a in listed if isinstance(a, StrOptions)]
            known = isinstance(one, type) and argument in inspect.signature(one).parameters
            if known and options and argument != "effects":  # see the tests of the catalogue
                yield pytest.param(one, argument, options[0].options, id=f"{name}-{argument}")


@pytest.mark.parametrize(("cls", "argument", "options"), list(estimators()))
def test_choices_of_estimators(cls, argument, options):
    needed = {}
    if "estimator" in inspect.signature(cls).parameters:
        searched = OperatorRegressor() if cls is EffectSearchCV else ARXRegressor(1, 1)
        needed["estimator"] = searched
    model = cls(**{**needed, argument: f"{min(options)}x"})
    with pytest.raises(ValueError, match=f"'{argument}' parameter of {cls.__name__}") as told:
        model.fit(X, Y)
    assert all(repr(option) in str(told.value) for option in options)


@pytest.mark.parametrize(
    ("argument", "given", "listed"),
    [
        ("rate", "modell", ["'full'", "'model'"]),
        ("average", "means", ["'pooled'", "'mean'"]),
    ],
)
def test_choices_of_the_scorer(argument, given, listed):
    with pytest.raises(ValueError, match=f"{argument} must be") as told:
        VAFScorer(**{argument: given})
    assert all(one in str(told.value) for one in listed)
