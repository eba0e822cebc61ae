"""Private names of scikit-learn, which no other file imports."""

from sklearn.base import _fit_context as fit_context
from sklearn.exceptions import NotFittedError
from sklearn.utils import _safe_indexing as safe_indexing
from sklearn.utils import estimator_html_repr
from sklearn.utils._param_validation import HasMethods, Interval, StrOptions
from sklearn.utils._set_output import _get_output_config
from sklearn.utils.metadata_routing import _raise_for_params as raise_for_params
from sklearn.utils.metadata_routing import _routing_enabled as routing_enabled
from sklearn.utils.metaestimators import _BaseComposition as BaseComposition
from sklearn.utils.validation import check_is_fitted

__all__ = [
    "BaseComposition",
    "FittedDisplay",
    "HasMethods",
    "Interval",
    "StrOptions",
    "fit_context",
    "output_container",
    "raise_for_params",
    "routing_enabled",
    "safe_indexing",
]


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
