"""Searches for the delay and the orders of an ARX model."""

from .delay_search import DelaySearchCV
from .order_search import OrderSearchCV

__all__ = ["DelaySearchCV", "OrderSearchCV"]
