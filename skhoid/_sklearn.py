"""The only importer of scikit-learn's private names."""

from sklearn.base import _fit_context as fit_context
from sklearn.utils import _safe_indexing as safe_indexing
from sklearn.utils._param_validation import HasMethods, Interval, StrOptions
from sklearn.utils._set_output import _get_output_config
from sklearn.utils.metaestimators import _BaseComposition as BaseComposition

__all__ = [
    "BaseComposition",
    "HasMethods",
    "Interval",
    "StrOptions",
    "fit_context",
    "output_container",
    "safe_indexing",
]


def output_container(transformer: object) -> str:
    """Container that ``transformer.transform`` will be wrapped in: default, pandas or polars."""
    return _get_output_config("transform", transformer)["dense"]
