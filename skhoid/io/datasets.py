"""Recordings of real human controllers, included in the package."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib import resources
from numbers import Integral

import numpy as np
import pandas as pd

from .._sklearn import StrOptions, checked
from ..preprocessing import resample_runs

__all__ = ["load_bicycle_rider", "load_human_tracking"]

# The order of the recordings in the source, and which target each one shows.
_RECORDINGS = {
    "difficulty 50": "difficulty 50",
    "difficulty 80": "difficulty 80",
    "phase-size 1": "phase-size 1",
    "phase-size 2a": "phase-size 2a",
    "phase-size 2b": "phase-size 2b",
    "phase-size 2c": "phase-size 2b",
    "phase-size 2d": "phase-size 2b",
    "phase-size 2e": "phase-size 2b",
    "phase-size 3a": "phase-size 3a",
    "phase-size 3b": "phase-size 3a",
}
_TRACKING_UNITS = {"f_t": "px", "e": "px", "x": "px", "size_s": "px", "phase_f": "1"}
# Until about the tenth frame the cursor is at (0, 0), or where the last recording left it.
_INVALID_FRAMES = 10
_TICKS_PER_SECOND = 1e7
_FRAME_RATE = 60

_BICYCLE_RATE = 200
_BICYCLE_UNITS = {
    "SteerAngle": "rad",
    "SteerRate": "rad/s",
    "RollAngle": "rad",
    "RollRate": "rad/s",
    "YawRate": "rad/s",
    "PitchRate": "rad/s",
    "ForwardSpeed": "m/s",
    "RearWheelRate": "rad/s",
    "SteerTorque": "N m",
    "PullForce": "N",
    "PushButton": "V",
    "FiveVolts": "V",
    "ThreeVolts": "V",
}
_CONVERTED_TWICE = ("RollRate", "YawRate", "PitchRate")


@checked(
    recordings=[str, Integral, "array-like"],
    axis=[StrOptions({"x", "y"})],
    channels=[str, "array-like"],
    resample=["boolean"],
)
def load_human_tracking(
    recordings: str | int | Sequence[str | int] = "all",
    *,
    axis: str = "x",
    channels: str | Sequence[str] = ("f_t",),
    resample: bool = True,
) -> tuple[pd.DataFrame, pd.Series]:
    """Load recordings of a person who tracks a moving target with a cursor on a screen.

    Ten recordings of 60 to 80 s of pursuit tracking in two dimensions, with mouse or pen. The
    operator's output is the cursor itself.

    Parameters
    ----------
    recordings : "all", str, int, or list of these, default="all"
        Run labels, or their positions in this list: 0 ``"difficulty 50"``, 1 ``"difficulty 80"``
        (pseudo-random targets, 60 s); 2 ``"phase-size 1"``, 3 ``"phase-size 2a"``, 4 to 7
        ``"phase-size 2b"`` to ``"phase-size 2e"``, 8 ``"phase-size 3a"``, 9 ``"phase-size 3b"``
        (targets on an orbit whose size and phase are disturbed, 80 s). 2b to 2e show the same
        target, and so do 3a and 3b: repeats, for a noise ceiling.
    axis : {"x", "y"}, default="x"
        Horizontal or vertical, pixels from the upper left corner of the screen.
    channels : str or list of str, default=("f_t",)
        Columns of `X`: ``"f_t"`` target (px), ``"e"`` target minus cursor (px) and, for the
        phase-size recordings only, ``"size_s"`` (px) and ``"phase_f"`` (between -1 and 1), the
        disturbances of size and phase.
    resample : bool, default=True
        Interpolate onto a regular grid of 60 Hz (:func:`skhoid.resample_runs`). The recorded clock
        is that of the screen: 16.67 ms, with late frames of up to 19.1 ms. False gives the rows as
        recorded.

    Returns
    -------
    X : DataFrame of shape (n_rows, n_channels)
        Row index levels ``run`` (the labels above) and ``time`` (s, from 0 in each run); units in
        ``X.attrs["units"]``.
    y : Series of shape (n_rows,)
        Position of the cursor on the axis, px. Its name is ``"x"``, the role of the controlled
        element's output, for either axis.

    Notes
    -----
    The first 10 frames of every recording, whose cursor or clock is not valid, are left out. The
    cursor is stored exactly (whole px), the time to 0.1 us, the other channels in single precision
    (6e-5 px). Above about 1 Hz people predict periodic targets, and do not control the position
    error.

    Source: A. Matic (2022), "Visuomotor phase-locked loop", bioRxiv 2022.07.20.500761;
    https://github.com/adam-matic/visuomotor-phase-locked-loop. MIT licence, Copyright (c) 2022
    adam-matic, included in the package as ``skhoid/io/data/LICENSE-human-tracking.txt``.

    Examples
    --------
    >>> from skhoid.io import load_human_tracking
    >>> X, y = load_human_tracking(["difficulty 50", "difficulty 80"])
    >>> X.columns.to_list(), y.name, X.attrs["units"]
    (['f_t'], 'x', {'f_t': 'px'})
    >>> X.groupby(level="run").size().to_list()
    [3606, 3609]
    >>> X, y = load_human_tracking(4, axis="y", channels=["f_t", "size_s"], resample=False)
    >>> len(X)
    4789
    """
    labels = _selected(recordings)
    names = _known_names(channels, [name for name in _TRACKING_UNITS if name != "x"], "channels")
    with _open_data("human_tracking.npz") as data:
        pieces = [_tracking_run(data, label, axis, names) for label in labels]
    frame = pd.concat(pieces, keys=labels, names=["run", "time"])
    X, y = frame[names], frame["x"]
    if resample:
        X, y = resample_runs(X, y, dt=1 / _FRAME_RATE)
    return _with_units(X, y, _TRACKING_UNITS)


@checked(inputs=[str, "array-like"], output=[str], correct_units=["boolean"])
def load_bicycle_rider(
    *,
    inputs: str | Sequence[str] = ("RollAngle",),
    output: str = "SteerAngle",
    correct_units: bool = True,
) -> tuple[pd.DataFrame, pd.Series]:
    """Load a run of a rider who balances a bicycle while being pulled sideways.

    60 s at 200 Hz on a treadmill at 3.2 m/s, with eight lateral pulls of up to 272 N. The plant
    is unstable and the loop is closed; the rider feeds back the roll angle and its rate (motion)
    and the steer angle and torque (proprioception).

    Parameters
    ----------
    inputs : str or list of str, default=("RollAngle",)
        Columns of `X`. The channels are ``SteerAngle``, ``RollAngle`` (rad), ``SteerRate``,
        ``RollRate``, ``YawRate``, ``PitchRate``, ``RearWheelRate`` (rad/s), ``ForwardSpeed``
        (m/s), ``SteerTorque`` (N m), ``PullForce`` (N, pulls are negative), ``PushButton``,
        ``FiveVolts`` and ``ThreeVolts`` (V).
    output : str, default="SteerAngle"
        The rider's output, ``SteerAngle`` or ``SteerTorque``; any channel is allowed.
    correct_units : bool, default=True
        Multiply ``RollRate``, ``YawRate`` and ``PitchRate`` by 180/pi. In the original they were
        converted from degrees to radians twice and are too small by that factor; False leaves them
        so.

    Returns
    -------
    X : DataFrame of shape (11938, n_inputs)
        Row index levels ``run`` (``"00105"``) and ``time`` (s); units in ``X.attrs["units"]``.
    y : Series of shape (11938,)
        The output.

    Notes
    -----
    ``SteerRate`` has 17 missing values (NaN). Values are stored in single precision (relative
    error below 6e-8).

    Source: P.D.L. de Lange, J.K. Moore, "Bicycle Rider Control Identification", figshare,
    doi:10.6084/m9.figshare.659465, run 00105, licence CC-BY 3.0; see
    ``skhoid/io/data/LICENSE-bicycle-rider.txt``. Described in A.L. Schwab, P.D.L. de Lange,
    R. Happee and J.K. Moore, "Rider control identification in bicycling using lateral force
    perturbation tests", Multibody System Dynamics, 2013.

    Examples
    --------
    >>> from skhoid.io import load_bicycle_rider
    >>> X, y = load_bicycle_rider(inputs=["RollAngle", "RollRate"])
    >>> X.shape, y.name, X.attrs["units"]
    ((11938, 2), 'SteerAngle', {'RollAngle': 'rad', 'RollRate': 'rad/s'})
    """
    names = _known_names(inputs, list(_BICYCLE_UNITS), "inputs")
    (target,) = _known_names(output, list(_BICYCLE_UNITS), "output")
    with _open_data("bicycle_rider.npz") as data:
        columns = {name: data[name].astype(np.float64) for name in {*names, target}}
    if correct_units:
        for name in columns.keys() & set(_CONVERTED_TWICE):
            columns[name] = np.rad2deg(columns[name])
    time = np.arange(columns[target].size) / _BICYCLE_RATE
    index = pd.MultiIndex.from_product([["00105"], time], names=["run", "time"])
    X = pd.DataFrame({name: columns[name] for name in names}, index=index)
    y = pd.Series(columns[target], index=index, name=target)
    return _with_units(X, y, _BICYCLE_UNITS)


@contextmanager
def _open_data(name: str) -> Iterator[np.lib.npyio.NpzFile]:
    # The package may be imported from a zip archive, so the file is opened through its loader.
    with (
        resources.files("skhoid.io").joinpath("data", name).open("rb") as file,
        np.load(file) as data,
    ):
        yield data


def _selected(recordings: str | int | Iterable[str | int]) -> list[str]:
    known = list(_RECORDINGS)
    if isinstance(recordings, str) and recordings == "all":
        return known
    asked = [recordings] if isinstance(recordings, str | int | np.integer) else list(recordings)
    labels = []
    for item in asked:
        if isinstance(item, str) and item in _RECORDINGS:
            labels.append(item)
        elif isinstance(item, int | np.integer) and 0 <= item < len(known):
            labels.append(known[item])
        else:
            raise ValueError(
                f"There is no recording {item!r}: give 'all', positions 0 to {len(known) - 1}, "
                f"or labels from {known}."
            )
    if not labels or len(set(labels)) < len(labels):
        raise ValueError(f"recordings must name each recording once, at least one; got {asked}.")
    return labels


def _known_names(asked: str | Sequence[str], known: list[str], argument: str) -> list[str]:
    names = [asked] if isinstance(asked, str) else list(asked)
    wrong = [name for name in names if not isinstance(name, str) or name not in known]
    if wrong:
        raise ValueError(f"{argument} has {wrong[0]!r}; the channels are {', '.join(known)}.")
    if not names or len(set(names)) < len(names):
        raise ValueError(f"{argument} must name each channel once, at least one; got {names}.")
    return names


def _tracking_run(
    data: np.lib.npyio.NpzFile, label: str, axis: str, names: list[str]
) -> pd.DataFrame:
    target = _RECORDINGS[label]
    disturbances = {"size_s", "phase_f"}.intersection(names)
    if disturbances and f"{target}/size_s" not in data:
        raise ValueError(
            f"The recording {label!r} has no {' and '.join(sorted(disturbances))}, which only "
            "the phase-size recordings have: name those in recordings."
        )
    cursor = data[f"{label}/cursor_{axis}"].astype(np.float64)
    columns = {"x": cursor, "f_t": data[f"{target}/target_{axis}"].astype(np.float64)}
    columns["e"] = columns["f_t"] - cursor
    columns |= {name: data[f"{target}/{name}"].astype(np.float64) for name in disturbances}
    ticks = np.cumsum(data[f"{label}/ticks"], dtype=np.int64)[_INVALID_FRAMES:]
    time = (ticks - ticks[0]) / _TICKS_PER_SECOND
    frame = pd.DataFrame(columns).iloc[_INVALID_FRAMES:].set_axis(time)
    return frame[["x", *names]]


def _with_units(
    X: pd.DataFrame, y: pd.Series, units: dict[str, str]
) -> tuple[pd.DataFrame, pd.Series]:
    X.attrs["units"] = {name: units[name] for name in X.columns}
    y.attrs["units"] = {str(y.name): units[str(y.name)]}
    return X, y
