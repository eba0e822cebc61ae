"""The confusion matrix of the whole trial as a table and as the picture of docs/trust-a-name.md.

    python benchmarks/blind/picture.py main.csv null.csv left_out.csv

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

DOCS = Path(__file__).resolve().parents[2] / "docs"
LEFT_OUT = "(left out)"


def combined(main: pd.DataFrame, null: pd.DataFrame, left_out: pd.DataFrame) -> pd.DataFrame:
    """Counts of first names (columns) by what was hidden (rows), both in the catalogue's order."""
    rows = pd.concat([main, null, left_out.sum().to_frame(LEFT_OUT).T])
    rows = rows.reindex([*EFFECTS, NONE, LEFT_OUT], columns=[*EFFECTS, NONE, UNKNOWN])
    return rows.fillna(0).astype(int)


def draw(counts: pd.DataFrame) -> plt.Figure:
    """Shares of each row by colour, counts as numbers; answers that count as right are framed."""
    shares = counts.div(counts.sum(axis=1), axis=0).to_numpy()
    figure, ax = plt.subplots(figsize=(11, 10.5), layout="constrained")
    display = ConfusionMatrixDisplay(shares, display_labels=list(counts.columns))
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
                ax.text(j, i, count, ha="center", va="center", color=color, size=7)
            right = said in right_answers(name, np.inf) if name in EFFECTS else said == name
            if right or (name, said) == (LEFT_OUT, UNKNOWN):
                frame = plt.Rectangle((j - 0.5, i - 0.5), 1, 1, fill=False, ec="tab:green", lw=1)
                ax.add_patch(frame)
    ax.set_yticks(range(len(counts)), counts.index)
    ax.tick_params(labelsize=8)
    ax.set(xlabel="named first", ylabel="hidden")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description="Confusion matrix of the blind trial.")
    parser.add_argument("csv", nargs=3, type=Path, help="of the suites main, null and left_out")
    counts = combined(*(pd.read_csv(path, index_col=0) for path in parser.parse_args().csv))
    counts.to_csv(DOCS / "_static" / "confusion.csv", index_label="hidden")
    draw(counts).savefig(DOCS / "_static" / "confusion.png", dpi=110)


if __name__ == "__main__":
    main()
