"""Checks of recordings before fitting: faults of channels, and lost control."""

from .channels import check_channels
from .findings import Finding
from .loss_of_control import lost_control

__all__ = ["Finding", "check_channels", "lost_control"]
