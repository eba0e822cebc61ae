"""Checks of recordings before fitting: faults of channels and of people, and lost control."""

from .channels import check_channels
from .experiment_check import ExperimentCheck, check_experiment
from .loss_of_control import lost_control
from .recording import Finding

__all__ = ["ExperimentCheck", "Finding", "check_channels", "check_experiment", "lost_control"]
