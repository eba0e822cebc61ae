"""Bias against standard deviation of the methods of a tournament."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pandas as pd
from matplotlib.ticker import MaxNLocator

from ._display import Display
from ._layout import page_width
from ._roles import GREY, scaled
from ._study import OPERATOR, check_table
from ._tournament import method_handles, method_style

if TYPE_CHECKING:
    from ..lab.studies import TournamentResult

NAME = "TournamentBiasDisplay"
COLUMNS = ("method", "parameter", "causal", "bias", "sd")
SHOWN = ("K_e", "K_edot", "omega_nm", "zeta_nm")
MOST_COLUMNS = 2
MARGIN = 1.12


@dataclass(kw_only=True, eq=False, repr=False)
class TournamentBiasDisplay(Display):
    """Bias against standard deviation of each method, a panel for each parameter.

    Arcs are lines of equal RMSE, sqrt(bias² + sd²). Marks of causal methods are filled.

    Make it with :meth:`from_result`.

    Parameters
    ----------
    points : DataFrame
        A row for each method and parameter: ``method``, ``parameter``, ``causal``, and size of the
        ``bias`` and ``sd`` in % of the truth.

    Attributes
    ----------
    axes_ : ndarray of Axes, shape (n_parameters,)
        The panels.
    ax_ : Axes
        The first of them.
    figure_ : Figure
        The figure that holds them.
    points_ : dict of Line2D
        The marks, by parameter and method.
    contours_ : list of ContourSet
        The arcs of each panel.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.plotting.tournament_bias import TournamentBiasDisplay
    >>> points = pd.DataFrame(
    ...     {
    ...         "method": ["rls", "ukf", "rls", "ukf"],
    ...         "parameter": ["K_edot", "K_edot", "omega_nm", "omega_nm"],
    ...         "causal": True,
    ...         "bias": [6.0, 4.0, 30.0, 8.0],
    ...         "sd": [11.0, 14.0, 9.0, 12.0],
    ...     }
    ... )
    >>> display = TournamentBiasDisplay(points=points).plot()
    >>> list(display.points_)
    [('K_edot', 'rls'), ('K_edot', 'ukf'), ('omega_nm', 'rls'), ('omega_nm', 'ukf')]
    """

    points: pd.DataFrame

    @classmethod
    def from_result(
        cls,
        result: TournamentResult,
        *,
        window: str = "all",
        parameters: Sequence[str] = SHOWN,
        family: str | Sequence[str] | None = None,
        ax: Any = None,
        **styles: Any,
    ) -> Self:
        """Draw the methods of a tournament: medians over its cells.

        Parameters
        ----------
        result : TournamentResult
            The tournament.
        window : {"all", "before", "around", "after"}, default="all"
            Part of the run.
        parameters : sequence of str, default=("K_e", "K_edot", "omega_nm", "zeta_nm")
            A panel each; ``"tau_e"`` is possible too.
        family : str, sequence of str or None, default=None
            Only cells of these families; see :meth:`TournamentResult.summary`.
        ax : Axes, sequence of Axes or None, default=None
            One Axes per parameter. None makes a figure.
        **styles : dict
            Keywords of :meth:`plot` whose names end in ``_kw``.

        Returns
        -------
        display : TournamentBiasDisplay
        """
        summary = result.summary(window, family=family)[["bias", "sd"]].reset_index()
        points = summary[summary["parameter"].isin(list(parameters))]
        rank = {name: place for place, name in enumerate(parameters)}
        points = points.sort_values("parameter", key=lambda c: c.map(rank), kind="stable")
        causal = result.methods["causal"].reindex(points["method"]).to_numpy()
        return cls(points=points.assign(causal=causal)).plot(ax, **styles)

    def plot(self, ax: Any = None, *, point_kw: dict[str, Any] | None = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : Axes, sequence of Axes or None, default=None
            One Axes per parameter. None makes a figure.
        point_kw : dict or None, default=None
            Keywords of matplotlib for the marks.

        Returns
        -------
        self : TournamentBiasDisplay
        """
        check_table(self.points, COLUMNS, NAME)
        parameters = list(dict.fromkeys(self.points["parameter"]))
        methods = list(dict.fromkeys(self.points["method"]))
        columns = min(len(parameters), MOST_COLUMNS)
        rows = -(-len(parameters) // columns)
        self.axes_ = self._take_axes(
            ax,
            "one per parameter",
            (rows, columns),
            used=range(len(parameters)),
            figsize=(page_width(1.0 + 3.3 * columns, columns), 1.0 + 2.7 * rows),
        )
        self.ax_ = self.axes_[0]
        self.points_: dict[tuple[str, str], Any] = {}
        self.contours_: list[Any] = []
        for number, (parameter, panel) in enumerate(zip(parameters, self.axes_, strict=True)):
            part = self.points[self.points["parameter"] == parameter]
            self._draw(panel, part, methods)
            panel.set_title(OPERATOR.get(parameter, (r"$\tau_e$", ""))[0], fontsize="medium")
            if not self._own or number + columns >= len(parameters):
                panel.set_xlabel("size of the bias, %")
            if not self._own or number % columns == 0:
                panel.set_ylabel("standard deviation, %")
        self._restyle({"point": point_kw}, point=self.points_)
        kinds = self.points.drop_duplicates("method").set_index("method")["causal"]
        self._legend(method_handles(methods, [kinds[method] for method in methods]), methods)
        return self

    def _draw(self, panel: Any, part: pd.DataFrame, methods: list[str]) -> None:
        values = part[["bias", "sd"]].to_numpy(float)
        reach = values[np.isfinite(values).all(axis=1)]
        right, top = (MARGIN * reach.max(axis=0) if reach.size else np.ones(2)).clip(min=1.0)
        x, y = np.meshgrid(np.linspace(0, right, 121), np.linspace(0, top, 121))
        levels = MaxNLocator(6).tick_values(0, float(np.hypot(right, top)))[1:]
        arcs = panel.contour(
            x, y, np.hypot(x, y), levels=levels, colors=GREY, linewidths=scaled(0.7), zorder=1
        )
        self.contours_.append(arcs)
        for row in part.to_dict("records"):
            look = method_style(methods, row["method"], bool(row["causal"]))
            (mark,) = panel.plot(row["bias"], row["sd"], clip_on=False, zorder=3, **look)
            self.points_[row["parameter"], row["method"]] = mark
        panel.set_xlim(0, right)
        panel.set_ylim(0, top)
