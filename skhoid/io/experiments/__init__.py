"""Recordings of an experiment: files of several people, conditions and runs."""

from .read import read_experiment

__all__ = ["read_experiment"]
