"""What the effect search says of real recordings, and what its models gain on unseen parts.

    pip install -e .
    python benchmarks/real_effects.py [--data ../shared/data] [name ...]

Names: silverbox, hair_dryer, robot_arm, tracking, bicycle; all by default. The first three need the
folder of recordings that the package may not carry (its SOURCE.md files say where they come from),
and are skipped where it is missing. Exits with 1 if a claim below is not met:

silverbox   the cubic spring alone is named, from multisines; free run of the louder arrow <= 2 mV
hair_dryer  the delay alone is named from nk=1, and nothing is found with nk=3
robot_arm   higher order is named first from ARX(2, 2); from ARX(4, 5) it is not
tracking    something is missing that no effect explains (reported: there is no truth)
bicycle     the pull force pays most of what a rider can feel (reported: there is no truth)
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from recorded import Claims, Table, judged, searched

from skhoid import (
    ARXRegressor,
    OperatorRegressor,
    SimulatedARX,
    load_bicycle_rider,
    load_human_tracking,
)
from skhoid.effects import MotionFeedback


def run_of(x: np.ndarray, y: np.ndarray, dt: float, units: tuple[str, str]) -> Table:
    """One run with the input e and the output u."""
    index = pd.MultiIndex.from_product([["run"], np.arange(x.size) * dt], names=["run", "time"])
    X, output = pd.DataFrame({"e": x}, index), pd.Series(y, index, name="u")
    X.attrs["units"], output.attrs["units"] = {"e": units[0]}, {"u": units[1]}
    return X, output


def silverbox(data: Path) -> Claims:
    table = pd.read_parquet(data / "silverbox" / "SNLS80mV.parquet")
    x, y = table["V1"].to_numpy(), table["V2"].to_numpy()
    dt = 2**14 / 1e7
    fitted = run_of(x[40_700:127_400], y[40_700:127_400], dt, ("V", "V"))
    arrow, measured = run_of(x[:40_500], y[:40_500], dt, ("V", "V"))
    claims = []
    for orders in ((2, 3, 0), (2, 1, 1)):
        search = searched(SimulatedARX(*orders, fit_intercept=True, settling=0.1), *fitted)
        before, after = (
            1e3 * float(np.sqrt(np.mean((measured - model.predict(arrow)) ** 2)))
            for model in (search.baseline_, search.best_estimator_)
        )
        print(f"arrow: {before:.2f} -> {after:.3f} mV rms\n")
        claims += [
            (f"ARX{orders}: hardening_stiffness", search.best_effects_ == ["hardening_stiffness"]),
            (f"ARX{orders}: {after:.2f} mV <= 2 mV", after <= 2.0),
        ]
    return claims


def halves(data: Path, name: str, dt: float, units: tuple[str, str]) -> tuple[Table, Callable]:
    """First half of a record of DaISy, from its means, and the VAF of a model on the second."""
    table = pd.read_csv(data / "daisy" / name)
    middle = len(table) // 2
    x, y = (table - table[:middle].mean()).to_numpy().T
    X, output = run_of(x, y, dt, units)

    def unseen(model: Any) -> float:
        late = y[middle:]
        error = late - model.predict(X)[middle:]
        return 100 * (1 - float(error @ error) / float(np.sum((late - late.mean()) ** 2)))

    return (X[:middle], output[:middle]), unseen


def hair_dryer(data: Path) -> Claims:
    fitted, unseen = halves(data, "hairdryer.csv", 0.08, ("V", "V"))
    claims = []
    for nk, expected in ((1, ["wrong_delay"]), (3, [])):
        model = SimulatedARX(2, 2, nk, settling=1.0)
        search = searched(model, *fitted)
        plain = ARXRegressor(2, 2, nk).fit(*fitted)
        print(f"second half: least squares {unseen(plain):.1f} %, in simulation", end=" ")
        print(f"{unseen(search.baseline_):.1f} %, best {unseen(search.best_estimator_):.1f} %\n")
        claims.append((f"nk={nk}: {expected}", search.best_effects_ == expected))
    return claims


def robot_arm(data: Path) -> Claims:
    fitted, unseen = halves(data, "robot_arm.csv", 1.0, ("-", "-"))
    claims = []
    for orders in ((2, 2, 0), (4, 5, 0)):
        # It rings for some hundred samples, and does not begin at rest.
        search = searched(SimulatedARX(*orders, settling=200.0), *fitted)
        plain = ARXRegressor(*orders).fit(*fitted)
        print(f"second half: least squares {unseen(plain):.1f} %, in simulation", end=" ")
        print(f"{unseen(search.baseline_):.1f} %, best {unseen(search.best_estimator_):.1f} %\n")
        added = search.ranking_.query("status == 'added'")["effect"].tolist()
        short = orders == (2, 2, 0)
        claims.append((f"ARX{orders}: adds {added}", (added[:1] == ["higher_order"]) == short))
    return claims


def tracking(data: Path) -> Claims:
    for names in (
        ["difficulty 50", "difficulty 80"],
        [f"phase-size 2{letter}" for letter in "bcde"],
    ):
        X, y = load_human_tracking(names)
        middle = X["f_t"].mean()
        X["f_t"] -= middle
        y -= middle
        for model in (
            OperatorRegressor(inputs=["f_t"]),
            SimulatedARX(2, 2, 7, inputs=["f_t"], settling=2.0),
        ):
            search = searched(model, X, y, display="pursuit")
            print(search.baseline_.parameters_[["value", "sd", "unit"]].round(3).to_string(), "\n")
    return []


def bicycle(data: Path) -> Claims:
    roles = {"RollAngle": "e", "RollRate": "motion_roll", "YawRate": "motion_yaw"}
    roles["PullForce"] = "dist"
    felt = [MotionFeedback(channel="RollRate", form="direct"), "disturbance"]
    for title, columns, options in (
        ("all channels, all effects", list(roles), {"max_effects": 1}),
        ("what a rider can feel", ["RollAngle", "RollRate", "PullForce"], {"effects": felt}),
    ):
        X, y = load_bicycle_rider(inputs=columns)
        units = X.attrs, y.attrs
        X, y = X - X.mean(), y - y.mean()
        X.attrs, y.attrs = units
        X["RollRate"] *= -1  # feedback is subtracted
        print(title)
        model = OperatorRegressor(roles={name: roles[name] for name in columns})
        ranking = searched(model, X, y, **options).ranking_
        shown = ["effect", "form", "parameters", "delta_bic", "vaf_gain"]
        print(ranking.query("step == 1")[shown].head(4).round(2).to_string(), "\n")
    return []


RECORDINGS = {f.__name__: f for f in (silverbox, hair_dryer, robot_arm, tracking, bicycle)}
FOLDERS = {"silverbox": "silverbox", "hair_dryer": "daisy", "robot_arm": "daisy"}


if __name__ == "__main__":
    sys.exit(judged(__doc__, RECORDINGS, FOLDERS))
