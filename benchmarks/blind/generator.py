"""Cases of the blind trial: runs with hidden effects, their truth, and what an oracle reaches.

``make_case(suite, number, seed)`` gives the same case again for the same three.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from baseline import LinearOperator, vaf
from curves import true_curves, unmapped
from effects import Context, Effect, RunInputs, Wiring
from effects_beyond import DRAW as DRAW_BEYOND
from effects_beyond import WIRE as WIRE_BEYOND
from effects_in_time import DRAW as DRAW_IN_TIME
from effects_in_time import WIRE as WIRE_IN_TIME
from effects_paths import DRAW as DRAW_PATHS
from effects_paths import WIRE as WIRE_PATHS
from effects_static import DRAW as DRAW_STATIC
from effects_static import WIRE as WIRE_STATIC
from loop import E, U
from pairs import draw_pair, worth
from signals import KEPT, remnant
from world import (
    HopelessError,
    World,
    changing_element,
    closed,
    draw_decoys,
    draw_world,
    opened,
    record,
)

KNOWN = {**DRAW_IN_TIME, **DRAW_STATIC, **DRAW_PATHS}
DRAW = {**KNOWN, **DRAW_BEYOND}
WIRE = {**WIRE_IN_TIME, **WIRE_STATIC, **WIRE_PATHS, **WIRE_BEYOND}
LINEAR = ("extra_lag", "nm_mode", "extra_lead", "higher_order")
EFFECTS = (*(name for name in KNOWN if name not in LINEAR), *LINEAR)
BEYOND = tuple(DRAW_BEYOND)
NO_GAP = ("extra_lag", "nm_mode", "tremor")  # need none
NULLS = ("plain", "heavy", "growing", "changing element", "decoys")
SUITES = ("main", "null", "pairs", "one_run", "left_out", "beyond")
OFF, OFF_OF_PAIRS = 0.4, 0.2  # share of forms that differ from the catalogue's
SMALLEST, LARGEST, LARGEST_BEYOND = 1.0, 60.0, 20.0  # points
ATTEMPTS = 150
REALISATIONS = 16  # of the remnant, for the mean answer


@dataclass(frozen=True)
class Case:
    """A case, with what the search is given and what it is graded by.

    Parameters
    ----------
    suite, number, seed : str, int, int
        Where it comes from.
    X, X_test : DataFrame
        Channels of the training and of the held-out runs, indexed by run and time.
    y, y_test : Series
        The output u.
    delay : float or None
        What the user assumes.
    controlled_element : tuple of float, or None
        K_c and omega_b, where the user gives them.
    display : str
        What the operator sees.
    left_out : str or None
        The effect that the search must do without.
    truth : dict
        effects, parameters, form, canonical, P_n, order, plant and more; of the suites ``left_out``
        and ``beyond`` the true curves.
    oracle_prediction, baseline_prediction : ndarray of shape (n_rows,)
        For X_test: by the true operator, effects and all, without remnant; by the best linear one.
    oracle_vaf, baseline_vaf, gap : float
        Percent on held-out runs without their first 5 s, and the difference.
    ceiling_vaf : float
        What no prediction may exceed. Above the oracle where an effect acts on the remnant too: the
        mean answer is then not the answer to the mean.
    oracle_vaf_of_training : float
        The same on the training runs, which may have another amplitude.
    """

    suite: str
    number: int
    seed: int
    X: pd.DataFrame
    y: pd.Series
    X_test: pd.DataFrame
    y_test: pd.Series
    delay: float | None
    controlled_element: tuple[float, float] | None
    display: str
    left_out: str | None
    truth: dict[str, Any]
    oracle_prediction: np.ndarray
    baseline_prediction: np.ndarray
    oracle_vaf: float
    baseline_vaf: float
    gap: float
    ceiling_vaf: float
    oracle_vaf_of_training: float


def effect_of(number: int, suite: str = "main") -> str:
    """The effect of a case of the suites main, one_run, left_out and beyond.

    The first 28 take turns; the four linear ones share two turns of thirty. 448 cases have each
    of the 28 fifteen times. Those of ``beyond`` take turns too.
    """
    if suite == "beyond":
        return BEYOND[number % len(BEYOND)]
    turn, place = divmod(number, 30)
    if place < 28:
        return EFFECTS[place]
    return LINEAR[2 * (place - 28) + turn % 2]


def make_case(suite: str, number: int, seed: int) -> Case:
    """Make a case.

    Parameters
    ----------
    suite : {"main", "null", "pairs", "one_run", "left_out", "beyond"}
        Which suite.
    number : int
        Of the case in its suite; with it the effect goes in turn.
    seed : int
        Of the suite.

    Returns
    -------
    case : Case

    Raises
    ------
    ValueError
        If there is no such suite.
    HopelessError
        If no draw was usable.
    """
    if suite not in SUITES:
        raise ValueError(f"make_case: suite is one of {', '.join(SUITES)}; got {suite!r}.")
    rng = np.random.default_rng(np.random.SeedSequence([seed, SUITES.index(suite), number]))
    variant = NULLS[number % len(NULLS)] if suite == "null" else "plain"
    off_share = OFF_OF_PAIRS if suite == "pairs" else OFF
    largest = LARGEST_BEYOND if suite == "beyond" else LARGEST
    if suite == "null":
        names: tuple[str, ...] = ()
    elif suite == "pairs":
        names = draw_pair(rng, EFFECTS)
    else:
        names = (effect_of(number, suite),)
    off = bool(rng.random() < off_share)
    boost, reason = 1.0, ""
    for _ in range(ATTEMPTS):
        try:
            case = _attempt(rng, suite, number, seed, names, off, variant, boost)
        except HopelessError as error:
            reason = str(error)
            continue
        if not names or set(names) & set(NO_GAP):
            return case
        if case.gap < SMALLEST or (suite == "pairs" and min(case.truth["worth"]) < SMALLEST):
            boost, reason = boost * 1.15, "Its gap is too small."
        elif case.gap > largest:
            boost, reason = boost * 0.9, "Its gap is too large."
        else:
            return case
    raise HopelessError(f"{suite} {number} of seed {seed}, {names}: no usable draw. {reason}")


def _attempt(
    rng: np.random.Generator,
    suite: str,
    number: int,
    seed: int,
    names: tuple[str, ...],
    off: bool,
    variant: str,
    boost: float,
) -> Case:
    """One draw, usable or not."""
    world, context = draw_world(rng, names, off, variant)
    if variant == "changing element":
        world = changing_element(rng, world)
    n_train = 1 if suite == "one_run" else 5
    runs = [world.inputs(rng, held_out=i >= n_train) for i in range(n_train + 3)]
    mean = float(np.mean([run.speed[KEPT] for run in runs[:n_train]]))
    context = replace(context, speed_mean=mean)
    effects = []
    for i, name in enumerate(names):  # of a pair, at most one differs in form
        effects.append(
            DRAW[name](rng, replace(context, off=off and i == number % len(names)), boost)
        )
    wirings = [wired(world, run, context, effects) for run in runs]
    P_n = 0.0 if rng.random() < 0.1 else rng.uniform(0.0, 0.3)
    gain = tune(wirings[: min(2, n_train)], P_n)
    outs = [closed(w, gain) for w in wirings]
    nominal = [
        (wired(world, run, context, effects, nominal=True), out)
        for run, out in zip(runs, outs, strict=True)
    ]
    tests = nominal[n_train:]
    known = np.array([opened(w, out) for w, out in nominal])
    oracle = known[n_train:]
    delay = None if rng.random() < 0.5 else round(world.operator.tau, 3)
    for effect in effects:
        if effect.name == "wrong_delay":
            delay = round(world.operator.tau - effect.parameters["extra"], 3)
    fixed = delay if "wrong_delay" in names else None
    e, u = (np.array([out[row, KEPT] for out in outs]) for row in (E, U))
    linear = LinearOperator(fixed).fit(e[:n_train], u[:n_train])
    baseline = linear.predict(e[n_train:])
    oracle_vaf, baseline_vaf = vaf(u[n_train:], oracle), vaf(u[n_train:], baseline)
    ceiling_vaf = oracle_vaf
    if gain and any(effect.extra.get("behind") for effect in effects):
        ceiling_vaf = max(oracle_vaf, vaf(u[n_train:], mean_answer(rng, world, tests, gain)))

    decoys = draw_decoys(rng, world, 1.0 if variant == "decoys" else 0.4)
    loops = list(zip(runs, outs, strict=True))
    X, y = record(rng, world, loops[:n_train], 1, decoys)
    X_test, y_test = record(rng, world, loops[n_train:], n_train + 1, decoys)
    noise = sum(float(np.var(gain * run.noise[KEPT])) for run in runs[:n_train])
    truth: dict[str, Any] = {
        "effects": list(names),
        "parameters": {effect.name: effect.parameters for effect in effects},
        "form": {effect.name: effect.form for effect in effects},
        "canonical": all(effect.canonical for effect in effects),
        "extra": {effect.name: effect.extra for effect in effects},
        "P_n": noise / sum(float(np.var(run)) for run in u[:n_train]),
        "order": world.order,
        "noise": world.noise,
        "plant": world.kind,
        "element": world.element,
        "operator": vars(world.operator),
        "variant": variant,
        "motion": world.motion,
        "pull": world.pull,
        "new_phases": bool(np.any(world.targets[0].phase != world.targets[1].phase)),
        "amplitude": float(world.targets[1].amplitude[0] / world.targets[0].amplitude[0]),
        "boost": boost,
    }
    if suite in ("left_out", "beyond"):
        before = np.array([opened(unmapped(w), out) for w, out in nominal[:n_train]])
        truth["curves"] = true_curves(
            effects[0], wirings[:n_train], outs[:n_train], known[:n_train], before
        )
    if suite == "pairs":
        if oracle_vaf - baseline_vaf < SMALLEST:
            raise HopelessError("Its gap is too small.")
        truth["worth"] = [
            min(
                worth(world, context, runs, outs, effects, i, delay, linear, oracle_vaf, wired),
                oracle_vaf - baseline_vaf,
            )
            for i in range(len(effects))
        ]
    return Case(
        suite=suite,
        number=number,
        seed=seed,
        X=X,
        y=y,
        X_test=X_test,
        y_test=y_test,
        delay=delay,
        controlled_element=world.element if rng.random() < 0.5 else None,
        display=str(rng.choice(["compensatory", "pursuit", "preview"], p=[0.7, 0.15, 0.15])),
        left_out=names[0] if suite == "left_out" else None,
        truth=truth,
        oracle_prediction=oracle.ravel(),
        baseline_prediction=baseline.ravel(),
        oracle_vaf=oracle_vaf,
        baseline_vaf=baseline_vaf,
        gap=oracle_vaf - baseline_vaf,
        ceiling_vaf=ceiling_vaf,
        oracle_vaf_of_training=vaf(u[:n_train], known[:n_train]),
    )


def wired(
    world: World, run: RunInputs, context: Context, effects: list[Effect], nominal: bool = False
) -> Wiring:
    """The loop of a run with its effects."""
    w = world.wire(run, context, nominal)
    for effect in effects:
        WIRE[effect.name](w, effect)
    return w


def mean_answer(
    rng: np.random.Generator,
    world: World,
    tests: list[tuple[Wiring, np.ndarray]],
    gain: float,
) -> np.ndarray:
    """The oracle's output, averaged over remnants of its own."""
    answers = []
    for w, out in tests:
        draws = [
            opened(w, out, gain * remnant(rng, world.lag, world.order, world.noise))
            for _ in range(REALISATIONS)
        ]
        answers.append(np.mean(draws, axis=0))
    return np.array(answers)


def tune(wirings: list[Wiring], P_n: float) -> float:
    """The gain that makes the remnant's share of the variance of u P_n, to within 4 %."""
    if P_n == 0:
        return 0.0
    power, share = 0.0, 0.0
    for attempt in range(7):
        outs = [closed(w, np.sqrt(power)) for w in wirings]
        total = sum(float(np.var(out[U, KEPT])) for out in outs)
        noise = sum(float(np.var(w.given.noise[KEPT])) for w in wirings)
        share = power * noise / total
        if abs(share / P_n - 1) < 0.04:
            return float(np.sqrt(power))
        if attempt == 0:
            power = 0.8 * P_n * total / noise
        else:
            power *= min(P_n / share, 2.5)
    raise HopelessError(f"The remnant does not reach {P_n:.2f} but {share:.2f}.")
