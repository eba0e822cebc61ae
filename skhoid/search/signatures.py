"""Effects seen in the output or residual itself, without a fit: stops, levels, kinds of noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..effects.base import Effect
from ..effects.catalogue import CLASSES
from ..effects.record import Record, Signature, fastest_of, step_of, stop_of


def traces_of(record: Record) -> dict[str, str]:
    """Sentences on stops, rate limits and levels seen in the measured output, by effect."""
    step = step_of(record)
    if step is not None:
        return {"quantised": f"the output takes few values, {step:.3g} apart"}
    found = {}
    stop = stop_of(record)
    if stop is not None:
        found["saturation"] = f"{100 * stop.share:.0f} % of the samples lie at {stop.where}"
    fastest = fastest_of(record)
    if fastest is not None:
        share, limit = fastest
        found["rate_limit"] = f"{100 * share:.0f} % of the rates lie at ±{limit:.3g} per second"
    return found


def noises_in(
    residual: np.ndarray, record: Record, tried: Sequence[Effect]
) -> tuple[list[tuple[Effect, Signature]], list[Signature]]:
    """Effects that are noise to the free run, and show in a residual.

    Those of ``tried`` with their signatures, then signatures of others of the catalogue.
    """
    by_name = {effect.name: effect for effect in tried if effect.noise}
    named, others = [], []
    for effect in by_name.values():
        found = effect.signature(residual, record)
        if found is not None:
            named.append((effect, found))
    for kind in CLASSES:
        if kind.noise and kind.name not in by_name:
            found = kind().signature(residual, record)
            if found is not None:
                others.append(found)
    return named, others


def without_noise(record: Record, output: np.ndarray, tried: Sequence[Effect]) -> Record | None:
    """A record whose output lacks what effects of ``tried`` that are noise show in a residual.

    The residual is that of a model's ``output``. None where nothing shows. A tremor bends the fit
    of simulations, which has no noise model, and a resonance or a map that follows the error round
    the loop could take up some of it.
    """
    assert record.y is not None
    parts = [effect.noise_part(record.y - output, record) for effect in tried]
    shown = [part for part in parts if part is not None]
    if not shown:
        return None
    return replace(record, y=record.y - np.sum(shown, axis=0), _derived={})
