"""Channels about their means."""

from __future__ import annotations

from typing import Any


def about_means(data: Any) -> Any:
    """Subtract the mean of all runs, which keeps differences between runs."""
    about = data - data.mean()
    about.attrs = dict(data.attrs)
    return about
