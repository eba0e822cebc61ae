"""The channels, the clock and the units that a user names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..exceptions import UsageError
from ._table import split_header

__all__ = [
    "Channel",
    "by_field",
    "check_names",
    "checked_clock",
    "checked_units",
    "wanted_channels",
]


@dataclass(frozen=True)
class Channel:
    asked: str
    name: str
    renamed: bool = False


def wanted_channels(spec: Any, argument: str) -> list[Channel]:
    items: list[tuple[Any, Any]]
    if isinstance(spec, str):
        items = [(spec, split_header(spec)[0])]
    elif isinstance(spec, Mapping):
        items = list(spec.items())
    elif isinstance(spec, Iterable) and argument == "inputs":
        items = [(name, split_header(name)[0] if isinstance(name, str) else name) for name in spec]
    else:
        items = [(spec, spec)]
    for item in items:
        if not all(isinstance(name, str) for name in item):
            raise TypeError(f"{argument} must name channels by strings; got {spec!r}.")
    if not items:
        raise ValueError(f"{argument} is empty: name at least one channel.")
    if argument == "output" and len(items) > 1:
        raise ValueError(f"output must name one channel; got {spec!r}.")
    return [Channel(*item, renamed=isinstance(spec, Mapping)) for item in items]


def by_field(channels: list[Channel]) -> list[Channel]:
    """Fields of structs under their own names, for guessing roles, where these are unique."""
    fields = [channel.name.rpartition(".")[2] for channel in channels]
    return [
        replace(channel, name=field)
        if not channel.renamed and fields.count(field) == 1
        else channel
        for channel, field in zip(channels, fields, strict=True)
    ]


def check_names(channels: list[Channel]) -> None:
    names = [channel.name for channel in channels]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(
            f"The channel {twice!r} is named more than once among inputs and output "
            f"({names}). Name it once, or rename with a dict {{name in the file: channel}}."
        )


def checked_clock(time: str | None, dt: float | None) -> str | float:
    if time is not None and dt is not None:
        raise ValueError(f"Give the time column ({time!r}) or dt ({dt!r}), not both.")
    if time is not None:
        return time
    if dt is None:
        raise UsageError(
            "There is no clock: name the time column, or, if the files have none, give the "
            "sampling time in seconds.",
            hint="Give time='t' or dt=0.01.",
            options=["time", "dt"],
        )
    return float(dt)


def checked_units(
    units: Mapping[str, str], channels: list[Channel], time: str | None
) -> dict[str, str]:
    """Return the given units by channel name, those of the time under ``"time"``."""
    keys = {"time": "time"}
    if time is not None:
        keys |= {time: "time", split_header(time)[0]: "time"}
    for channel in channels:
        keys |= {channel.asked: channel.name, split_header(channel.asked)[0]: channel.name}
    keys |= {channel.name: channel.name for channel in channels}
    unknown = [key for key in units if key not in keys]
    if unknown:
        raise ValueError(
            f"units has {unknown[0]!r}, which is not one of the channels, {list(keys)}."
        )
    return {keys[key]: unit for key, unit in units.items()}
