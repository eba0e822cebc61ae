"""``search.explore()``: what a search found, to be tried by hand in a notebook."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..runs.fingerprint import fingerprint

# Data of fits, for as long as others hold them: a search itself keeps none, and is small.
_DATA: weakref.WeakKeyDictionary[Any, tuple[Any, Any]] = weakref.WeakKeyDictionary()


def remember(search: Any, X: Any, y: Any) -> None:
    """Remember what a search was fitted to, as long as it is there anyway."""
    try:
        _DATA[search] = weakref.ref(X), weakref.ref(y)
    except TypeError:  # a list, say
        _DATA.pop(search, None)


def check_data_of_fit(search: Any, X: Any, y: Any) -> None:
    """Refuse data that a search was not fitted to."""
    of_fit = search.predictions_["measured"].to_numpy()
    given = np.asarray(getattr(y, "to_numpy", lambda: y)(), dtype=float).ravel()
    if len(of_fit) != len(given) or not np.array_equal(of_fit, given, equal_nan=True):
        raise ValueError(
            f"This search was fitted to {len(of_fit)} rows of an output, and y "
            f"({len(given)} rows) is not that output. Pass the X and y that it was fitted to, "
            "or fit it to these."
        )
    if fingerprint(X) != search._fingerprint:
        raise ValueError(
            "This search was fitted to another X: values, names, runs or times differ. Pass "
            "the X and y that it was fitted to, or fit it to these."
        )


class ExploredByHand:
    """What a fitted search can do: show itself as something to touch."""

    def explore(self, X: Any = None, y: Any = None) -> Any:
        """Try the effects by hand, in a notebook: add, move parameters, see the error fall.

        The widget shows measured and simulated output run by run, where in time, frequency and
        amplitude they differ, and the effects as cards with their parameters as sliders; the
        kernel computes.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns) or None, default=None
            The data of the fit; None takes those of ``fit``, if they are still in memory.
        y : Series or array of shape (n_rows,) or None, default=None
            Their measured output.

        Returns
        -------
        widget : anywidget.AnyWidget
            The last expression of a cell shows it. ``widget.exploration.model`` is the model as
            it was left.

        Raises
        ------
        ImportError
            Without anywidget: ``pip install "skhoid[notebook]"``.
        ValueError
            If the data of the fit are gone, or X and y are others.

        See Also
        --------
        skhoid.lab.report.report : A page with all combinations of the effects found.
        """
        check_is_fitted(self)
        from ..lab.explore import Exploration
        from ..lab.explore.component import of_exploration

        found: Any = self
        return of_exploration(Exploration.of_search(found, *self._data_of_fit(X, y)))

    def _data_of_fit(self, X: Any, y: Any) -> tuple[Any, Any]:
        if (X is None) != (y is None):
            raise ValueError("Give both X and y, or none.")
        if X is not None:
            check_data_of_fit(self, X, y)
            return X, y
        held = tuple(one() for one in _DATA.get(self, ()))
        if len(held) != 2 or any(one is None for one in held):
            raise ValueError(
                "The data that this search was fitted to are no longer in memory: pass them, "
                "search.explore(X, y)."
            )
        return held[0], held[1]
