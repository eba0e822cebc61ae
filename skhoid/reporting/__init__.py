"""One self-contained HTML page: data, model, comparison, ranking, steps, parameters, what next."""

from .document import Report, report

__all__ = ["Report", "report"]
