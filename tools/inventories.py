"""Write docs/_inventories: where other projects document the names that ours refers to.

    python tools/inventories.py            # write the files
    python tools/inventories.py --check    # compare them with the projects' own (needs a network)

The documentation is built without a network, so the few names that it links to other projects
(types of parameters, above all) and their addresses stand here, and not in inventories of 100 kB
that are fetched at each build.
"""

import argparse
import re
import sys
import zlib
from pathlib import Path
from urllib.request import urlopen

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "_inventories"
SITES = {
    "python": "https://docs.python.org/3/",
    "numpy": "https://numpy.org/doc/stable/",
    "scipy": "https://docs.scipy.org/doc/scipy/",
    "pandas": "https://pandas.pydata.org/docs/",
    "sklearn": "https://scikit-learn.org/stable/",
    "matplotlib": "https://matplotlib.org/stable/",
}
Entry = tuple[str, str, str]  # name, role, address below the site


def of_autosummary(folder: str, **names: str) -> list[Entry]:
    """Pages named after what they document, as autosummary makes them: one role, its names."""
    return [
        (name, f"py:{role}", f"{folder}/{name}.html#{name}")
        for role, listed in names.items()
        for name in listed.split()
    ]


def of_library(page: str, **names: str) -> list[Entry]:
    """Names on a page of Python's library."""
    return [
        (name, f"py:{role}", f"library/{page}.html#{name}")
        for role, listed in names.items()
        for name in listed.split()
    ]


def terms(*names: str) -> list[Entry]:
    return [(name, "std:term", f"glossary.html#term-{name.replace(' ', '-')}") for name in names]


NAMES: dict[str, list[Entry]] = {  # $ in an address: the name
    "python": [
        *of_library("stdtypes", **{"class": "str list tuple dict set"}),
        *of_library("functions", function="callable", **{"class": "int float bool"}),
        *of_library("constants", data="None True False"),
        *of_library("pathlib", **{"class": "pathlib.Path"}),
        ("bltin-boolean-values", "std:label", "library/stdtypes.html#bltin-boolean-values"),
        *terms("iterable", "sequence", "generator"),
    ],
    "numpy": [
        *of_autosummary("reference/generated", **{"class": "numpy.ndarray"}),
        ("numpy.random.Generator", "py:class", "reference/random/generator.html#$"),
        (
            "numpy.random.RandomState",
            "py:class",
            "reference/random/legacy.html#numpy.random.RandomState",
        ),
        *of_autosummary(
            "reference/random/bit_generators/generated", **{"class": "numpy.random.SeedSequence"}
        ),
        *terms("array_like"),
        ("arrays.scalars", "std:label", "reference/arrays.scalars.html#arrays-scalars"),
    ],
    "scipy": of_autosummary(
        "reference/generated",
        function="scipy.signal.decimate scipy.signal.resample_poly scipy.signal.lsim",
        **{"class": "scipy.signal.TransferFunction scipy.signal.StateSpace"},
    ),
    "pandas": of_autosummary(
        "reference/api",
        function="pandas.read_csv",
        **{"class": "pandas.DataFrame pandas.Series pandas.MultiIndex pandas.Index"},
    ),
    "sklearn": of_autosummary(
        "modules/generated",
        function="sklearn.base.clone sklearn.model_selection.cross_val_score"
        " sklearn.model_selection.cross_val_predict sklearn.pipeline.make_pipeline",
        **{
            "class": "sklearn.base.BaseEstimator sklearn.pipeline.Pipeline"
            " sklearn.model_selection.GridSearchCV sklearn.model_selection.LeaveOneGroupOut"
        },
    ),
    "matplotlib": [
        ("matplotlib.axes.Axes", "py:class", "api/_as_gen/matplotlib.axes.Axes.html#$"),
        ("matplotlib.axes.Axes.bxp", "py:method", "api/_as_gen/matplotlib.axes.Axes.bxp.html#$"),
        ("matplotlib.figure.Figure", "py:class", "api/_as_gen/matplotlib.figure.Figure.html#$"),
    ],
}


def whole(name: str, address: str) -> str:
    """The address with the name in place of the $ that abbreviates it."""
    return address.removesuffix("$") + name if address.endswith("$") else address


def inventory(project: str, entries: list[Entry]) -> bytes:
    """A file as intersphinx reads it."""
    head = f"# Sphinx inventory version 2\n# Project: {project}\n# Version: \n"
    head += "# The remainder of this file is compressed using zlib.\n"
    lines = [f"{name} {role} 1 {address} -\n" for name, role, address in sorted(entries)]
    return head.encode() + zlib.compress("".join(lines).encode(), 9)


def read(content: bytes) -> dict[tuple[str, str], str]:
    """Addresses by name and role."""
    *_, packed = content.split(b"\n", 4)
    found = re.findall(r"^(.+?) (\S+) -?\d+ (\S*) .*$", zlib.decompress(packed).decode(), re.M)
    return {(name, role): whole(name, address) for name, role, address in found}


def differences(source: str) -> list[str]:
    """What the projects' own inventories, at their sites or in a folder, say otherwise."""
    found = []
    for project, entries in NAMES.items():
        place = Path(source, f"{project}.inv").resolve().as_uri() if source else ""
        with urlopen(place or SITES[project] + "objects.inv", timeout=30) as answer:
            theirs = read(answer.read())
        found += [
            f"{project}: {name} ({role}) is at {theirs.get((name, role))}, not {address}"
            for name, role, address in entries
            if theirs.get((name, role)) != whole(name, address)
        ]
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--check", nargs="?", const="", metavar="FOLDER", help="compare (FOLDER/<project>.inv)"
    )
    arguments = parser.parse_args()
    if arguments.check is not None:
        wrong = differences(arguments.check)
        sys.exit("\n".join(wrong) or None)
    FOLDER.mkdir(exist_ok=True)
    for project, entries in NAMES.items():
        (FOLDER / f"{project}.inv").write_bytes(inventory(project, entries))
