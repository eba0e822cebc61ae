"""What other packages make of the same recordings: response, free run, time, names.

    pip install -e ".[bench]" sippy_unipi slycot nfoursid control
    python benchmarks/other_tools.py

1. *A simulated person in a closed loop* (condition C1 of the thesis, remnant of 15 %): each method
   gets one run, five times another one. Its frequency response is compared with the truth at the
   target's ten lines, and its free run with three other runs. Orders and delay are given to all.
2. *A recorded person* (bundled): one run to fit, three others with the same target to judge.
3. *A simulated person with a dead zone*: which nonlinear model, and does it have a name?

Times are ratios to ``ARXRegressor.fit``, best of repeats taken in turn. A package that is not
installed is left out. ``bench_recursion.py`` compares recursive least squares in the same way.
"""

from __future__ import annotations

import io
import os
import platform
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: one thread for everybody

import numpy as np
import pandas as pd
from scipy.signal import dlsim, dlti, lfilter
from sklearn.base import clone

from skhoid import (
    ARXRegressor,
    EffectSearchCV,
    HumanOperator,
    Multisine,
    OperatorRegressor,
    load_human_tracking,
    make_tracking_runs,
)
from skhoid.effects import DeadZone

PACKAGES = ("skhoid", "numpy", "scipy", "sysidentpy", "sippy_unipi", "statsmodels", "nfoursid")
PACKAGES += ("control",)
N_FITTED, N_HELD_OUT, REMNANT = 5, 3, 0.15
SLOW, REPEATS = 1.0, 15  # seconds; what takes longer is timed once
FIR = 120  # coefficients
UNSTABLE = -1000.0  # VAF in percent of a free run that has gone off
Frames = tuple[pd.DataFrame, pd.Series]


@dataclass
class Found:
    """A linear model: simulates the output from the error, and has a frequency response."""

    simulate: Callable[[np.ndarray], np.ndarray] | None
    response: Callable[[np.ndarray], np.ndarray]  # of z


@dataclass
class Recording:
    """One run to fit, others to judge, and what is known of them."""

    X: pd.DataFrame
    y: pd.Series
    held_out: Frames
    nk: int
    dt: float

    @property
    def e(self) -> np.ndarray:
        return self.X["e"].to_numpy()

    @property
    def u(self) -> np.ndarray:
        return self.y.to_numpy()


Method = Callable[[Recording], Found]


def rational(b: np.ndarray, a: np.ndarray, nk: int) -> Found:
    """B(q) e(t - nk) / A(q), ``a`` without the leading 1."""
    numerator, denominator = np.r_[np.zeros(nk), b], np.r_[1.0, a]

    def response(z: np.ndarray) -> np.ndarray:
        return np.polyval(numerator[::-1], 1 / z) / np.polyval(denominator[::-1], 1 / z)

    return Found(lambda e: lfilter(numerator, denominator, e), response)


def lags(r: Recording) -> tuple[np.ndarray, np.ndarray]:
    first = r.nk + 1
    u, e = r.u, r.e
    columns = [-u[first - 1 : -1], -u[first - 2 : -2], e[first - r.nk : -r.nk], e[: -r.nk - 1]]
    return np.column_stack(columns), u[first:]


def numpy_lstsq(r: Recording) -> Found:
    theta = np.linalg.lstsq(*lags(r), rcond=None)[0]
    return rational(theta[2:], theta[:2], r.nk)


def numpy_fft(r: Recording) -> Found:
    """U/E at the lines of the target: no model."""
    U, E = np.fft.rfft(r.u), np.fft.rfft(r.e)

    def response(z: np.ndarray) -> np.ndarray:
        line = np.rint(np.angle(z) / (2 * np.pi) * r.u.size).astype(int)
        return U[line] / E[line]

    return Found(None, response)


def skhoid_arx(r: Recording, **options: str) -> Found:
    model = ARXRegressor(2, 2, r.nk, inputs=["e"], **options).fit(r.X, r.y)
    return rational(model.b_, model.a_, r.nk)


def skhoid_operator(r: Recording) -> Found:
    model = OperatorRegressor(inputs=["e"]).fit(r.X, r.y)

    def simulate(e: np.ndarray) -> np.ndarray:
        index = pd.MultiIndex.from_product([[0], np.arange(e.size) * r.dt], names=["run", "time"])
        return model.predict(pd.DataFrame({**dict.fromkeys(r.X, 0.0), "e": e}, index=index))

    def response(z: np.ndarray) -> np.ndarray:
        names = ["K_e", "T_L", "tau_e", "omega_nm", "zeta_nm"]
        person = HumanOperator(**model.parameters_.loc[names, "value"])
        return person.frequency_response(np.angle(z) / r.dt)

    return Found(simulate, response)


def sysidentpy_frols(r: Recording) -> Found:
    """FROLS with least squares, told the four regressors."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    model = FROLS(
        n_terms=4,
        order_selection=False,
        ylag=[1, 2],
        xlag=[r.nk, r.nk + 1],
        basis_function=Polynomial(degree=1),
        estimator=LeastSquares(),
    )
    model.fit(X=r.e[:, None], y=r.u[:, None])
    theta = {
        int(term[0]): value
        for term, value in zip(model.final_model, model.theta[:, 0], strict=True)
    }
    a = -np.array([theta.get(1001, 0.0), theta.get(1002, 0.0)])
    b = np.array([theta.get(2000 + r.nk, 0.0), theta.get(2001 + r.nk, 0.0)])
    if not set(theta) <= {1001, 1002, 2000 + r.nk, 2001 + r.nk}:
        raise RuntimeError(f"terms that are not linear: {sorted(theta)}")
    return rational(b, a, r.nk)


def sippy(method: str) -> Method:
    orders = {"ARX": [2, 2], "ARMAX": [2, 2, 2], "OE": [2, 2]}[method]

    def fit(r: Recording) -> Found:
        from sippy_unipi import system_identification

        options = {f"{method}_orders": [*orders, r.nk]}
        with redirect_stdout(io.StringIO()):
            G = system_identification(r.u, r.e, method, tsample=r.dt, **options).G
        b, a = np.atleast_1d(np.squeeze(G.num)), np.atleast_1d(np.squeeze(G.den))
        a = np.trim_zeros(a, "b")  # the delay is poles at zero
        return rational(b, a[1:] / a[0], r.nk)

    return fit


def statsmodels_autoreg(r: Recording) -> Found:
    """AutoReg with two lags of the error as exogenous columns."""
    from statsmodels.tsa.ar_model import AutoReg

    exogenous = np.column_stack([np.r_[np.zeros(k), r.e[:-k]] for k in (r.nk, r.nk + 1)])
    model = AutoReg(r.u[r.nk - 1 :], 2, trend="n", exog=exogenous[r.nk - 1 :]).fit()
    return rational(model.params[2:], -model.params[:2], r.nk)


def state_space(matrices: tuple[np.ndarray, ...], shift: int, dt: float) -> Found:
    """A, B, C, D of an input that was shifted."""
    A, B, C, D = (np.atleast_2d(matrix) for matrix in matrices)
    system = dlti(A, B, C, D, dt=dt)

    def response(z: np.ndarray) -> np.ndarray:
        inverse = np.linalg.inv(z[:, None, None] * np.eye(len(A)) - A)
        return (C @ inverse @ B + D)[:, 0, 0] / z**shift

    def simulate(e: np.ndarray) -> np.ndarray:
        return dlsim(system, np.r_[np.zeros(shift), e[:-shift]])[1][:, 0]

    return Found(simulate, response)


def nfoursid_subspace(r: Recording) -> Found:
    """N4SID of order two; 40 block rows did better than 5 and 15."""
    from nfoursid.nfoursid import NFourSID

    shift = r.nk - 1
    table = pd.DataFrame({"e": r.e[:-shift], "u": r.u[shift:]})
    search = NFourSID(table, output_columns=["u"], input_columns=["e"], num_block_rows=40)
    search.subspace_identification()
    model, _ = search.system_identification(rank=2)
    return state_space((model.a, model.b, model.c, model.d), shift, r.dt)


def sippy_parsim(r: Recording) -> Found:
    """PARSIM-K of order two: better here than N4SID, MOESP, CVA, and than a horizon of 20."""
    from sippy_unipi import system_identification

    shift = r.nk - 1
    with redirect_stdout(io.StringIO()):
        s = system_identification(
            r.u[shift:],
            r.e[:-shift],
            "PARSIM-K",
            tsample=r.dt,
            SS_fixed_order=2,
            SS_f=50,
            SS_p=50,
        )
    return state_space((s.A, s.B, s.C, s.D), shift, r.dt)


def control_markov(r: Recording, delay: int | None = None) -> Found:
    """python-control's Markov parameters: an impulse response by least squares."""
    import control

    nk = r.nk if delay is None else delay
    u, e = r.u[nk:], r.e[: r.e.size - nk]
    return rational(np.squeeze(control.markov(u, e, m=FIR)), np.array([]), nk)


METHODS: dict[str, Method] = {
    "skhoid ARXRegressor": skhoid_arx,
    'skhoid ARXRegressor(method="iv")': lambda r: skhoid_arx(r, method="iv"),
    "skhoid OperatorRegressor (delay not given)": skhoid_operator,
    "NumPy lstsq on lags": numpy_lstsq,
    "NumPy FFT, U/E at the lines": numpy_fft,
    "SysIdentPy FROLS, terms given": sysidentpy_frols,
    "SIPPY ARX": sippy("ARX"),
    "SIPPY ARMAX": sippy("ARMAX"),
    "SIPPY OE": sippy("OE"),
    "statsmodels AutoReg, exog": statsmodels_autoreg,
    "SIPPY PARSIM-K": sippy_parsim,
    "nfoursid N4SID": nfoursid_subspace,
    "python-control markov": control_markov,
    "python-control markov, delay not given": lambda r: control_markov(r, 0),
}


def vaf(y: np.ndarray, simulated: np.ndarray, settle: int) -> float:
    kept = slice(settle, None)
    return 100 * (1 - np.sum((y[kept] - simulated[kept]) ** 2) / np.sum(y[kept] ** 2))


def held_out_vaf(found: Found, r: Recording) -> float:
    """Of runs that were not fitted, but for two seconds; -inf if it is unstable."""
    if found.simulate is None:
        return np.nan
    X, y = r.held_out
    runs = [(X.loc[run, "e"].to_numpy(), y.loc[run].to_numpy()) for run in X.index.unique("run")]
    mean = float(np.mean([vaf(u, found.simulate(e), round(2 / r.dt)) for e, u in runs]))
    return mean if mean > UNSTABLE else -np.inf


def seconds(*methods: Callable[[], object]) -> list[float]:
    """Best time of each, called in turn; what is slow is called once."""
    best = [np.inf] * len(methods)
    for _ in range(REPEATS):
        for i, method in enumerate(methods):
            if best[i] < np.inf and best[i] > SLOW:
                continue
            start = time.perf_counter()
            method()
            best[i] = min(best[i], time.perf_counter() - start)
    return best


def simulated_person(effects: object = None) -> tuple[list[Recording], pd.Series]:
    X, y, truth = make_tracking_runs(
        "C1",
        n_runs=N_FITTED + N_HELD_OUT,
        remnant_intensity=REMNANT,
        channels=["e", "x", "f_t"],
        effects=effects,
        return_truth=True,
        random_state=0,
    )
    others = list(range(N_FITTED, N_FITTED + N_HELD_OUT))
    held_out = X.loc[others], y.loc[others]
    found = [Recording(X.loc[[k]], y.loc[[k]], held_out, 29, 0.01) for k in range(N_FITTED)]
    return found, truth.remnant.loc[others]


def recorded_person() -> Recording:
    X, y = load_human_tracking(["phase-size 2b", "phase-size 2c", "phase-size 2d", "phase-size 2e"])
    middle = X["f_t"].mean()
    X, y = X.assign(f_t=X["f_t"] - middle), y - middle
    first, *others = X.index.unique("run")
    return Recording(X.loc[[first]], y.loc[[first]], (X.loc[others], y.loc[others]), 6, 1 / 60)


def linear_methods() -> pd.DataFrame:
    """Error of the response, VAF of free runs and time of each method."""
    recordings, remnant = simulated_person()
    measured = recorded_person()
    omega = Multisine().omega
    truth = HumanOperator(K_e=0.09, T_L=0.4, tau_e=0.28, omega_nm=11.25, zeta_nm=0.35)
    H = truth.frequency_response(omega)
    z = np.exp(1j * omega * recordings[0].dt)
    ceiling = 100 * (1 - (remnant**2).sum() / (recordings[0].held_out[1] ** 2).sum())
    print(f"The true operator has a VAF of {ceiling:.1f} % on the held-out runs.")
    rows = {}
    for name, method in METHODS.items():
        try:
            found = [method(r) for r in recordings]
        except ImportError as error:
            print(f"{name}: left out, {error}")
            continue
        errors = [np.sqrt(np.mean(np.abs(f.response(z) / H - 1) ** 2)) for f in found]
        ours, theirs = seconds(partial(skhoid_arx, recordings[0]), partial(method, recordings[0]))
        rows[name] = {
            "response error, %": 100 * np.mean(errors),
            "VAF simulated, %": np.mean([held_out_vaf(f, recordings[0]) for f in found]),
            "VAF recorded, %": recorded_vaf(method, measured),
            "time": theirs / ours,
        }
    return pd.DataFrame(rows).T


def recorded_vaf(method: Method, r: Recording) -> float:
    """With the target as input, as the person saw it."""
    as_error = Recording(
        r.X[["f_t"]].rename(columns={"f_t": "e"}),
        r.y,
        (r.held_out[0].rename(columns={"e": "not used", "f_t": "e"}), r.held_out[1]),
        r.nk,
        r.dt,
    )
    try:
        return held_out_vaf(method(as_error), as_error)
    except (ValueError, KeyError) as error:  # such as no instrument
        print(f"recorded person: {str(error).partition(':')[0]}")
        return np.nan


def narx(r: Recording, degree: int) -> tuple[float, int, float]:
    """SysIdentPy's polynomial NARX, terms chosen by BIC: VAF, terms, seconds."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    start = time.perf_counter()
    model = FROLS(
        ylag=[1, 2],
        xlag=[r.nk, r.nk + 1],
        n_info_values=25,
        info_criteria="bic",
        basis_function=Polynomial(degree=degree),
        estimator=LeastSquares(),
    )
    model.fit(X=r.e[:, None], y=r.u[:, None])
    took = time.perf_counter() - start
    X, y = r.held_out
    vafs = []
    for run in X.index.unique("run"):
        u = y.loc[run].to_numpy()
        start_values = u[: model.max_lag, None]
        free = model.predict(X=X.loc[run, ["e"]].to_numpy(), y=start_values)[:, 0]
        vafs.append(vaf(u, free, round(2 / r.dt)))
    return float(np.mean(vafs)), len(model.theta), took


def nonlinear_methods() -> None:
    """A dead zone that nobody was told of."""
    recordings, remnant = simulated_person(DeadZone(width=0.3))
    r = recordings[0]
    X, y = r.held_out
    print(f"ceiling {100 * (1 - (remnant**2).sum() / (y**2).sum()):.1f} %")
    linear = skhoid_operator(r)
    print(f"skhoid OperatorRegressor: VAF {held_out_vaf(linear, r):.1f} %")
    start = time.perf_counter()
    search = EffectSearchCV(OperatorRegressor(inputs=["e"])).fit(r.X, r.y)
    took = time.perf_counter() - start
    best = search.best_estimator_
    runs = X.index.unique("run")
    u = [(y.loc[k].to_numpy(), np.asarray(best.predict(X.loc[[k]]))) for k in runs]
    found = np.mean([vaf(*pair, round(2 / r.dt)) for pair in u])
    width = best.parameters_.loc[[i for i in best.parameters_.index if "width" in i], "value"]
    print(f"skhoid EffectSearchCV: VAF {found:.1f} %, {search.best_effects_}, {width.to_dict()}")
    print(f"  {took:.1f} s")
    try:
        for degree in (1, 2, 3, 5):
            found, terms, took = narx(r, degree)
            print(
                f"SysIdentPy NARX, degree {degree}: VAF {found:.1f} %, {terms} terms, {took:.1f} s"
            )
    except ImportError as error:
        print(f"SysIdentPy: left out, {error}")


def abilities() -> None:
    """What happens to one missing output, and in scikit-learn's own tools."""
    recordings, _ = simulated_person()
    r = recordings[0]
    holed = Recording(r.X, r.y.copy(), r.held_out, r.nk, r.dt)
    holed.y.iloc[4000] = np.nan
    for name in ("skhoid ARXRegressor", "SysIdentPy FROLS, terms given", "SIPPY ARX"):
        print(f"{name}, one NaN in y: {outcome(partial(METHODS[name], holed))}")
    print(f"statsmodels, one NaN in y: {outcome(partial(statsmodels_autoreg, holed))}")
    print(f"clone(ARXRegressor()): {outcome(lambda: clone(ARXRegressor()))}")

    def copied() -> object:
        from sysidentpy.basis_function import Polynomial
        from sysidentpy.model_structure_selection import FROLS

        return clone(FROLS(basis_function=Polynomial(degree=1)))

    print(f"clone(FROLS(...)): {outcome(copied)}\n")


def outcome(call: Callable[[], object]) -> str:
    try:
        call()
    except Exception as error:
        return f"{type(error).__name__}: {str(error).splitlines()[0][:60]}"
    return "works"


def main() -> int:
    warnings.simplefilter("ignore")  # of the packages; their results are what is compared
    found = []
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    print(f"Python {platform.python_version()}, {platform.machine()}; {', '.join(found)}\n")
    print(linear_methods().to_string(float_format="%.1f"), "\n")
    abilities()
    nonlinear_methods()
    return 0


if __name__ == "__main__":
    sys.exit(main())
