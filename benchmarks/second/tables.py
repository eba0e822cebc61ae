"""Tables of results, with Wilson intervals.

Open it for what is printed and for how a share and its interval are computed.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

Row = dict[str, Any]


def wilson(k: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a share of k in n (Wilson 1927), in percent."""
    if n == 0:
        return 0.0, 100.0
    p, q = k / n, z * z / n
    middle, half = (p + q / 2) / (1 + q), z * np.sqrt(p * (1 - p) / n + q / n / 4) / (1 + q)
    return 100 * float(max(0.0, middle - half)), 100 * float(min(1.0, middle + half))


def share(rows: list[Row], key: str) -> str:
    """Percent of rows in which ``key`` is true or not empty, with its interval."""
    known = [r for r in rows if key in r]
    k = sum(bool(r[key]) for r in known)
    if not known:
        return "-"
    low, high = wilson(k, len(known))
    return f"{100 * k / len(known):.0f} % ({low:.0f}-{high:.0f}; {k}/{len(known)})"


def median(rows: list[Row], key: str, size: bool = False) -> str:
    """Median of a number, or of its size."""
    values = [abs(r[key]) if size else r[key] for r in rows if r.get(key) is not None]
    return f"{np.median(values):.3g}" if values else "-"


def groups(rows: Iterable[Row], *keys: str) -> dict[tuple, list[Row]]:
    """Rows by the values of keys, sorted."""
    found: dict[tuple, list[Row]] = defaultdict(list)
    for r in rows:
        found[tuple(str(r.get(k, "")) for k in keys)].append(r)
    return dict(sorted(found.items()))


def grid(head: list[str], lines: list[list[str]]) -> str:
    """A table in Markdown."""
    widths = [max(len(line[i]) for line in [head, *lines]) for i in range(len(head))]

    def line(cells: list[str]) -> str:
        return "| " + " | ".join(c.ljust(w) for c, w in zip(cells, widths, strict=True)) + " |"

    return "\n".join(
        [line(head), "|" + "|".join("-" * (w + 2) for w in widths) + "|", *map(line, lines)]
    )


def kind(row: Row) -> str:
    """Of leaks, which half: those who answer the error alone have nothing hidden."""
    if row["suite"] != "leaks":
        return ""
    return ", target too" if "effect" in row else ", error alone"


def worse(rows: list[Row]) -> str:
    """Of cases with a name: how often the named model is over 1 point below the baseline."""
    named = [r for r in rows if r["names"] and "vaf_baseline" in r]
    return share([{"w": r["vaf_named"] < r["vaf_baseline"] - 1.0} for r in named], "w")


def worst(rows: list[Row]) -> str:
    """The least fresh VAF of a named model."""
    return f"{min(r['vaf_named'] for r in rows):.3g}"


ELEMENT_COLUMNS: dict[str, Callable[[list[Row]], str]] = {
    "n": lambda rows: str(len(rows)),
    "false names": lambda rows: share(rows, "false_names"),
    "unknown": lambda rows: share(rows, "unknown"),
    "inverse": lambda rows: share(rows, "leak"),
    "median abs tau error": lambda rows: median(rows, "tau_error", size=True),
    "tau bias": lambda rows: median(rows, "tau_error"),
    "tau covered": lambda rows: share(rows, "tau_covered"),
    "VAF base": lambda rows: median(rows, "vaf_baseline"),
    "VAF named": lambda rows: median(rows, "vaf_named"),
    "VAF truth": lambda rows: median(rows, "coherent"),
    "worst VAF": worst,
    "named below base": worse,
}


def by_element(rows: list[Row]) -> str:
    """False names, delay and fresh VAF; one row per element."""
    every = groups([{**r, "what": f"{r['suite']}{kind(r)}"} for r in rows], "what", "element")
    if len(every) > 1:
        every[("all", "")] = rows
    lines = [
        [*key, *(cell(some) for cell in ELEMENT_COLUMNS.values())] for key, some in every.items()
    ]
    return grid(["suite", "element", *ELEMENT_COLUMNS], lines)


def by_effect(rows: list[Row], *keys: str) -> str:
    """Right names; one row per effect, strength, place or element."""
    head = [
        *keys,
        "n",
        "right",
        "exact",
        "any right",
        "both of a pair",
        "false second names",
        "fresh VAF gained",
        "said instead",
    ]
    lines = []
    every = groups(rows, *keys)
    if len(every) > 1:
        every[("all", *[""] * (len(keys) - 1))] = rows
    for key, some in every.items():
        gained = [{"g": r["vaf_named"] - r["vaf_baseline"]} for r in some if "vaf_baseline" in r]
        instead = [", ".join(r["names"]) or "none" for r in some if not r["right"]]
        said = "; ".join(sorted(set(instead))[:6]) if key[0] != "all" else ""
        lines.append(
            [
                *key,
                str(len(some)),
                share(some, "right"),
                share(some, "exact"),
                share(some, "right_any"),
                share(some, "both"),
                share(some, "false_names"),
                median(gained, "g"),
                said,
            ]
        )
    return grid(head, lines)


def by_offset(rows: list[Row]) -> str:
    """Names under a delay that the user gives, against those with a free one."""
    head = ["offset", "n", "same names", "same first name"]
    flat = [{"offset": int(k), **v} for r in rows for k, v in r.get("given", {}).items()]
    found = sorted({r["offset"] for r in flat})
    lines = [
        [f"{k:+d}", str(len(some)), share(some, "same"), share(some, "same_first")]
        for k in found
        if (some := [r for r in flat if r["offset"] == k])
    ]
    return grid(
        head, [*lines, ["all", str(len(flat)), share(flat, "same"), share(flat, "same_first")]]
    )


def report(rows: list[Row]) -> str:
    """Everything worth printing about these rows."""
    good = [r for r in rows if "error" not in r]
    parts = [by_element(good)] if good else []
    if hidden := [r for r in good if "right" in r]:
        parts += [
            by_effect(hidden, "effect"),
            by_effect(hidden, "strength"),
            by_effect(hidden, "element"),
        ]
    if any("given" in r for r in good):
        parts.append(by_offset(good))
    failed = [
        f"seed {r['seed']} on {r.get('drawn_for', '')}: {r['error']}" for r in rows if "error" in r
    ]
    if failed:
        parts.append(f"{len(failed)} failed:\n" + "\n".join(failed))
    return "\n\n".join(parts)
