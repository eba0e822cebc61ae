"""Save figures as complete files or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .whole import written_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["save_figure"]

DPI = 120
EMBEDDED: Any = {"pdf.fonttype": 42, "ps.fonttype": 42}  # TrueType: journals refuse type 3


def save_figure(
    figure: Figure, path: str | Path, *, metadata: dict[str, str] | None = None
) -> Path:
    """Save a figure in the format of the path's ending, and close it.

    Fonts are embedded in PDF and PS as TrueType, as journals demand.
    """
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    path = Path(path)
    with written_whole(path) as aside, mpl.rc_context(EMBEDDED):
        figure.savefig(aside, dpi=DPI, metadata=metadata)
    plt.close(figure)
    return path
