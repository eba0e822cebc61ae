"""What is wrong with a recording, before anything is fitted to it."""

from .channels import check_channels
from .findings import Finding

__all__ = ["Finding", "check_channels"]
