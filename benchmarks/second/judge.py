"""Give a case to the search and judge what it says: names, delay, fresh runs, and the plant's
inverse.

Open it for what is scored. The search is reached through its public interface alone; another class
can take its place (``who``), see ``standins.py``.
"""

import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from .cases import OFFSETS, Case
from .elements import Element
from .forms import UNKNOWN

Who = Callable[[Case, float | None], Any]
LEAK_INVERSE, LEAK_RESIDUAL = 0.85, -0.35


def controlled_element(element: Element) -> Any:
    """The element as the product takes it today: by its text, else as K_c and omega_b, else None
    (estimated).
    """
    from skhoid import ControlledElement

    for arguments in ((element.text,), (element.gain, element.pole)):
        if len(arguments) == 2 and element.order == 1:
            continue
        try:
            return ControlledElement(*arguments)
        except (TypeError, ValueError):
            continue
    return None


def product(case: Case, delay: float | None) -> Any:
    """The search as a user calls it."""
    from skhoid import EffectSearchCV, OperatorRegressor

    element = controlled_element(case.world.element)
    return EffectSearchCV(
        OperatorRegressor(delay=delay), display=case.world.display, controlled_element=element
    )


def untold(case: Case, delay: float | None) -> Any:
    """The search of a user who does not say what the element is."""
    from skhoid import EffectSearchCV, OperatorRegressor

    return EffectSearchCV(OperatorRegressor(delay=delay), display=case.world.display)


def baseline(case: Case, delay: float | None) -> Any:
    """The product's operator without any effect."""
    from skhoid import OperatorRegressor

    return OperatorRegressor(delay=delay)


def vaf(y: np.ndarray, prediction: np.ndarray) -> float:
    """Percent of the variance about the mean that is explained, unclipped; at least -999."""
    known = np.isfinite(prediction)
    y, prediction = y[known], prediction[known]
    if not len(y):
        return -999.0
    return max(
        -999.0, float(100 * (1 - np.sum((y - prediction) ** 2) / np.sum((y - y.mean()) ** 2)))
    )


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Correlation where both are known; 0 where one does not move."""
    known = np.isfinite(a) & np.isfinite(b)
    a, b = a[known] - a[known].mean(), b[known] - b[known].mean()
    size = float(np.sqrt((a**2).sum() * (b**2).sum()))
    return float((a * b).sum() / size) if size > 0 else 0.0


def judge(
    case: Case, who: Who, delay: float | None = None, *, with_baseline: bool = True
) -> dict[str, Any]:
    """One row of the results."""
    X, y, X_new, y_new = case.tables()
    row = described(case)
    started = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search = who(case, delay).fit(X, y)
        row["seconds"] = round(time.perf_counter() - started, 1)
        row["names"] = [str(name) for name in search.best_effects_]
        prediction = np.asarray(search.best_estimator_.predict(X_new), float).ravel()
        row["vaf_named"] = vaf(y_new.to_numpy(), prediction)
        if with_baseline:
            alone = baseline(case, delay).fit(X, y).predict(X_new)
            row["vaf_baseline"] = vaf(y_new.to_numpy(), np.asarray(alone, float).ravel())
    row |= delay_row(case, search)
    row |= leak_row(case, y_new.to_numpy(), prediction)
    row |= name_row(case, row["names"])
    return row


def described(case: Case) -> dict[str, Any]:
    """What the case is."""
    world, chosen = case.world, case.hidden
    row = {
        "suite": case.suite,
        "seed": case.seed,
        "element": world.element.name,
        "transfer": world.element.text,
        "display": world.display,
        "dist": world.dist_recorded,
        "rate": world.rate,
        "runs": len(case.old),
        "seconds_per_run": round(world.runs[0].keep / 600.0, 1),
        "share": round(world.scale["share"], 3),
        "coherent": round(case.coherent, 1),
        "tau": round(world.delay, 4),
        "drawn_for": case.element,
        "element_given": controlled_element(world.element) is not None,
    }
    if chosen is not None:
        row |= {
            "effect": chosen.effect,
            "form": chosen.name,
            "place": chosen.place,
            "strength": case.strength,
            "gap": round(case.gap, 2),
            "accepted": list(chosen.accepted),
        }
    return row


def name_row(case: Case, names: list[str]) -> dict[str, Any]:
    """Right and false names; with nothing hidden every name is false. ``unknown`` is neither,
    but right where no catalogue holds what is hidden.
    """
    accepted = case.hidden.accepted if case.hidden is not None else ()
    said = [n for n in names if n != UNKNOWN or n in accepted]
    accepted = (*accepted, *case.also)
    if case.suite == "leaks" and stops_reached(case):
        accepted = (*accepted, "saturation")
    wrong = [n for n in said if n not in accepted]
    row: dict[str, Any] = {"false_names": wrong, "unknown": UNKNOWN in names}
    if case.hidden is not None:
        row["right_any"] = any(n in case.hidden.accepted for n in said)
        row["right"] = row["right_any"] and said[0] in accepted
        each = case.hidden.each
        row["exact"] = bool(said) and said[0] in [one[0] for one in each]
        if len(each) > 1:
            row["both"] = both_named(each, said)
    return row


def both_named(each: list[tuple[str, ...]], said: list[str]) -> bool:
    """Whether two different names serve the two effects of a pair."""
    one, other = ({i for i, name in enumerate(said) if name in names} for names in each)
    return any(i != j for i in one for j in other)


def stops_reached(case: Case) -> bool:
    """More than 1 % of the recorded samples lie at the stops of the slider: saturation is then
    there too.
    """
    u = np.concatenate([case.world.cut(case.world.runs[i], case.closed[i][:, 2]) for i in case.old])
    return bool(np.mean(np.abs(u) >= case.world.pars["stick_a"][0] - 1e-9) > 0.01)


def delay_row(case: Case, search: Any) -> dict[str, Any]:
    """The effective delay: its error (s), and whether its interval holds the pure delay."""
    true = case.world.delay
    try:
        found = search.best_estimator_.parameters_.loc["tau_e", ["value", "low", "high"]].to_numpy(
            float
        )
    except (AttributeError, KeyError):
        return {}
    return {
        "tau_error": round(float(found[0]) - true, 4),
        "tau_low": round(float(found[1]), 4),
        "tau_high": round(float(found[2]), 4),
        "tau_covered": bool(found[1] <= true <= found[2]),
    }


def leak_row(case: Case, y: np.ndarray, prediction: np.ndarray) -> dict[str, Any]:
    """The plant's inverse on the fresh runs: the prediction is u + d, and its residual is -d."""
    inverse, d = case.world.inverse(case.closed, case.new)
    with_inverse, with_d = correlation(prediction, inverse), correlation(y - prediction, d)
    leaks = (
        not case.world.dist_recorded and with_inverse >= LEAK_INVERSE and with_d <= LEAK_RESIDUAL
    )
    return {"r_inverse": round(with_inverse, 3), "r_disturbance": round(with_d, 3), "leak": leaks}


def given_delays(case: Case, who: Who, offsets: tuple[int, ...] = OFFSETS) -> dict[str, Any]:
    """The row of the free delay, and the names that each wrong delay gives; same: the list but for
    wrong_delay.
    """
    row = judge(case, who, None, with_baseline=False)
    X, y, _, _ = case.tables()
    row["given"] = {}
    for offset in offsets:
        delay = round((round(case.world.delay * case.world.rate) + offset) / case.world.rate, 9)
        if delay < 0:
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            names = [str(n) for n in who(case, delay).fit(X, y).best_effects_]
        row["given"][str(offset)] = {
            "delay": delay,
            "names": names,
            "same": [n for n in names if n != "wrong_delay"] == row["names"],
            "same_first": next((n for n in names if n != "wrong_delay"), "")
            == next(iter(row["names"]), ""),
        }
    return row
