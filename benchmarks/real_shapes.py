"""What the effect search shows of recorded machines when the name of what is missing is left out.

    pip install -e .
    python benchmarks/real_shapes.py [--data ../shared/data] [name ...]

Names: silverbox, drives, emps; all by default. They need the folder of recordings that the package
may not carry (its SOURCE.md files say where they come from); one that is missing is skipped. Exits
with 1 if a claim below is not met:

silverbox   unknown; the shape is a map of the spring, whose odd part bends like the cubic that the
            same model finds by name (within 5 % rms over the central 95 % of the data)
drives      unknown; the shape is a map of the output, whose bend is that of the absolute value
            (cosine > 0.9), in all three records
emps        unknown; the shape is a force over the speed that has its sign (cosine > 0.85)
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from real_machines import FORCE_PER_VOLT, run_of
from recorded import Claims, judged, searched
from scipy.signal import decimate

from skhoid import ARXRegressor, SimulatedARX
from skhoid.effects import HardeningStiffness
from skhoid.effects.catalogue import BY_NAME

Curve = Callable[[np.ndarray], np.ndarray]


def all_but(*names: str) -> list[str]:
    """Ids of the catalogue without some."""
    return [name for name in BY_NAME if name not in names]


def central(x: np.ndarray, n: int = 201) -> np.ndarray:
    """Places over the central 95 % of a signal."""
    return np.linspace(*np.quantile(x, [0.025, 0.975]), n)


def bend(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    """What of a curve is not a straight line."""
    return values - np.polyval(np.polyfit(x, values, 1), x)


def cosine(one: np.ndarray, other: np.ndarray) -> float:
    """Of two curves about their means."""
    one, other = one - one.mean(), other - other.mean()
    return float(one @ other / np.sqrt((one @ one) * (other @ other)))


def place_of(search: Any) -> str:
    """Where the shape acts, or that there is none."""
    return "no shape" if search.shape_ is None else f"{search.shape_.id} of {search.shape_.over}"


def make_curve(search: Any) -> Curve:
    """The shape's curve as a function of its abscissa, without what the band adds."""
    effect = search.shape_.effect
    return lambda x: np.asarray(effect.curve(np.asarray(effect.values), x))


def silverbox(data: Path) -> Claims:
    table = pd.read_parquet(data / "silverbox" / "SNLS80mV.parquet")[40_700:57_084]
    u, v = table["V1"].to_numpy(), table["V2"].to_numpy()
    X, y = run_of(("V1", "V2"), u, v, 2**14 / 1e7, ("V", "V"))
    model = SimulatedARX(2, 3, 0, fit_intercept=True, settling=0.1)
    named = model.set_params(effects=HardeningStiffness(form="cubic")).fit(X, y)
    stiffness = named.parameters_.loc["hardening_stiffness__stiffness", "value"]
    model = SimulatedARX(2, 3, 0, fit_intercept=True, settling=0.1)
    search = searched(model, X, y, effects=all_but("hardening_stiffness"))
    claims = [(f"{search.best_effects_}, {place_of(search)}", place_of(search).endswith(" of u"))]
    if claims[0][1]:
        x = central(v)
        force = make_curve(search)
        got, cubic = bend((force(x) - force(-x)) / 2, x), bend(stiffness * x**3, x)
        off = float(np.std(got - cubic) / np.std(cubic))
        claims.append((f"odd part: {100 * off:.1f} % off the cubic <= 5", off <= 0.05))
    return claims


def drives(data: Path) -> Claims:
    table = pd.read_csv(data / "coupled_electric_drives" / "DATAPRBS.csv")
    claims = []
    for record in (1, 2, 3):
        x, y = table[f"u{record}"].to_numpy(), table[f"z{record}"].to_numpy()
        X, output = run_of(("u", "z"), x, y, 0.02, ("V", "V"))
        search = searched(ARXRegressor(3, 3, 1), X, output, effects=all_but("sensor_magnitude"))
        like = 0.0
        if place_of(search) == "free_map of u":
            at = np.linspace(search.shape_.curve.index[0], search.shape_.curve.index[-1], 201)
            like = cosine(at + make_curve(search)(at), np.abs(at))
        claims.append(
            (f"record {record}: {search.best_effects_}, {place_of(search)}, {like:.2f}", like > 0.9)
        )
    return claims


def emps(data: Path) -> Claims:
    table = pd.read_parquet(data / "emps" / "DATA_EMPS.parquet")
    place = decimate(table["qm"].to_numpy(), 10)
    force = decimate(FORCE_PER_VOLT * table["vir"].to_numpy(), 10)
    speed = np.gradient(place, 0.01)
    X, y = run_of(("force", "speed"), force, speed, 0.01, ("N", "m/s"))
    claims = []
    for orders in ((1, 2, 0), (1, 1, 1)):
        model = ARXRegressor(*orders, fit_intercept=True)
        search = searched(model, X, y, effects=all_but("friction", "stiction", "dead_zone"))
        like = 0.0
        if search.shape_ is not None and search.shape_.id == "free_map":
            x = central(speed)
            like = abs(cosine(bend(make_curve(search)(x), x), bend(np.sign(x), x)))
        title = f"ARX{orders}: {search.best_effects_}, {place_of(search)}, {like:.2f}"
        claims.append((title, like > 0.85))
    return claims


RECORDINGS: dict[str, Callable[[Path], Claims]] = {f.__name__: f for f in (silverbox, drives, emps)}
FOLDERS = {"silverbox": "silverbox", "drives": "coupled_electric_drives", "emps": "emps"}

if __name__ == "__main__":
    sys.exit(judged(__doc__, RECORDINGS, FOLDERS))
