"""docs/contributing.md is true: its drawing, its rooms, its paths and its commands."""

import re
import tomllib

import pytest
from support.places import ROOT

PAGE = (ROOT / "docs" / "contributing.md").read_text(encoding="utf-8")
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CONTRACTS = SETTINGS["tool"]["importlinter"]["contracts"]
[CONTRACT] = [contract for contract in CONTRACTS if contract["type"] == "layers"]

# What a reader is to fill in, and what a build makes.
MADE_UP = ("docs/_build/", "tests/browser/node_modules")


def drawing():
    [text] = re.findall(r"## The house\n.*?```text\n(.*?)```", PAGE, flags=re.S)
    return [line.split("(")[0].strip() for line in text.splitlines()]


def rooms():
    """Folders and modules of the package; a folder that holds bytecode alone is none."""
    folders = {path.parent.name for path in (ROOT / "skhoid").glob("*/__init__.py")}
    modules = {path.stem for path in (ROOT / "skhoid").glob("*.py")}
    return (folders | modules) - {"__init__", "__main__"}


def test_drawing_is_the_contract_that_the_linter_keeps():
    assert drawing() == CONTRACT["layers"]


def test_every_room_is_drawn_and_has_its_line():
    drawn = [room for row in drawing() for room in row.split(" | ")]
    [table] = re.findall(
        r"\| room \| open it for \|\n\| --- \| --- \|\n(.*?)\n\n", PAGE, flags=re.S
    )
    told = [re.match(r"\| `(\w+)` \| \S", line)[1] for line in table.splitlines()]
    assert sorted(drawn) == sorted(rooms())
    assert told == drawn


def test_what_shows_results_is_the_one_exception():
    assert CONTRACT["ignore_imports"]
    shows = (" -> skhoid.plotting", " -> skhoid.lab.explore")
    assert all(any(one in ignored for one in shows) for ignored in CONTRACT["ignore_imports"])


def test_paths_are_there():
    named = re.findall(
        r"(?<![\w/])(?:skhoid|tests|tools|docs|benchmarks|examples)/[\w./*<>-]*", PAGE
    )
    assert len(named) > 30
    for name in {name.rstrip(".") for name in named}:
        if "<" in name or name.startswith(MADE_UP):
            continue
        assert list(ROOT.glob(name.rstrip("/"))), name


@pytest.mark.parametrize("block", re.findall(r"```sh\n(.*?)```", PAGE, flags=re.S))
def test_commands_are_installed_by_what_the_page_says(block):
    """Programs come with the extras that the page installs, or with the system."""
    extras = SETTINGS["project"]["optional-dependencies"]
    installed = " ".join(
        requirement for name in ("test", "lint", "docs", "browser") for requirement in extras[name]
    )
    comes_with = {
        "pytest": "pytest", "ruff": "ruff", "mypy": "mypy", "codespell": "codespell",
        "lint-imports": "import-linter", "sphinx-build": "sphinx",
    }  # fmt: skip
    with_python = {"python", "python3", "pip", ".", "apt-get", "npm", ".ci/run"}
    for line in block.splitlines():
        program = re.sub(r"^(\w+=\S+ )*", "", line).split()[0]
        if program not in with_python and program != "coverage":  # which the page installs
            assert comes_with[program] in installed, line
