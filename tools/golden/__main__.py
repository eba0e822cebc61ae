"""Prove that a change of the package changes no number.

    python tools/golden              # compute everything again and compare
    python tools/golden --write      # store what is found
    python tools/golden --only arx   # a part, by the beginning of its name

Every item has the checksum of its bits and a few plain numbers. Bits depend on processor and
libraries: on others than those of the stored file the plain numbers are compared, within a
tolerance. Words (``text/...``) are apart from numbers (``bits/...``).
"""

import argparse
import sys
import time
from importlib import import_module
from pathlib import Path

import store
from cases import CASES, items_of
from threadpoolctl import threadpool_limits

for _path in sorted(Path(__file__).parent.glob("*_cases.py")):
    import_module(_path.stem)  # adds its cases

STORED = Path(__file__).parent.parent / "golden.json"


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python tools/golden",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--write", action="store_true", help="store what is found")
    parser.add_argument("--only", default="", metavar="PREFIX", help="items whose name begins so")
    parser.add_argument("--times", action="store_true", help="say how long each case takes")
    options = parser.parse_args()
    if not options.write and not STORED.exists():
        parser.error(f"{STORED} is not there; --write makes it")
    group, prefix = store.split(options.only)
    found: dict[str, list[str]] = {}
    broken: list[str] = []
    with threadpool_limits(1):
        for name in CASES:
            if not (name.startswith(prefix) or prefix.startswith(f"{name}/")):
                continue
            begun = time.perf_counter()
            try:
                found |= store.chosen(dict(items_of(name)), group, prefix)
            except Exception as error:
                if options.write:
                    raise
                broken.append(name)
                print(f"{name}: stopped by {type(error).__name__}: {error}")
            if options.times:
                print(f"{time.perf_counter() - begun:6.2f} s  {name}")
    if not (found or broken):
        rooms = ", ".join(dict.fromkeys(name.split("/")[0] for name in CASES))
        parser.error(f"no item begins with {options.only!r}; the first words are {rooms}")
    if options.write:
        return store.write(STORED, found, group, prefix)
    return store.compare(STORED, found, group, prefix, broken)


if __name__ == "__main__":
    sys.exit(main())
