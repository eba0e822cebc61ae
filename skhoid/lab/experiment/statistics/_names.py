"""Names of columns that R, SPSS, JASP and others accept: letters, digits and underscores.

Open it for how units and labels are spelled.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

LONGEST = 64  # bytes, in SPSS
RESERVED = {"all", "and", "by", "eq", "ge", "gt", "le", "lt", "ne", "not", "or", "to", "with"}
SPELLED = {
    "°": "deg",
    "%": "percent",
    "Ω": "ohm",
    "µ": "u",
    "μ": "u",
    "α": "alpha",
    "β": "beta",
    "γ": "gamma",
    "δ": "delta",
    "ζ": "zeta",
    "θ": "theta",
    "λ": "lambda",
    "σ": "sigma",
    "τ": "tau",
    "φ": "phi",
    "ω": "omega",
    "²": "2",
    "³": "3",
    "⁻": "-",
    "√": "sqrt",
}


def safe(text: str) -> str:
    """Text in letters, digits and underscores.

    Examples
    --------
    >>> from skhoid.lab.experiment.statistics._names import safe
    >>> safe("ζ_nm"), safe("day 2"), safe("Müller")
    ('zeta_nm', 'day_2', 'Muller')
    """
    for sign, word in SPELLED.items():
        text = text.replace(sign, word)
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9]+", "_", plain).strip("_")


def unit_suffix(unit: str) -> str:
    """A unit as the end of a name; nothing for none.

    Examples
    --------
    >>> from skhoid.lab.experiment.statistics._names import unit_suffix
    >>> unit_suffix("deg/deg"), unit_suffix("rad/s^2"), unit_suffix("-")
    ('_deg_per_deg', '_rad_per_s2', '')
    """
    spelled = unit.replace("^", "").replace("**", "").replace("/", " per ")
    name = safe(re.sub(r"-(?=\d)", "minus", spelled))
    return f"_{name}" if name else ""


def variable_names(wanted: Sequence[tuple[str, str]]) -> list[str]:
    """A name for each pair of a stem and a suffix: distinct in any case, and short enough.

    The suffix stays whole; stems that are too long are cut, and those alike are numbered.
    """
    names: list[str] = []
    taken: set[str] = set()
    for stem, suffix in wanted:
        stem = safe(stem)
        if not stem[:1].isalpha():
            stem = f"v_{stem}"
        suffix = suffix[: LONGEST // 2]
        name, count = stem[: LONGEST - len(suffix)] + suffix, 1
        while name.lower() in taken or name.lower() in RESERVED:
            count += 1
            more = f"_{count}{suffix}"
            name = stem[: LONGEST - len(more)] + more
        taken.add(name.lower())
        names.append(name)
    return names
