"""One simulated record as twelve labs would write it, and each of these files broken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.io import savemat

from skhoid import make_tracking_runs
from skhoid.effects import Bias


def record(n_runs: int = 3, duration: float = 20.48) -> pd.DataFrame:
    """Runs of a person with an offset: run, t (s), e, x, f_t, u (deg)."""
    X, y = make_tracking_runs(
        "C1",
        n_runs=n_runs,
        duration=duration,
        sampling_rate=50,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.05,
        random_state=1,
        effects=Bias(level=0.1),
    )
    frame = X.assign(u=y).reset_index().rename(columns={"time": "t"})
    return frame.assign(run=frame["run"].astype(int) + 1, n=np.arange(len(frame)))


Make = Callable[[pd.DataFrame], Any]


@dataclass(frozen=True)
class Lab:
    """Headers of a file, and how their values are made of a record."""

    name: str
    ending: str
    columns: dict[str, str | Make]
    roles: dict[str, str]  # what the guess must say of the columns that matter
    form: dict[str, Any] = field(default_factory=dict)

    def frame(self, r: pd.DataFrame) -> pd.DataFrame:
        """The columns of the file."""
        made = {
            header: r[what] if isinstance(what, str) else what(r)
            for header, what in self.columns.items()
        }
        return pd.DataFrame({header: np.asarray(values) for header, values in made.items()})

    def write(self, frame: pd.DataFrame, folder: Path, stem: str = "") -> Path:
        """Write the columns as the lab does."""
        path = folder / f"{stem or self.name}{self.ending}"
        if self.ending == ".parquet":
            frame.to_parquet(path)
        elif self.ending == ".mat":
            vectors = {header: frame[header].to_numpy() for header in frame}
            savemat(path, {self.form["struct"]: vectors} if self.form else vectors)
        else:
            frame.to_csv(path, index=False, **self.form)
        return path


def ms(r: pd.DataFrame) -> Any:
    return (1000 * r["t"]).round().astype(int)


def rounded(column: str, digits: int = 4, scale: float = 1.0) -> Make:
    return lambda r: (scale * r[column]).round(digits)


def since_start(r: pd.DataFrame) -> Any:
    """A clock that goes on from run to run."""
    return (1700.0 + r["n"] / 50 + 5.0 * r["run"]).round(4)


def text(prefix: str) -> Make:
    return lambda r: prefix + r["run"].astype(str)


SEMICOLON = {"sep": ";", "decimal": ","}
LABS = [
    Lab(
        "plain",
        ".csv",
        {"time": "t", "run": "run", "e": "e", "u": "u", "x": "x", "f_t": "f_t"},
        {"time": "time", "run": "run", "e": "e", "u": "u", "x": "x", "f_t": "f_t"},
    ),
    Lab(
        "units",
        ".csv",
        {
            "Time [ms]": ms,
            "Trial": "run",
            "Target (deg)": rounded("f_t"),
            "Position (deg)": rounded("x"),
            "Tracking error (deg)": rounded("e"),
            "Stick (deg)": rounded("u"),
        },
        {"time": "Time [ms]", "run": "Trial", "e": "Tracking error (deg)", "u": "Stick (deg)"},
    ),
    Lab(
        "suffixes",
        ".csv",
        {
            "participant_id": lambda r: np.full(len(r), "P07"),
            "trial_no": "run",
            "time_s": "t",
            "err_deg": "e",
            "stick_deg": "u",
            "attitude_deg": "x",
            "reference_deg": "f_t",
        },
        {"time": "time_s", "run": "trial_no", "e": "err_deg", "u": "stick_deg"},
    ),
    Lab(
        "german",
        ".csv",
        {
            "Zeit (s)": "t",
            "Versuch": "run",
            "Sollwert (Grad)": "f_t",
            "Istwert (Grad)": "x",
            "Regelabweichung": "e",
            "Stellgröße": "u",
        },
        {"time": "Zeit (s)", "run": "Versuch", "e": "Regelabweichung", "u": "Stellgröße"},
        SEMICOLON,
    ),
    Lab(
        "camel",
        ".tsv",
        {
            "elapsedTime": "t",
            "trialNumber": "run",
            "trackingError": "e",
            "controlInput": "u",
            "plantOutput": "x",
            "forcingFunction": "f_t",
        },
        {"time": "elapsedTime", "run": "trialNumber", "e": "trackingError", "u": "controlInput"},
        {"sep": "\t"},
    ),
    Lab(
        "no-error",
        ".csv",
        {
            "": "n",
            "timestamp": since_start,
            "run": "run",
            "condition": lambda r: np.full(len(r), "C1"),
            "target": "f_t",
            "cursor": "x",
            "joystick": "u",
            "score": lambda r: np.round(np.abs(r["e"]), 1),
        },
        {"time": "timestamp", "run": "run", "u": "joystick", "f_t": "target", "x": "cursor"},
    ),
    Lab(
        "struct",
        ".mat",
        {"t": "t", "e": "e", "u": "u", "y": "x", "ref": "f_t", "rep": "run"},
        {"time": "data.t", "run": "data.rep", "e": "data.e", "u": "data.u"},
        {"struct": "data"},
    ),
    Lab(
        "frame",
        ".parquet",
        {
            "subject": lambda r: np.full(len(r), 3),
            "session": lambda r: np.full(len(r), 1),
            "rep": "run",
            "t": "t",
            "error": "e",
            "command": "u",
            "output": "x",
            "input": "f_t",
        },
        {"time": "t", "run": "rep", "e": "error", "u": "command", "x": "output", "f_t": "input"},
    ),
    Lab(
        "restarts",
        ".csv",
        {"TIME": "t", "ERROR": "e", "CONTROL": "u", "SETPOINT": "f_t", "STATE": "x"},
        {"time": "TIME", "e": "ERROR", "u": "CONTROL", "f_t": "SETPOINT", "x": "STATE"},
    ),
    Lab(
        "turned",
        ".csv",
        {
            "t_ms": ms,
            "RunID": text("r"),
            "f_t [rad]": rounded("f_t", 6, np.pi / 180),
            "x [rad]": rounded("x", 6, np.pi / 180),
            "e [rad]": rounded("e", 6, -np.pi / 180),
            "u [rad]": rounded("u", 6, np.pi / 180),
        },
        {"time": "t_ms", "run": "RunID", "e": "e [rad]", "u": "u [rad]"},
    ),
    Lab(
        "french",
        ".txt",
        {
            "Temps (s)": "t",
            "Essai": "run",
            "Consigne": "f_t",
            "Sortie": "x",
            "Écart": "e",
            "Manche": "u",
        },
        {"time": "Temps (s)", "run": "Essai", "e": "Écart", "u": "Manche"},
        {"sep": ";", "decimal": ",", "encoding": "cp1252"},
    ),
    Lab(
        "simulator",
        ".csv",
        {
            "sample": "n",
            "Time": "t",
            "Block": lambda r: np.ones(len(r), int),
            "Trial No.": "run",
            "pitch_cmd": "f_t",
            "pitch": "x",
            "pitch_error": "e",
            "sidestick_pitch": "u",
            "sidestick_pitch_rate": lambda r: np.gradient(r["u"]).round(5),
            "heart_rate": lambda r: 70 + (r["n"] // 500) % 7,
        },
        {"time": "Time", "run": "Trial No.", "e": "pitch_error", "u": "sidestick_pitch"},
    ),
]
BY_NAME = {lab.name: lab for lab in LABS}


def backwards(column: str, row: int = 40) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """Time that runs backwards within a run."""

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        values = frame[column].to_numpy().copy()
        values[row] = values[row - 7]
        return frame.assign(**{column: values})

    return change


def words_in(column: str, row: int = 11) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """Text in a column of numbers."""

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        values = frame[column].astype(object).to_numpy().copy()
        values[row] = "lost"
        return frame.assign(**{column: values})

    return change


def constant(column: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """A signal that never changes."""
    return lambda frame: frame.assign(**{column: 0.25})


def without(*columns: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """Columns that are not there."""
    return lambda frame: frame.drop(columns=list(columns))


def twice(column: str, name: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """A second column that may be the same signal."""
    return lambda frame: frame.assign(**{name: np.roll(frame[column].to_numpy(), 9)})


def again(column: str, row: int = 3000) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """A run that comes back after another."""

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        values = frame[column].to_numpy().copy()
        values[row] = values[0]
        return frame.assign(**{column: values})

    return change


# What is done to each file, and what its one message must say.
BROKEN: dict[str, tuple[list[Callable[[pd.DataFrame], pd.DataFrame]], list[str]]] = {
    "plain": (
        [without("u"), backwards("time")],
        ["the output u", "'time'|\"time\" runs backwards"],
    ),
    "units": (
        [constant("Tracking error (deg)"), words_in("Stick (deg)")],
        ["Tracking error .* 0.25 in every row", "Stick .* row 12 .* 'lost'"],
    ),
    "suffixes": (
        [twice("stick_deg", "wheel_deg"), backwards("time_s"), words_in("err_deg")],
        ["stick_deg.*wheel_deg", "time_s.* runs backwards", "err_deg.*lost"],
    ),
    "german": (
        [without("Zeit (s)"), constant("Stellgröße")],
        ["the time", "Stellgröße.*0.25 in every row"],
    ),
    "camel": (
        [without("trackingError", "forcingFunction"), words_in("plantOutput")],
        ["error e", "plantOutput.*lost"],
    ),
    "no-error": (
        [without("joystick", "score"), backwards("timestamp", 45)],
        ["output u", "timestamp.* runs backwards"],
    ),
    "struct": (
        [without("u"), backwards("t"), constant("e")],
        ["output u", "backwards", "every row"],
    ),
    "frame": (
        [twice("command", "stick"), backwards("t"), again("rep")],
        ['"command".*"stick"|"stick".*"command"', "backwards", "do not lie together"],
    ),
    "restarts": (
        [backwards("TIME"), constant("CONTROL")],
        ["TIME.*backwards", "CONTROL.*every row"],
    ),
    "turned": (
        [words_in("e [rad]"), words_in("u [rad]", 20), backwards("t_ms")],
        ["e \\[rad\\].*row 12.*lost", "u \\[rad\\].*row 21.*lost", "t_ms.*backwards"],
    ),
    "french": (
        [constant("Écart"), without("Manche")],
        ["Écart.*every row", "output u"],
    ),
    "simulator": (
        [without("Time"), twice("sidestick_pitch", "throttle"), again("Trial No.")],
        ["the time", "sidestick_pitch.*throttle", "do not lie together"],
    ),
}


def broken(name: str, frame: pd.DataFrame) -> pd.DataFrame:
    """The columns of a lab's file with all that is wrong in its twin."""
    for change in BROKEN[name][0]:
        frame = change(frame)
    return frame
