"""Every picture: what its artists show, without what it looks like."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from cases import case, public
from diagnosis_cases import ARX, OPERATOR, driven
from study_cases import SMALL
from worlds import NK, loop

import skhoid
from skhoid import ARXRegressor, EffectSearchCV, RecursiveARX, RecursiveARXCV

C4 = skhoid.tracking_condition("C4")


def shown(drawn: Any) -> dict[str, Any]:
    """Data and words of all axes of a figure."""
    found: dict[str, Any] = {}
    for i, ax in enumerate(drawn.figure_.axes):
        shapes = [p.get_path().transformed(p.get_patch_transform()) for p in ax.patches]
        texts = [text.get_text() for text in ax.texts]
        legend = ax.get_legend_handles_labels()[1]
        found[f"axes {i}"] = {
            "lines": [np.asarray(line.get_xydata(), dtype=float) for line in ax.lines],
            "marks": [np.ma.filled(c.get_offsets(), np.nan) for c in ax.collections],
            "areas": [path.vertices for c in ax.collections for path in c.get_paths()],
            "patches": [shape.vertices for shape in shapes],
            "images": [np.ma.filled(image.get_array(), np.nan) for image in ax.images],
            "words": [ax.get_title(), ax.get_xlabel(), ax.get_ylabel(), *legend, *texts],
        }
    return found


@cache
def things() -> dict[str, Any]:
    """What is drawn, fitted once."""
    X, y = loop("C4", 3)
    batch = ARXRegressor(nk=NK, inputs=["e"]).fit(X, y)
    path = RecursiveARX(nk=NK, inputs=["e"], memory_horizon=256, store_covariance=True).fit(X, y)
    grid = RecursiveARXCV([64, 256, np.inf], nk=NK, inputs=["e"]).fit(X, y)
    inputs = {"inputs": ["e"]}
    delays = skhoid.DelaySearchCV(ARXRegressor(**inputs), range(8, 20)).fit(X, y)
    orders = skhoid.OrderSearchCV(
        ARXRegressor(**inputs), na=[1, 2, 3], nb=[1, 2, 3], nk=[NK], factor=[1, 2]
    ).fit(X, y)
    hidden = driven(inner=lambda e: e - e.clip(-0.3, 0.3))
    names = ["dead_zone", "bias", "asym_gain"]
    search = EffectSearchCV(OPERATOR, names).fit(*hidden)
    of_arx = EffectSearchCV(ARX, names).fit(*hidden)
    return {
        "X": X, "y": y, "batch": batch, "path": path, "grid": grid, "delays": delays,
        "orders": orders, "hidden": hidden, "search": search, "of arx": of_arx,
        "comparison": skhoid.compare(batch, X, y),
    }  # fmt: skip


def display(name: str) -> Any:
    return public(f"{name}Display")


def picture(draw: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    mpl.use("Agg")
    try:
        return shown(draw(things()))
    finally:
        plt.close("all")


def experiment(_: dict[str, Any]) -> Any:
    X, y = skhoid.simulate_experiment(1, ["C1", "C4"], 3, sampling_rate=50.0, random_state=0)
    result = skhoid.analyse_experiment(X, y, last=2, memory_horizon=128.0)
    return display("Experiment").from_result(result, "C4")


PICTURES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "bode": lambda t: display("Bode").from_estimator(t["batch"]),
    "bode of a loop": lambda t: display("Bode").from_estimator(
        t["batch"], controlled_element=skhoid.ControlledElement()
    ),
    "delays": lambda t: display("DelayLoss").from_estimator(t["delays"]),
    "effect ranking": lambda t: display("EffectRanking").from_estimator(t["search"]),
    "effect steps": lambda t: display("EffectSteps").from_estimator(t["search"]),
    "error path": lambda t: display("ErrorPath").from_estimator(t["search"]),
    "identified effect": lambda t: display("IdentifiedEffect").from_estimator(
        t["search"], None, *t["hidden"]
    ),
    "identified effect of arx": lambda t: display("IdentifiedEffect").from_estimator(
        t["of arx"], None, *t["hidden"], n_draws=50
    ),
    "forgetting": lambda t: display("ForgettingProfile").from_estimator(t["path"]),
    "horizons": lambda t: display("MemoryHorizon").from_estimator(t["grid"]),
    "operator": lambda t: display("OperatorParameters").from_estimator(
        t["path"], truth=C4.operator
    ),
    "path": lambda t: display("ParameterPath").from_estimator(t["path"]),
    "simulation": lambda t: display("Simulation").from_estimator(t["batch"], t["X"], t["y"]),
    "tracking": lambda t: display("Tracking").from_runs(t["X"], t["y"]),
    "orders": lambda t: display("VAFContour").from_estimator(t["orders"]),
    "experiment": experiment,
}
for _name in (
    "Comparison",
    "NoiseCeiling",
    "OperatingPoint",
    "ResidualCorrelation",
    "ResidualFrequency",
    "ResidualMap",
    "ResidualTime",
    "RunComparison",
):
    PICTURES[_name] = lambda t, name=_name: display(name).from_comparison(t["comparison"])
for _name, _draw in PICTURES.items():
    case(f"displays/{_name}", draw=_draw)(picture)


def figures_of(name: str, n_replications: int, **options: Any) -> dict[str, Any]:
    import matplotlib.pyplot as plt

    found = public(name)(n_replications, **options)
    try:
        return {key: shown(draw()) for key, draw in found.figures.items()}
    finally:
        plt.close("all")


for _name, _options in SMALL.items():
    case(f"displays/{_name}", name=_name, n_replications=2, **_options)(figures_of)
