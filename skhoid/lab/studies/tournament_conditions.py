"""The cells of the tournament, and when their parameters change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ... import CompensatoryTask, ControlledElement, HumanOperator, Step, mixed_condition
from ...exceptions import did_you_mean
from ...simulation import T_M, Condition, change_times, task_of

INTENSITIES = (0.05, 0.15, 0.25)  # P_n
ORDERS = (1, 2, 3, 4)  # of the remnant filter
MIDDLE, ORDER = 0.15, 2  # of what does not vary in the other families
KINDS = ("constant", "changing")
SIZES = ("full", "small")
_CONDITIONS = {
    **dict.fromkeys(("C1", "C2"), "constant"),
    **dict.fromkeys(("C3", "C4", "C5", "C6"), "changing"),
}


@dataclass(frozen=True)
class Points:
    """A weight with given values (0 to 1) at instants (s), linear between them."""

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __call__(self, t: Any) -> np.ndarray:
        return np.interp(np.asarray(t, dtype=float), self.times, self.values)

    @property
    def changes(self) -> tuple[float, float]:
        """Times in s before and after which nothing changes."""
        return self.times[0], self.times[-1]


@dataclass(frozen=True)
class TournamentCell:
    """One condition of the tournament.

    Parameters
    ----------
    name : str
        Different in each cell.
    condition : str, Condition or CompensatoryTask
        What is controlled, and by whom.
    remnant_intensity : float or None, default=0.15
        P_n; None leaves the task's own remnant.
    remnant_order : {1, 2, 3, 4, "nm"}, default=2
        Order of the remnant filter.
    sampling_rate : float, default=100.0
        In Hz; a whole task has its own.
    kind : {"constant", "changing"}, default="changing"
        Whether anything changes: methods are tuned for each kind and intensity.
    family : str, default="condition"
        Heading under which results are shown.

    Examples
    --------
    >>> from skhoid.lab.studies import TournamentCell
    >>> cell = TournamentCell("C4 again", "C4", 0.25)
    >>> cell.group
    'changing, P_n = 0.25'
    >>> cell.task().n_samples
    8192
    """

    name: str
    condition: Any
    remnant_intensity: float | None = MIDDLE
    remnant_order: Any = ORDER
    sampling_rate: float = 100.0
    kind: str = "changing"
    family: str = "condition"

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"kind must be one of {list(KINDS)}; got {self.kind!r}.")

    @property
    def group(self) -> str:
        """What it is tuned with: cells that an experimenter cannot tell from it beforehand."""
        P_n = self.remnant_intensity
        return f"{self.kind}, " + ("own remnant" if P_n is None else f"P_n = {P_n:g}")

    def row(self) -> dict[str, Any]:
        """The cell as a row of conditions of a :class:`skhoid.MonteCarloStudy`.

        Returns
        -------
        row : dict
        """
        row: dict[str, Any] = {"cell": self.name, "condition": self.condition}
        if self.remnant_intensity is not None:
            row |= {
                "remnant_intensity": float(self.remnant_intensity),
                "remnant_order": self.remnant_order,
            }
        if not isinstance(self.condition, CompensatoryTask):
            row["sampling_rate"] = float(self.sampling_rate)
        return row

    def task(self) -> CompensatoryTask:
        """The task without remnant, to see what changes and when.

        Returns
        -------
        task : CompensatoryTask
        """
        if isinstance(self.condition, CompensatoryTask):
            return replace(self.condition, remnant=None)
        return task_of(self.condition, {"sampling_rate": self.sampling_rate})


def shapes() -> dict[str, Condition]:
    """Changes between C1 and C2 that no sigmoid has the form of, by name."""
    jump = 0.02  # s, two samples
    weights: dict[str, Any] = {
        "two changes": Points((32.0, 32.0 + jump, 54.0, 54.0 + jump), (0.0, 0.5, 0.5, 1.0)),
        "relapse": Points((32.0, 32.0 + jump, 54.0, 54.0 + jump), (0.0, 1.0, 1.0, 0.0)),
        "drift": Points((25.0, 65.0), (0.0, 1.0)),
        "jump": Step(0.0, 1.0, 50.0),
    }
    return {name: replace(mixed_condition("C1", "C2", w), name=name) for name, w in weights.items()}


def elements() -> dict[str, tuple[Condition, str]]:
    """Elements near the double integrator, and changes between them, with their kinds."""
    double = Condition(
        "K/s²", ControlledElement(K_c=20.0, omega_b=0.0), HumanOperator(K_e=0.07, T_L=1.4)
    )
    lagged = Condition(
        "K/(s(s+1))", ControlledElement(K_c=40.0, omega_b=1.0), HumanOperator(K_e=0.08, T_L=0.8)
    )
    half = Condition(
        "K/2 / s²", ControlledElement(K_c=10.0, omega_b=0.0), HumanOperator(K_e=0.14, T_L=1.4)
    )
    sudden = Step(0.0, 1.0, T_M)
    return {
        "K/s²": (double, "constant"),
        "K/(s(s+1))": (lagged, "constant"),
        "K/(s(s+1)) to K/s²": (mixed_condition(lagged, double, sudden), "changing"),
        "K/s², K halved": (mixed_condition(double, half, sudden), "changing"),
    }


def tournament_cells(
    size: str = "full",
    *,
    conditions: Sequence[str] | None = None,
    intensities: Sequence[float] | None = None,
    orders: Sequence[Any] | None = None,
) -> list[TournamentCell]:
    """Cells of the tournament.

    Parameters
    ----------
    size : {"full", "small"}, default="full"
        ``"full"`` has C1 to C6 with remnant of three intensities and four orders, four changes
        that no sigmoid has the form of, C1 to C6 at 50 Hz, and elements near K/s². ``"small"`` has
        C1 and C4 with one remnant.
    conditions, intensities, orders : sequence or None, default=None
        Only cells with these. ``conditions`` are C1 to C6, and the names of other cells' conditions
        such as ``"relapse"``. Intensities other than 0.05, 0.15 and 0.25 are possible for C1 to C6
        and changes.

    Returns
    -------
    cells : list of TournamentCell

    Raises
    ------
    ValueError
        If nothing is left, or a condition is not known.

    Examples
    --------
    >>> from skhoid.lab.studies import tournament_cells
    >>> len(tournament_cells())
    94
    >>> [cell.name for cell in tournament_cells("small")]
    ['C1, P_n 0.15', 'C4, P_n 0.15']
    """
    if size not in SIZES:
        raise ValueError(f"size must be one of {list(SIZES)}; got {size!r}.")
    small = size == "small"
    P_ns = [float(P) for P in (intensities or ((MIDDLE,) if small else INTENSITIES))]
    if min(P_ns) <= 0:
        raise ValueError(f"intensities must be above 0; got {min(P_ns):g}.")
    of_orders = [_whole(m) for m in (orders or ((ORDER,) if small else ORDERS))]
    own_order = ORDER if ORDER in of_orders else of_orders[0]
    middle = MIDDLE if MIDDLE in P_ns else P_ns[0]
    cells = []
    for name, kind in _CONDITIONS.items():
        for P in P_ns:
            for m in of_orders:
                text = f"{name}, P_n {P:g}" + (f", order {m}" if m != ORDER else "")
                cells.append(TournamentCell(text, name, P, m, kind=kind))
    for name, condition in shapes().items():
        for P in P_ns:
            text = f"{name}, P_n {P:g}"
            cells.append(TournamentCell(text, condition, P, own_order, family="shape"))
    last = f"P_n {middle:g}"
    for name, kind in _CONDITIONS.items():
        text = f"{name}, {last}, 50 Hz"
        cells.append(TournamentCell(text, name, middle, own_order, 50.0, kind, "50 Hz"))
    for name, (condition, kind) in elements().items():
        text = f"{name}, {last}"
        cells.append(
            TournamentCell(text, condition, middle, own_order, kind=kind, family="element")
        )
    known = list(dict.fromkeys(_condition_name(cell) for cell in cells))
    for name in conditions or ():
        if name not in known:
            raise ValueError(
                f"Unknown condition {name!r}; known are {', '.join(known)}."
                f"{did_you_mean(name, known)}"
            )
    if conditions is None and not small:
        return cells
    wanted = conditions or ("C1", "C4")
    return [
        cell
        for cell in cells
        if _condition_name(cell) in wanted and not (small and cell.family == "50 Hz")
    ]


def _condition_name(cell: TournamentCell) -> str:
    found = getattr(cell.condition, "name", cell.condition)
    return cell.name.partition(", P_n")[0] if cell.family == "element" else str(found)


def _whole(order: Any) -> Any:
    """An order of the remnant filter; a number may be given as text."""
    return int(order) if str(order).isdigit() else order


WINDOWS = ("all", "before", "around", "after")
START = 15 / 81.92  # of the duration, which is left to methods to begin
BASELINE = 30.72 / 81.92  # of the duration, by which the estimate before a change is known
HALF_WIDTH = 1 / 8  # of the duration, on either side of the middle of a change
MARGIN = 1 / 16  # of the duration, at least, from its ends


@dataclass(frozen=True)
class Change:
    """From when to when a run is judged (s), and when its task's parameters change.

    ``times`` are those when 5, 50 and 95 % of the way of all parameters have been gone; None if
    nothing changes.
    """

    start: float
    end: float
    times: tuple[float, float, float] | None

    @classmethod
    def of(cls, task: Any) -> Change:
        """Of a task."""
        return cls(START * task.duration, float(task.duration), change_times(task))

    @property
    def baseline(self) -> tuple[float, float]:
        """From when to when the level before a change is taken."""
        last = BASELINE * self.end
        if self.times is not None:
            last = min(last, self.times[0])
        return self.start, max(last, self.start)

    def windows(self, time: np.ndarray) -> dict[str, np.ndarray]:
        """Which instants lie in each window: all, and before, around and after a change.

        Around is an eighth of the duration on either side of the middle between 5 and 95 % of the
        change, or a sixteenth from these, whichever is longer.
        """
        judged = time >= self.start
        if self.times is None:
            return {"all": judged}
        early, _, late = self.times
        middle, taken = (early + late) / 2, (late - early) / 2
        half = max(HALF_WIDTH * self.end, taken + MARGIN * self.end)
        return {
            "all": judged,
            "before": judged & (time < middle - half),
            "around": judged & (time >= middle - half) & (time <= middle + half),
            "after": judged & (time > middle + half),
        }
