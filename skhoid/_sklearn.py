"""Private names and conventions of scikit-learn, and what estimators' docstrings share."""

import re
import sys
from collections.abc import Callable, Mapping
from numbers import Integral, Real
from typing import Any, TypeVar

import numpy as np
from sklearn.base import _fit_context as fit_context
from sklearn.exceptions import NotFittedError
from sklearn.model_selection._search import BaseSearchCV
from sklearn.utils import _safe_indexing as safe_indexing
from sklearn.utils import estimator_html_repr
from sklearn.utils._param_validation import HasMethods, Interval, StrOptions, validate_params
from sklearn.utils._set_output import _get_output_config
from sklearn.utils.metadata_routing import _raise_for_params as raise_for_params
from sklearn.utils.metadata_routing import _routing_enabled as routing_enabled
from sklearn.utils.metaestimators import _BaseComposition as BaseComposition
from sklearn.utils.validation import check_is_fitted

__all__ = [
    "COUNT",
    "DT",
    "ROLES",
    "RUN_IN",
    "WINDOW",
    "BaseComposition",
    "BaseSearchCV",
    "CallbackSupportMixin",
    "CoefficientsOfLags",
    "FittedDisplay",
    "HasMethods",
    "Interval",
    "SharedDocs",
    "StrOptions",
    "checked",
    "fill_docs",
    "fit_context",
    "list_progress_bars",
    "output_container",
    "raise_for_params",
    "routing_enabled",
    "safe_indexing",
    "with_callbacks",
]

F = TypeVar("F", bound=Callable[..., Any])

try:
    from sklearn.callback import CallbackSupportMixin, ProgressBar, with_callbacks
except ModuleNotFoundError:  # before scikit-learn 1.9 a fit tells nobody how far it is

    class _Untold:
        """A context of callbacks that nobody listens to."""

        parent = None

        def subcontext(self, **_: Any) -> "_Untold":
            return self

        def call_on_fit_task_begin(self, **_: Any) -> None: ...

        def call_on_fit_task_end(self, **_: Any) -> None: ...

    class CallbackSupportMixin:  # type: ignore[no-redef]
        """What searches call of scikit-learn's class of this name."""

        def set_callbacks(self, *callbacks: Any) -> Any:
            """Take callbacks, which scikit-learn calls since 1.9, and call none.

            Parameters
            ----------
            *callbacks : callbacks
                As scikit-learn has them.

            Returns
            -------
            self : estimator
            """
            return self

        def _init_callback_context(self, **_: Any) -> _Untold:
            return _Untold()

    class BaseSearchCV(CallbackSupportMixin, BaseSearchCV):  # type: ignore[no-redef]
        """Scikit-learn's class, which has callbacks since 1.9."""

    ProgressBar = None

    def with_callbacks(fit: F) -> F:
        return fit


def list_progress_bars(**options: Any) -> tuple[Any, ...]:
    """Return a progress bar as the callbacks of a fit; none where scikit-learn has none."""
    return () if ProgressBar is None else (ProgressBar(**options),)


# Constraints that functions have in common.
COUNT = [Interval(Integral, 1, None, closed="left"), None]
DT = [Interval(Real, 0, None, closed="neither"), None]
ROLES = [Mapping, None]
RUN_IN = [Interval(Real, 0, None, closed="left"), None]
WINDOW = [tuple, list, np.ndarray, None]

# What docstrings of estimators have in common: a line ``{X, y}`` in one stands for these entries.
SHARED = {
    "inputs": (
        "inputs : list of column names or positions, or None, default=None",
        "Linear inputs. None means the column named ``e`` if there is one, else all columns.",
    ),
    "roles": (
        "roles : dict or None, default=None",
        "Roles of columns, ``{column: role}``, where their names do not give them.",
    ),
    "dt": (
        "dt : float or None, default=None",
        "Sampling time in seconds of data without a time index (None: 1).",
    ),
    "run": (
        "run : column name or position, or None, default=None",
        "Run column of data without a run index.",
    ),
    "X": (
        "X : DataFrame or array of shape (n_rows, n_columns)",
        "Channels, one row per sample; runs and time are read from its index.",
    ),
    "y": (
        "y : Series or array of shape (n_rows,)",
        "Measured output; NaN where it was not measured.",
    ),
    "sample_weight": (
        "sample_weight : array-like of shape (n_rows,), float or None, default=None",
        "Weight of each row of y in the squares, as the inverse of the variance of its noise: only",
        "ratios count (and in a recursion the size beside P0), so that standard errors do not",
        "shrink where all are doubled. Runs of weight 2 give the estimates of runs that are there",
        "twice. 0 means that y was not measured, as NaN does; a small weight does not: the row",
        "still serves as a lag.",
    ),
    "groups": (
        "groups : array-like of shape (n_rows,) or None, default=None",
        "Group of each row, as in ``GridSearchCV``: what ``cv`` keeps together, and what",
        "``cv=None`` leaves out one at a time. Groups consist of whole runs. None uses the runs.",
    ),
    "effects": (
        "effects : Effect, Effects, str, list of these, or None, default=None",
        'What the linear model is missing, such as ``"dead_zone"``; see :mod:`skhoid.effects`.',
    ),
    "controlled_element": (
        "controlled_element : ControlledElement, LinearElement, str, system or None, default=None",
        'For effects that use its inverse: ``"1/(s(s+1))"``, say, or a transfer function of SciPy',
        "or python-control; None estimates it from output and x.",
    ),
    "start": (
        "start : dict or None, default=None",
        "Values to start the fit from, ``{parameter: value}`` with the names of ``parameters_``,",
        "in addition to the model's own starts.",
    ),
    "parameter_table_": (
        "parameter_table_ : ParameterTable",
        "All parameters with bounds and units; see :class:`skhoid.model.ParameterTable`.",
    ),
    "parameters_": (
        "parameters_ : DataFrame",
        "Indexed by parameter: value, sd (standard error), low and high (95 % interval), unit,",
        "meaning. Parameters of effects are called ``<effect>__<parameter>``. A parameter at a",
        "bound has no sd.",
    ),
    "effects_": (
        "effects_ : Effects",
        "The effects with their estimated values and their choices (form, channel) made.",
    ),
    "covariance_": (
        "covariance_ : DataFrame",
        "Covariance of the estimated parameters.",
    ),
    "likelihood": (
        "loglik_, bic_, vaf_ : float",
        "Logarithm of the likelihood without constants, Bayesian information criterion, and VAF in",
        "percent of the free run on the fitted rows.",
    ),
    "controlled_element_": (
        "controlled_element_ : ControlledElement, LinearElement or None",
        "Given or estimated.",
    ),
    "initial_": (
        "initial_ : str",
        'How free runs begin: ``"rest"`` or ``"estimate"`` (in scores, by their first seconds).',
    ),
    "dt_": (
        "dt_ : float",
        "Sampling time (of the fitted grid) in seconds.",
    ),
    "inputs_": (
        "inputs_ : list of str",
        "Names of the linear inputs.",
    ),
    "n_features_in_": (
        "n_features_in_ : int",
        "Number of columns seen in ``fit``.",
    ),
    "feature_names_in_": (
        "feature_names_in_ : ndarray of str",
        "Column names seen in ``fit``, if all are strings.",
    ),
    "parameter_names_": (
        "parameter_names_ : list of str",
        "Names of the parameters.",
    ),
    "orders": (
        "na, nb, nk : int, or one per input for nb and nk, default=2, 2, 0",
        "Orders and input delay in samples, as for :class:`ARXRegressor`.",
    ),
    "fit_intercept": (
        "fit_intercept : bool, default=False",
        "Add a constant to the regressors.",
    ),
    "memory_time": (
        "memory_time : float or None, default=None",
        "T0 in seconds: a row so old has e^-1 of the weight of the newest. None: nothing is",
        "forgotten.",
    ),
    "init_window": (
        "init_window : float, default=30.72",
        "Seconds of data from which the model begins, from the first row that is not NaN.",
    ),
    "store_covariance": (
        "store_covariance : bool, default=False",
        "Keep ``covariance_path_``.",
    ),
    "error": (
        "inputs : column name or list with one, or None, default=None",
        "The error. None means the column of role ``e``.",
    ),
    "time_path_": (
        "time_path_ : ndarray of shape (n_instants,)",
        "Time in the run in seconds.",
    ),
    "standard_errors_": (
        "standard_errors_ : ndarray of shape (n_params,)",
        "Square roots of the diagonal of ``covariance_``.",
    ),
    "last_parameters_": (
        "parameters_ : DataFrame",
        "The last parameters: value, sd, low and high (95 % interval), unit, meaning.",
    ),
    "covariance_path_": (
        "covariance_path_ : ndarray of shape (n_instants, n_params, n_params)",
        "Covariance of ``coef_path_``; with ``store_covariance``.",
    ),
    "parameters_path_": (
        "parameters_path_ : DataFrame of shape (n_instants, 12)",
        "Over time (s): K_e, T_L, K_edot, tau_e, omega_nm, zeta_nm and their standard errors",
        "``sd_K_e`` ...",
    ),
    "folds": (
        "cv : int, splitter, iterable or None, default=None",
        "Folds; an int is a number of folds of whole runs. None leaves out one run at a time; a",
        "single run is fitted on its first half and scored on its second.",
    ),
    "scoring": (
        "scoring : VAFScorer or None, default=None",
        "How the VAF is computed: run-in, window, centring, average.",
    ),
    "of_search_": (
        "best_index_ : int",
        "Position of the chosen candidate in ``cv_results_``.",
    ),
    "of_folds_": (
        "n_splits_, scorer_ : int, VAFScorer",
        "Number of folds, 0 without; how the VAF was computed.",
    ),
    "jitter_": (
        "jitter_ : float",
        "Largest deviation of a step of the clock, as a fraction of the sampling time.",
    ),
    "run_labels_": (
        "run_labels_ : list",
        "Labels of the runs.",
    ),
    "n_rows_missing_": (
        "n_rows_missing_ : int",
        "Rows left out because y or an input in their lags is NaN.",
    ),
    "run_errors": (
        "ShortRunError, RunIndexError, IrregularSamplingError",
        "If runs are too short, or rows, runs or time violate the data convention.",
    ),
}


def fill_docs(cls: type) -> None:
    """Put the shared entries into the docstrings of a class and its methods."""
    for one in (cls, *vars(cls).values()):
        doc = getattr(one, "__doc__", None) if one is cls or callable(one) else None
        if doc and "{" in doc:
            one.__doc__ = re.sub(r"^( *)\{([\w, ]+)\}$", _entries, doc, flags=re.MULTILINE)


def _entries(line: re.Match) -> str:
    indent, names = line[1], line[2].split(", ")
    if not SHARED.keys() >= {*names}:
        return line[0]
    heads = {
        name: (SHARED[name][0], *(f"    {text}" for text in SHARED[name][1:])) for name in names
    }
    return "\n".join(indent + text for entry in heads.values() for text in entry)


class SharedDocs:
    """A mixin whose subclasses have the shared entries in their docstrings."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        fill_docs(cls)


def checked(**constraints: list) -> Callable[[F], F]:
    """Check the parameters of a public function, as those of estimators are checked in ``fit``."""
    return validate_params(constraints, prefer_skip_nested_validation=False)


def output_container(transformer: object) -> str:
    """Container that ``transformer.transform`` will be wrapped in: default, pandas or polars."""
    return _get_output_config("transform", transformer)["dense"]


class FittedDisplay:
    """A mixin whose estimators show what they found below scikit-learn's diagram."""

    def _found_html(self) -> str:
        raise NotImplementedError

    def _html_repr(self) -> str:
        diagram = estimator_html_repr(self)
        try:
            check_is_fitted(self)
        except NotFittedError:
            return diagram
        return diagram + self._found_html()


class CoefficientsOfLags:
    """The attribute ``coef_`` of a model, refused to selection by importance.

    It expects one number per column of X, and scikit-learn has no tag by which a model could say
    otherwise, so the caller has to be inspected. ``one_coefficient_per_column`` says
    that it has one per column.
    """

    def __get__(self, model: Any, owner: Any = None) -> Any:
        if model is None:
            return self
        found = vars(model).get("coef_")
        if found is None:
            raise AttributeError(f"{type(model).__name__!r} object has no attribute 'coef_'")
        asking = sys._getframe(1).f_globals.get("__name__", "")
        if asking.startswith("sklearn.feature_selection") and not model.one_coefficient_per_column:
            first = ", ".join(model.parameter_names_[:4])
            raise TypeError(
                f"coef_ of {type(model).__name__} has one number per lag ({first}, ...), and "
                "selection by importance needs one per column of X. Compare sets of inputs "
                "instead: "
                'GridSearchCV(model, {"inputs": [["e"], ["e", "x"]]}, scoring=VAFScorer(), '
                "cv=LeaveOneGroupOut()), fitted with groups=run_labels(X)."
            )
        return found

    def __set__(self, model: Any, value: Any) -> None:
        vars(model)["coef_"] = value

    def __delete__(self, model: Any) -> None:
        del vars(model)["coef_"]
