"""Searches for the delay and the orders of an ARX model."""

from .search import DelaySearchCV, OrderSearchCV

__all__ = ["DelaySearchCV", "OrderSearchCV"]
