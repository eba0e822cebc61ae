"""Parameters of several people over time, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd

from ..interpret.conversion import UNITS
from ._axes import limits_of, note_outside, parameter_symbol, with_unit
from ._display import Display
from ._estimates import MARGIN, MUCH, typical_range
from ._layout import page_width
from ._roles import GREY, ORANGE, PALETTE, foreground, scaled
from .operator_parameters import SYMBOLS

if TYPE_CHECKING:
    from ..lab.experiment.result import ExperimentResult

PARAMETERS = {
    "arx": ("a1", "a2", "b0", "b1"),
    "operator": ("K_e", "T_L", "K_edot", "omega_nm", "zeta_nm"),
}
FORMS = {
    "lambda": "λ, $N_0$ = {N0}",
    "Lambda": "Λ, $N_0$ = ∞ for $a_1$ and $a_2$, {N0} for $b_0$ and $b_1$",
}
RUN_COLOURS = [colour for colour in PALETTE if colour not in (ORANGE, GREY)]
MOST_NAMED = 7  # runs with an entry of their own in the legend
MEAN = "mean"


@dataclass(kw_only=True, eq=False, repr=False)
class ExperimentDisplay(Display):
    """Parameters over time of each subject in a condition (Figs. 16, 17, M.1-M.6).

    A column for each subject and a row for each parameter. Single runs are thin and coloured,
    their mean has the colour of text, the means of batch models of the first and the last region
    are thick and orange, and the change of the controlled element is grey.

    The subjects share the limits of a row. These hold the batch models, the mean paths and the
    single runs but for their outer 2 % at each end, where all of them would take twice the range;
    a note counts the values outside: T_L = K_edot / K_e has no bounds where K_e comes near zero.

    Make it with :meth:`from_result`, or with the method ``plot`` of the result.

    Parameters
    ----------
    paths : DataFrame
        Columns ``subject``, ``run`` (or ``"mean"``), ``time`` (s) and the parameters, of one
        condition and one form of forgetting.
    batch : DataFrame
        Columns ``subject``, ``form``, ``start`` and ``stop`` (s), and the parameters.
    names : sequence of str
        The parameters.
    title : str, default=""
        Title of the figure.
    transition_time : float or None, default=None
        Instant to mark, in s.

    Attributes
    ----------
    ax_ : ndarray of Axes, shape (n_parameters, n_subjects)
        The panels.
    figure_ : Figure
        The figure that holds them.
    subjects_ : list
        The subject of each column.
    names_ : list of str
        The parameter of each row.
    lines_ : dict of Line2D
        Means by (subject, parameter).
    run_lines_ : dict of dict of Line2D
        Single runs by (subject, parameter), and by run.
    batch_ : dict of Line2D
        Batch models by (subject, parameter, form).
    notes_ : dict of Text
        Counts of values outside the panel, by (subject, parameter).

    Examples
    --------
    >>> from skhoid.lab.experiment import analyse_experiment, simulate_experiment
    >>> from skhoid.plotting.experiment import ExperimentDisplay
    >>> result = analyse_experiment(*simulate_experiment(2, "C4", random_state=0))
    >>> display = ExperimentDisplay.from_result(result, form="Lambda")
    >>> display.subjects_, display.names_
    (['S1', 'S2'], ['a1', 'a2', 'b0', 'b1'])
    """

    paths: pd.DataFrame
    batch: pd.DataFrame
    names: Any
    title: str = ""
    transition_time: float | None = None

    @classmethod
    def from_result(
        cls,
        result: ExperimentResult,
        condition: Any = None,
        *,
        form: str = "lambda",
        parameters: str = "arx",
        subjects: Any = None,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw what :func:`skhoid.lab.experiment.analyse_experiment` found.

        Parameters
        ----------
        result : ExperimentResult
            Of the analysis.
        condition : label or None, default=None
            Condition; None is the only one.
        form : {"lambda", "Lambda"}, default="lambda"
            Forgetting.
        parameters : {"arx", "operator"}, default="arx"
            a1, a2, b0, b1, or K_e, T_L, K_edot, omega_nm, zeta_nm.
        subjects : sequence of labels or None, default=None
            None means all that have runs in this condition.
        ax : sequence of Axes or None, default=None
            Where to draw, see :meth:`plot`.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : ExperimentDisplay

        Raises
        ------
        ValueError
            If there is no such condition, form, subject or set of parameters.
        """
        for what, given, known in (
            ("form", form, FORMS),
            ("parameters", parameters, PARAMETERS),
        ):
            if given not in known:
                raise ValueError(f"{what} is {' or '.join(map(repr, known))}; got {given!r}.")
        conditions = result.conditions
        if condition is None and len(conditions) == 1:
            condition = conditions[0]
        if condition not in conditions:
            raise ValueError(
                f"condition is one of {', '.join(map(str, conditions))}; got {condition!r}."
            )
        paths, batch = (t[t["condition"] == condition] for t in (result.paths, result.batch))
        paths, batch = paths[paths["form"] == form], batch[batch["run"] == MEAN]
        if subjects is not None:
            wanted = [subjects] if isinstance(subjects, str) else list(subjects)
            there = list(dict.fromkeys(paths["subject"]))
            unknown = [subject for subject in wanted if subject not in there]
            if unknown or not wanted:
                raise ValueError(
                    f"subjects are some of {', '.join(map(str, there))}, which have runs in "
                    f"{condition}; got {subjects!r}."
                )
            paths = pd.concat([paths[paths["subject"] == subject] for subject in wanted])
        forgetting = FORMS[form].format(N0=f"{result.memory_horizon:g}")
        display = cls(
            paths=paths,
            batch=batch,
            names=PARAMETERS[parameters],
            title=forgetting if condition == "all" else f"{condition}: {forgetting}",
            transition_time=result.transition_times.get(condition),
        )
        return display.plot(ax, **styles)

    def plot(
        self,
        ax: Any = None,
        *,
        mean_kw: dict[str, Any] | None = None,
        runs_kw: dict[str, Any] | None = None,
        batch_kw: dict[str, Any] | None = None,
    ) -> Self:
        """Draw.

        Parameters
        ----------
        ax : sequence of Axes or None, default=None
            One for each parameter and subject, row by row. None makes a figure.
        mean_kw : dict or None, default=None
            Keywords of matplotlib for the means of the runs.
        runs_kw : dict or None, default=None
            Keywords of matplotlib for the single runs.
        batch_kw : dict or None, default=None
            Keywords of matplotlib for the batch models.

        Returns
        -------
        self : ExperimentDisplay
        """
        styles = {"mean": mean_kw, "runs": runs_kw, "batch": batch_kw}
        self.names_ = list(self.names)
        self.subjects_ = list(dict.fromkeys(self.paths["subject"]))
        self._begin(ax)
        self.lines_: dict[tuple[Any, str], Any] = {}
        self.run_lines_: dict[tuple[Any, str], dict[Any, Any]] = {}
        self.batch_: dict[tuple[Any, str, str], Any] = {}
        self.notes_: dict[tuple[Any, str], Any] = {}
        runs = [run for run in dict.fromkeys(self.paths["run"]) if run != MEAN]
        colours = {run: RUN_COLOURS[i % len(RUN_COLOURS)] for i, run in enumerate(runs)}
        for row, name in enumerate(self.names_):
            for column, subject in enumerate(self.subjects_):
                self._draw(self.ax_[row, column], subject, name, colours)
            limits = self._limits(name)
            for column, subject in enumerate(self.subjects_):
                panel = self.ax_[row, column]
                panel.set_ylim(limits)
                drawn = [line.get_ydata() for line in self.run_lines_[subject, name].values()]
                drawn = [*drawn, self.lines_[subject, name].get_ydata()]
                if note := note_outside(panel, np.concatenate(drawn), ("top", "right")):
                    self.notes_[subject, name] = note
            symbol = SYMBOLS.get(name, parameter_symbol(name))
            self.ax_[row, 0].set_ylabel(with_unit(symbol, UNITS.get(name)), fontsize="large")
        for column, subject in enumerate(self.subjects_):
            if len(self.subjects_) > 1 or subject != "all":
                self.ax_[0, column].set_title(str(subject))
            self.ax_[-1, column].set_xlabel("time, s")
        self._restyle(styles, mean=self.lines_, runs=self.run_lines_, batch=self.batch_)
        self._legend_of_panels()
        return self

    def _begin(self, ax: Any) -> None:
        shape = len(self.names_), len(self.subjects_)
        self.ax_ = self._take_axes(
            ax,
            f"{shape[0]} parameters of {shape[1]} subjects, row by row",
            shape,
            figsize=(page_width(max(6.4, 1.0 + 3.0 * shape[1]), shape[1]), 1.6 + 1.6 * shape[0]),
            sharex=True,
            sharey="row",
        ).reshape(shape)
        if self._own:
            if self.title:
                self.figure_.suptitle(self.title)
            self.figure_.align_ylabels(self.ax_[:, 0])
        times = self.paths["time"]
        for panel in self.ax_.flat:
            panel.grid(alpha=0.3)
            if times.min() < times.max():
                panel.set_xlim(times.min(), times.max())

    def _draw(self, panel: Any, subject: Any, name: str, colours: dict[Any, str]) -> None:
        here = self.paths[self.paths["subject"] == subject]
        lines = self.run_lines_.setdefault((subject, name), {})
        named = len(colours) <= MOST_NAMED
        for run, table in here.groupby("run", sort=False):
            if run == MEAN:
                (self.lines_[subject, name],) = panel.plot(
                    table["time"],
                    table[name],
                    color=foreground(),
                    lw=scaled(1.8),
                    zorder=2.4,
                    label="mean of the runs",
                )
            else:
                (lines[run],) = panel.plot(
                    table["time"],
                    table[name],
                    color=colours[run],
                    lw=scaled(0.6),
                    alpha=0.8,
                    zorder=1.8,
                    label=f"run {run}" if named else "single runs",
                )
        batch = self.batch[self.batch["subject"] == subject]
        for level in batch.to_dict("records"):
            if np.isfinite(level[name]):
                (self.batch_[subject, name, level["form"]],) = panel.plot(
                    [level["start"], level["stop"]],
                    [level[name]] * 2,
                    color=ORANGE,
                    lw=scaled(3.0),
                    alpha=0.9,
                    solid_capstyle="butt",
                    zorder=2.2,
                    label="batch, first and last part",
                )
        if self.transition_time is not None:
            panel.axvline(
                self.transition_time,
                color=GREY,
                lw=scaled(1.5),
                zorder=1.5,
                label="$t_M$, the change",
            )

    def _limits(self, name: str) -> tuple[float, float]:
        """Limits that all subjects share; outer estimates only where they take little room."""
        values = self.paths[name].to_numpy(dtype=float)
        values = values[np.isfinite(values)]
        levels = self.batch.loc[self.batch["subject"].isin(self.subjects_), name]
        known = levels[np.isfinite(levels)].to_numpy(dtype=float)
        if values.size + known.size == 0:
            return 0.0, 1.0
        inner = np.append(typical_range(values) if values.size else values, known)
        return limits_of(inner, np.append(values, known), MUCH, MARGIN)
