"""Searches for the delay and the orders of an ARX model."""

from .delay import DelaySearchCV
from .orders import OrderSearchCV

__all__ = ["DelaySearchCV", "OrderSearchCV"]
