"""The version number, kept here only."""

__version__ = "0.1.0"
