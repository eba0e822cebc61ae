"""``check_effect``: all checks of an effect in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..effects.base import Effect
from ..effects.parameter import CoreKind
from .application import check_apply, check_neutral, check_symmetries
from .descriptions import check_description, check_estimator, check_starts, expect, name_of
from .fits import check_recovery, check_simulation
from .records import synthetic_record


def check_effect(
    effect: Effect,
    *,
    core: CoreKind | str = CoreKind.OPERATOR,
    channels: Sequence[str] = (),
    recovers: Mapping[str, float] | None = None,
) -> None:
    """Check that an effect obeys the rules on which models and searches rely.

    The effect is documented; ``clone``, ``pickle``, ``get_params`` and ``set_params`` work on it;
    its starts lie within its limits, and there and at the limits ``apply`` gives finite values of
    the right kind and shape. ``apply`` modifies none of its arguments, is repeatable, treats all
    runs alike, takes time from ``record.t``, and does nothing at ``neutral`` values. The effect can
    be simulated alone and with other effects. All this holds for each of its ``variants``.

    Parameters
    ----------
    effect : Effect
        An instance.
    core : {"operator", "arx"} or CoreKind, default="operator"
        Kind of model in which it acts.
    channels : sequence of str, default=()
        Columns that the effect needs besides e, x, f_t, motion_acc, dist and speed.
    recovers : dict of str to float or None, default=None
        Parameter values with which to simulate runs; a model must recover them from as little as 24
        s. There the error e has a standard deviation of 1, and the output one of about 0.8. None
        leaves this check out.

    Raises
    ------
    AssertionError
        If a check fails; the message says what is wrong and how to fix it.

    See Also
    --------
    skhoid.effects.Effect : The base of all effects, and what it needs.

    Examples
    --------
    >>> from skhoid.effects import DeadZone
    >>> from skhoid.testing import check_effect
    >>> check_effect(DeadZone(form="gap"), recovers={"width": 0.4})
    """
    if core not in (CoreKind.OPERATOR, CoreKind.ARX):
        raise ValueError(f'core must be "operator" or "arx"; got {core!r}.')
    expect(
        isinstance(effect, Effect),
        f"{effect!r} is not an instance of skhoid.effects.Effect"
        + (": pass an instance, not the class." if isinstance(effect, type) else "."),
    )
    record = synthetic_record(channels)
    check_description(effect)
    check_estimator(effect)
    reason = effect.refusal(record, CoreKind(core))
    expect(
        reason is None,
        f"{name_of(effect)} does not apply to the runs on which it is checked: {reason}. They "
        f"have the columns {', '.join(record.channels)}; name others with channels=[...].",
    )
    variants = effect.variants(record)
    expect(
        isinstance(variants, list) and len(variants) > 0,
        f"{name_of(effect)}.variants must return a list of at least one effect; got {variants!r}.",
    )
    for variant in variants:
        expect(
            isinstance(variant, Effect) and variant.name == effect.name,
            f"{name_of(effect)}.variants must return effects of the same name; got {variant!r}.",
        )
        check_description(variant)
        check_estimator(variant)
        check_starts(variant, record)
        check_apply(variant, record)
        check_neutral(variant, record)
        check_symmetries(variant, record)
        check_simulation(variant, record, CoreKind(core))
    if recovers is not None:
        check_recovery(variants[0], record, CoreKind(core), dict(recovers))
