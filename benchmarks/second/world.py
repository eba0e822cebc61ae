"""A world: one element, one person and all runs with what reaches them from outside; simulated,
answered, recorded.

Open it to see how a case is put together before an effect is hidden in it (``forms_*.py``) and how
it becomes the table (X, y) that the search is given.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from . import loop, signals
from .elements import Element
from .person import Person

DT = 1.0 / loop.RATE
TAIL = 2.0  # seconds simulated beyond the record, so that who looks ahead has something to see


@dataclass
class Run:
    """What comes from outside, at 600 Hz: arrays of one length; ``skip`` samples of run-in and
    ``keep`` recorded ones.
    """

    f: np.ndarray
    d: np.ndarray
    noise_before: np.ndarray
    noise_after: np.ndarray
    skip: int
    keep: int
    start: np.ndarray
    seen: np.ndarray = field(default_factory=lambda: np.zeros(0))
    before: np.ndarray = field(default_factory=lambda: np.zeros(0))
    after: np.ndarray = field(default_factory=lambda: np.zeros(0))
    tau: np.ndarray = field(default_factory=lambda: np.zeros(0))
    g_error: np.ndarray = field(default_factory=lambda: np.zeros(0))
    g_all: np.ndarray = field(default_factory=lambda: np.zeros(0))
    awake: np.ndarray = field(default_factory=lambda: np.zeros(0))
    channels: dict[str, np.ndarray] = field(default_factory=dict)

    def fresh(self, delay: float) -> "Run":
        """A copy with nothing hidden."""
        n = len(self.f)
        return Run(
            self.f,
            self.d,
            self.noise_before,
            self.noise_after,
            self.skip,
            self.keep,
            self.start,
            seen=self.f.copy(),
            before=np.zeros(n),
            after=np.zeros(n),
            tau=np.full(n, delay),
            g_error=np.ones(n),
            g_all=np.ones(n),
            awake=np.ones(n),
            channels=dict(self.channels),
        )

    @property
    def time(self) -> np.ndarray:
        """Seconds since the record began (negative in the run-in)."""
        return (np.arange(len(self.f)) - self.skip) * DT


@dataclass
class World:
    """Element, person, runs (the last ``n_fresh`` are kept from the search) and what is hidden."""

    element: Element
    person: Person
    runs: list[Run]
    n_fresh: int
    rate: int
    display: str
    dist_recorded: bool
    motion: str = ""  # name of the recorded motion channel, if any
    bits: int = 12
    pars: np.ndarray = field(default_factory=lambda: np.zeros(1, loop.PERSON))
    shape: np.ndarray = field(default_factory=lambda: np.array([1.0, 0, 0, 1.0, 0, 0]))
    scale: dict[str, float] = field(default_factory=dict)
    sensor_abs: bool = False
    ahead: int = (
        0  # steps by which x and f are recorded later than u, as a loop clocked with u does
    )

    @property
    def delay(self) -> float:
        """The effective delay (s) from e to u as they are recorded."""
        return self.person.delay + self.ahead * DT

    def clean(self) -> "World":
        """A copy in which the person is linear and nothing is hidden."""
        p = self.person
        pars = np.zeros(1, loop.PERSON)
        for name, value in (
            ("gain", p.gain),
            ("lead", p.lead),
            ("omega", p.omega),
            ("zeta", p.zeta),
        ):
            pars[name] = value
        return World(
            self.element,
            p,
            [r.fresh(p.delay) for r in self.runs],
            self.n_fresh,
            self.rate,
            self.display,
            self.dist_recorded,
            self.motion,
            self.bits,
            pars,
            np.array([1.0, 0, 0, 1.0, 0, 0]),
            dict(self.scale),
        )

    def put(self, **values: Any) -> None:
        """Set parameters of the person by name."""
        for name, value in values.items():
            self.pars[name] = value

    def simulate(
        self, remnant: float = 1.0, target: float = 1.0, disturbance: float = 1.0
    ) -> list[np.ndarray]:
        """Closed loop of every run, (n, 6) each: x, e, u, limb, x', command; factors scale what
        comes in.
        """
        return [self._one(r, remnant, target, disturbance, None) for r in self.runs]

    def answer(self, closed: list[np.ndarray]) -> list[np.ndarray]:
        """The person's reply without remnant to the x of closed runs: u of every run, (n,) each."""
        return [
            self._one(r, 0.0, 1.0, 1.0, c[:, 0])[:, 2]
            for r, c in zip(self.runs, closed, strict=True)
        ]

    def _one(
        self, r: Run, remnant: float, target: float, disturbance: float, x: np.ndarray | None
    ) -> np.ndarray:
        plant, column = self.element.discrete(DT)
        outside = np.stack(
            [
                *(r.f * target, r.seen * target, r.d * disturbance),
                *(r.before + remnant * r.noise_before, r.after + remnant * r.noise_after),
                *(r.tau, r.g_error, r.g_all, r.awake),
            ]
        )
        given = np.ascontiguousarray(r.f if x is None else x)
        start = r.start * target
        return loop.simulate(
            self.pars, start, plant, column, self.shape, outside, given, x is not None
        )

    @property
    def step(self) -> int:
        """Simulated samples per recorded one."""
        return int(loop.RATE) // self.rate

    def cut(self, run: Run, values: np.ndarray) -> np.ndarray:
        """What the recorder keeps of a signal at 600 Hz."""
        return values[run.skip : run.skip + run.keep : self.step]

    def shown(self, run: Run, values: np.ndarray) -> np.ndarray:
        """What the recorder keeps of x and f."""
        first = run.skip + self.ahead
        return values[first : first + run.keep : self.step]

    def table(self, closed: list[np.ndarray], which: range) -> tuple[pd.DataFrame, pd.Series]:
        """X and y of the runs ``which`` as a user has them; sensors of 10 to 12 bits."""
        frames = []
        for i in which:
            r, c = self.runs[i], closed[i]
            x, u = self.shown(r, c[:, 0]), self.cut(r, c[:, 2])
            f = self.shown(r, r.f)
            x, f = self._sense(x, "x"), self._sense(f, "x")
            data = {"e": f - x, "x": x, "f_t": f}
            if self.dist_recorded:
                data["dist"] = self.cut(r, r.d)
            if self.motion:
                data[self.motion] = self.cut(r, self.motion_signal(c))
            data |= {name: self.cut(r, v) for name, v in r.channels.items()}
            data["u"] = np.abs(self._sense(u, "u")) if self.sensor_abs else self._sense(u, "u")
            frame = pd.DataFrame(data)
            times = np.round(np.arange(len(frame)) / self.rate, 9)
            frame.index = pd.MultiIndex.from_arrays(
                [np.full(len(frame), i), times], names=["run", "time"]
            )
            frames.append(frame)
        whole = pd.concat(frames)
        return whole.drop(columns="u"), whole["u"]

    def motion_signal(self, closed: np.ndarray) -> np.ndarray:
        """x' or x'' of the element's output at 600 Hz."""
        return signals.rate(closed[:, 4], DT) if self.pars["motion"][0] == 2 else closed[:, 4]

    def _sense(self, values: np.ndarray, which: str) -> np.ndarray:
        least = 12.0 * self.scale[which] / 2**self.bits
        return np.round(values / least) * least

    def inverse(self, closed: list[np.ndarray], which: range) -> tuple[np.ndarray, np.ndarray]:
        """The plant's inverse of x, which is u + d, and d itself, at the recorded rate, runs one
        after another.
        """
        u = np.concatenate([self.cut(self.runs[i], closed[i][:, 2]) for i in which])
        d = np.concatenate([self.cut(self.runs[i], self.runs[i].d) for i in which])
        return u + d, d
