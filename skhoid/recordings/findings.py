"""``Finding``: one fault or misfit, with its numbers, its meaning and what to do next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..text import Summary


@dataclass(frozen=True, repr=False)
class Finding:
    """One finding about a recording or about the residual of a model.

    Parameters
    ----------
    name : str
        Short identifier of this kind of finding, such as ``"rate unit"``.
    title : str
        What was found, in one line.
    evidence : str
        The numbers behind it.
    meaning : str
        What it means, in the terms of manual-control research.
    next_step : str
        What to do about it.
    picture : str, default=""
        Name of the Display class that shows it; empty if there is none.
    severity : float, default=nan
        VAF points that it costs; NaN if unknown.

    Examples
    --------
    >>> from skhoid.recordings.findings import Finding
    >>> print(
    ...     Finding(
    ...         "constant channel",
    ...         "FiveVolts is constant",
    ...         "5 V in all 100 rows.",
    ...         "It carries no information.",
    ...         "Leave it out.",
    ...     )
    ... )
    FiveVolts is constant
      Evidence: 5 V in all 100 rows.
      Meaning:  It carries no information.
      Next:     Leave it out.
    """

    name: str
    title: str
    evidence: str
    meaning: str
    next_step: str
    picture: str = ""
    severity: float = np.nan

    def __repr__(self) -> str:
        cost = f" ({self.severity:.1f} VAF points)" if np.isfinite(self.severity) else ""
        return f"<Finding {self.name!r}: {self.title}{cost}>"

    def _repr_html_(self) -> str:
        return Summary(self)._repr_html_()

    def __str__(self) -> str:
        return (
            f"{self.title}\n"
            f"  Evidence: {self.evidence}\n"
            f"  Meaning:  {self.meaning}\n"
            f"  Next:     {self.next_step}"
        )
