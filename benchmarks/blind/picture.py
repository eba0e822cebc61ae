"""The confusion matrix of the whole trial as a table and as the picture of docs/trust-a-name.md.

    python benchmarks/blind/picture.py main.csv null.csv left_out.csv
    python benchmarks/blind/picture.py  # the picture alone, of the table that is there

The files are those of ``run.py --confusion``. Rows are what was hidden: each effect alone, nothing,
and effects that had been left out of the catalogue; columns the first name that the search gave.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.colors import PowerNorm
from run import EFFECTS
from sets import NONE, UNKNOWN, right_answers
from sklearn.metrics import ConfusionMatrixDisplay

from skhoid.effects import title_of

DOCS = Path(__file__).resolve().parents[2] / "docs"
TABLE = DOCS / "_static" / "confusion.csv"
LEFT_OUT = "(left out)"


def combined(main: pd.DataFrame, null: pd.DataFrame, left_out: pd.DataFrame) -> pd.DataFrame:
    """Counts of first names (columns) by what was hidden (rows), both in the catalogue's order."""
    rows = pd.concat([main, null, left_out.sum().to_frame(LEFT_OUT).T])
    rows = rows.reindex([*EFFECTS, NONE, LEFT_OUT], columns=[*EFFECTS, NONE, UNKNOWN])
    return rows.fillna(0).astype(int)


def draw(counts: pd.DataFrame) -> plt.Figure:
    """Shares of each row by colour, counts as numbers; answers that count as right are framed."""
    shares = counts.div(counts.sum(axis=1), axis=0).to_numpy()
    figure, ax = plt.subplots(figsize=(9.6, 9.0), layout="constrained")
    display = ConfusionMatrixDisplay(shares, display_labels=[_words(name) for name in counts])
    display.plot(
        ax=ax,
        cmap="Blues",
        include_values=False,
        colorbar=False,
        xticks_rotation="vertical",
        im_kw={"norm": PowerNorm(0.5, 0, 1)},
    )
    for i, name in enumerate(counts.index):
        for j, said in enumerate(counts.columns):
            if count := counts.iloc[i, j]:
                color = "w" if shares[i, j] > 0.4 else "k"
                size = 7 if count < 1000 else 5
                ax.text(j, i, count, ha="center", va="center", color=color, size=size)
            right = said in right_answers(name, np.inf) if name in EFFECTS else said == name
            if right or (name, said) == (LEFT_OUT, UNKNOWN):
                frame = plt.Rectangle((j - 0.5, i - 0.5), 1, 1, fill=False, ec="tab:green", lw=1)
                ax.add_patch(frame)
    ax.set_yticks(range(len(counts)), [_words(name) for name in counts.index])
    ax.tick_params(labelsize=9)
    ax.set(xlabel="named first", ylabel="hidden")
    return figure


def _words(name: str) -> str:
    if name == LEFT_OUT:
        return "one that was left out"
    return {NONE: "nothing", UNKNOWN: "unknown"}.get(name) or title_of(name)


def main() -> None:
    parser = argparse.ArgumentParser(description="Confusion matrix of the blind trial.")
    parser.add_argument("csv", nargs="*", type=Path, help="of the suites main, null and left_out")
    tables = [pd.read_csv(path, index_col=0) for path in parser.parse_args().csv]
    if tables:
        combined(*tables).to_csv(TABLE, index_label="hidden")
    draw(pd.read_csv(TABLE, index_col=0)).savefig(DOCS / "_static" / "confusion.png", dpi=160)


if __name__ == "__main__":
    main()
