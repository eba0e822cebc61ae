"""The register of hidden forms: what is hidden, where it acts, and which names are right for it.

Open it to see which names count as right. Names that no data can tell apart stand in ``ALIKE`` with
the reason; everything else must be named exactly. The forms themselves are in ``forms_static.py``,
``forms_paths.py`` and ``forms_time.py``.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .elements import Element
from .world import World

Hide = Callable[[World, float, np.random.Generator], None]
UNKNOWN = "unknown"  # the answer to what no catalogue holds
ANY = ("compensatory", "pursuit", "preview")


@dataclass(frozen=True)
class Form:
    """One way in which an effect can act; ``hide(world, size, rng)`` puts it in, size about 0.3
    (medium) to 1 (strong).
    """

    effect: str
    name: str
    place: str
    hide: Hide
    displays: tuple[str, ...] = ANY
    orders: tuple[int, ...] = (1, 2)
    not_on: tuple[str, ...] = ()
    dist: bool = False
    parts: tuple[Hide, ...] = ()  # of a pair, each of which must matter alone
    plain: bool = False  # only for a person without lead (a coarse display has no rate to be seen)
    beyond: bool = False  # no catalogue holds it

    def fits(self, element: Element) -> bool:
        """Whether a person can do this on the element."""
        return element.order in self.orders and element.name not in self.not_on

    @property
    def accepted(self) -> tuple[str, ...]:
        """The right names: the effect's own, then those that no data can tell from it."""
        return tuple(name for names in self.each for name in names)

    @property
    def each(self) -> list[tuple[str, ...]]:
        """Right names of each effect; a pair is called by its two ids with a plus between."""
        if self.beyond:
            return [(UNKNOWN,)]
        return [
            (one, *ALIKE.get((one, self.name), ALIKE.get((one, ""), ())))
            for one in self.effect.split("+")
        ]


# (effect, form), or (effect, "") for all its forms: other names as right; README.md says why.
ALIKE: dict[tuple[str, str], tuple[str, ...]] = {
    ("backlash", ""): ("stiction",),
    ("stiction", ""): ("backlash",),
    ("stiction", "karnopp"): ("backlash", "friction"),
    ("asym_gain", ""): ("rectified", "absolute_value"),
    ("rectified", "half_wave"): ("asym_gain", "absolute_value"),
    ("rectified", "share"): ("asym_gain", "absolute_value"),
    ("absolute_value", "path"): ("asym_gain", "rectified"),
    ("feedforward", "position"): ("output_feedback", "preview"),
    ("feedforward", "rate"): ("output_feedback", "preview"),
    ("feedforward", "inverse"): ("preview",),
    ("output_feedback", ""): ("feedforward",),
    ("motion_feedback", ""): ("output_feedback",),
    ("preview", ""): ("feedforward",),
    ("extra_lag", ""): ("higher_order", "integral"),
    ("integral", ""): ("extra_lag", "higher_order"),
    ("extra_lead", ""): ("higher_order",),
    ("nm_mode", ""): ("higher_order",),
    ("higher_order", ""): ("extra_lead", "extra_lag", "nm_mode"),
    ("hardening_stiffness", ""): ("saturation", "cubic_gain"),
    ("saturation", "soft"): ("cubic_gain", "hardening_stiffness"),
    ("cubic_gain", "falls"): ("saturation",),
    ("gain_drift", ""): ("tv_gain",),
    ("friction", ""): ("stiction",),
}

FORMS: list[Form] = []


def form(effect: str, name: str, place: str, **limits: object) -> Callable[[Hide], Hide]:
    """Register a form."""

    def keep(hide: Hide) -> Hide:
        FORMS.append(Form(effect, name, place, hide, **limits))  # type: ignore[arg-type]
        return hide

    return keep


def all_forms() -> list[Form]:
    """Every form, in the order of the files."""
    from . import forms_paths, forms_static, forms_time  # noqa: F401  (they register themselves)

    return FORMS
