"""Checks of recordings for faults, before anything is fitted: ``check_channels``, ``Finding``."""

from .channels import check_channels
from .findings import Finding

__all__ = ["Finding", "check_channels"]
