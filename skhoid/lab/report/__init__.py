"""One self-contained HTML page: of a model of one person, or of an experiment with people."""

from .document import Report, report
from .experiment import ExperimentReport, report_experiment

__all__ = ["ExperimentReport", "Report", "report", "report_experiment"]
