"""Run a suite of the second blind trial and print its table.

    python -m benchmarks.second.run --suite null --element 1/s --cases 40 --seed 1 --out null.jsonl

Results are appended to ``--out`` case by case; what stands there is not run again. ``--table``
prints files only.
"""

import argparse
import importlib
import json
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from . import elements
from .cases import DRAWN, OFFSETS, SUITES, build
from .judge import given_delays, judge
from .tables import report

Key = tuple[str, str, int]


def arguments(argv: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.second.run",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--suite", choices=SUITES, default="null")
    parser.add_argument(
        "--element",
        default="",
        help=f"one of {elements.NAMES}, 'all' or 'drawn'; default: all for null, else drawn",
    )
    parser.add_argument("--cases", type=int, default=8, help="cases of each element named")
    parser.add_argument(
        "--seed",
        type=int,
        default=1,
        help="of the first case; 1,000,000 and above are for verdicts only",
    )
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, help="JSONL to append to and to resume from")
    parser.add_argument(
        "--who",
        default="judge:product",
        help="module:function, or oracle, deaf, inverse; judge:untold is a user without an element",
    )
    parser.add_argument(
        "--offsets", default=",".join(map(str, OFFSETS)), help="samples, of suite given_delay"
    )
    parser.add_argument("--log", action="store_true", help="a line per case")
    parser.add_argument(
        "--table", nargs="+", type=Path, help="print the table of these files and stop"
    )
    return parser.parse_args(argv)


def wanted(args: argparse.Namespace) -> Iterator[Key]:
    """The cases asked for, elements by turns so that an early stop leaves a fair sample."""
    which = args.element or ("all" if args.suite == "null" else DRAWN)
    some = elements.NAMES[:2] if args.suite == "leaks" else elements.NAMES
    names = some if which == "all" else (which,)
    if which != DRAWN and not set(names) <= set(elements.NAMES):
        raise SystemExit(f"--element {which!r}: expected one of {elements.NAMES}, 'all' or 'drawn'")
    for seed in range(args.seed, args.seed + args.cases):
        for name in names:
            yield args.suite, name, seed


def chosen(text: str) -> Any:
    """The function named by --who."""
    module, _, name = text.rpartition(":")
    if "." not in module:
        module = f"benchmarks.second.{module or 'standins'}"
    return getattr(importlib.import_module(module), name)


def one(key: Key, who: str, offsets: tuple[int, ...]) -> dict[str, Any]:
    """Build and judge a case; an error becomes a row, since a search that breaks off is a result
    too.
    """
    suite, element, seed = key
    head = {"suite": suite, "drawn_for": element, "seed": seed, "who": who}
    try:
        case = build(suite, element, seed)
    except RuntimeError as reason:
        return head | {"error": f"not built: {reason}"}
    function = chosen(who)
    try:
        if suite == "given_delay":
            return head | given_delays(case, function, offsets)
        return head | judge(case, function, with_baseline="judge:" in who)
    except Exception as reason:
        last = traceback.extract_tb(reason.__traceback__)[-1]
        return head | {
            "error": f"{type(reason).__name__}: {reason} ({Path(last.filename).name}:{last.lineno})"
        }


def read(*paths: Path) -> list[dict[str, Any]]:
    """Rows of JSONL files; a last line cut off by a stop is left out."""
    rows = []
    for path in paths:
        for line in path.read_text().splitlines() if path.exists() else ():
            try:
                rows.append(json.loads(line))
            except json.JSONDecodeError:
                continue
    return rows


def line_of(row: dict[str, Any]) -> str:
    """One case in one line."""
    if "error" in row:
        return f"{row['suite']} {row['drawn_for']} {row['seed']}: {row['error']}"
    truth = "none"
    if "effect" in row:
        truth = f"{row['effect']}/{row['form']} at {row['place']} ({row['strength']}, {row['gap']})"
    mark = "right" if row.get("right", not row["false_names"]) else "WRONG"
    said = ", ".join(row["names"]) or "none"
    unknown = float("nan")
    return (
        f"{row['suite']} {row['element']} {row['seed']} {row['display']}: {truth} -> {said} "
        f"{mark}; "
        f"tau {row['tau']:.3f} {row.get('tau_error', unknown):+.3f}; "
        f"VAF {row.get('vaf_baseline', unknown):.1f} -> {row['vaf_named']:.1f} "
        f"of {row['coherent']:.1f}; inverse {row['r_inverse']:.2f} {row['r_disturbance']:.2f}; "
        f"{row['seconds']} s"
    )


def main(argv: list[str] | None = None) -> None:
    """Run what is not there yet and print the table."""
    args = arguments(argv)
    if args.table:
        print(report(read(*args.table)))
        return
    if args.seed >= 1_000_000:
        print("Seeds of a verdict: do not tune anything to what follows.")
    asked = list(wanted(args))
    rows = [r for r in read(args.out) if r["who"] == args.who] if args.out else []
    rows = [r for r in rows if (r["suite"], r["drawn_for"], r["seed"]) in set(asked)]
    done = {(r["suite"], r["drawn_for"], r["seed"]) for r in rows}
    offsets = tuple(int(k) for k in args.offsets.split(","))
    todo = [key for key in asked if key not in done]
    if args.jobs == 1:
        fresh = (one(key, args.who, offsets) for key in todo)
    else:
        from joblib import Parallel, delayed

        fresh = Parallel(args.jobs, return_as="generator_unordered")(
            delayed(one)(k, args.who, offsets) for k in todo
        )
    for row in fresh:
        rows.append(row)
        if args.out:
            with args.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
        if args.log:
            print(line_of(row), flush=True)
    print(report(rows))


if __name__ == "__main__":
    main()
