"""Imports make no ring: not between two files, not between many, not by an import in a function.

The layers of whole folders are import-linter's matter; this is about files.
"""

import ast
import re
import tomllib
from functools import cache

import pytest
from support.places import ROOT

PACKAGE = ROOT / "skhoid"


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def stated_exceptions():
    """Pairs (importer, imported) that import-linter is told to ignore: results draw themselves."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]
    lines = [line for c in settings["contracts"] for line in c.get("ignore_imports", [])]
    return [tuple(side.strip() for side in line.split("->")) for line in lines]


EXCEPTIONS = stated_exceptions()


def is_exception(importer, imported):
    return any(
        re.fullmatch(a.replace(".", r"\.").replace("*", ".*"), importer)
        and re.fullmatch(b.replace(".", r"\.").replace("*", ".*"), imported)
        for a, b in EXCEPTIONS
    )


def statements(node, in_functions):
    """Import statements that run, without those for the type checker."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child
        elif isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            for other in child.orelse:
                yield from statements(other, in_functions)
        elif in_functions or not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from statements(child, in_functions)


def imported_by(name, in_functions):
    """Modules of the package that the file of one names in its imports."""
    path = FILES[name]
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in statements(ast.parse(path.read_text("utf-8")), in_functions):
        if isinstance(node, ast.Import):
            candidates = [alias.name for alias in node.names]
        else:
            above = package.split(".")[: len(package.split(".")) - node.level + 1]
            base = ".".join([*above, *([node.module] if node.module else [])])
            base = base if node.level else node.module
            inner = [f"{base}.{alias.name}" for alias in node.names]
            # What is no module of the package's is a name in one.
            candidates = [one if one in FILES else base for one in inner]
        yield from (one for one in candidates if one in FILES and one != name)


@cache
def graph(in_functions):
    return {
        name: sorted({o for o in imported_by(name, in_functions) if not is_exception(name, o)})
        for name in FILES
    }


def rings(imports):
    """Sets of modules each of which reaches all others, by Tarjan's algorithm."""
    number, lowest, stack, found = {}, {}, [], []

    def visit(name):
        number[name] = lowest[name] = len(number)
        stack.append(name)
        for other in imports[name]:
            if other not in number:
                visit(other)
                lowest[name] = min(lowest[name], lowest[other])
            elif other in stack:
                lowest[name] = min(lowest[name], number[other])
        if lowest[name] == number[name]:
            ring = [stack.pop()]
            while ring[-1] != name:
                ring.append(stack.pop())
            if len(ring) > 1:
                found.append(sorted(ring))

    for name in imports:
        if name not in number:
            visit(name)
    return found


def test_imports_of_a_small_package_are_found(tmp_path, monkeypatch):
    files = {
        "__init__": "from .one import f",
        "one": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from . import two",
        "two": "from .one import f\ndef g():\n    from . import three",
        "three": "import numpy\nfrom skhoid import two",
    }
    for name, text in files.items():
        (tmp_path / f"{name}.py").write_text(text)
    names = {f"skhoid.{name}".removesuffix(".__init__"): name for name in files}
    monkeypatch.setitem(globals(), "FILES", {k: tmp_path / f"{v}.py" for k, v in names.items()})
    found = {name: sorted(set(imported_by(name, True))) for name in names}
    assert found == {
        "skhoid": ["skhoid.one"],
        "skhoid.one": [],
        "skhoid.two": ["skhoid.one", "skhoid.three"],
        "skhoid.three": ["skhoid.two"],
    }
    assert rings(found) == [["skhoid.three", "skhoid.two"]]
    assert list(imported_by("skhoid.two", False)) == ["skhoid.one"]


@pytest.mark.slow
def test_no_two_files_import_each_other():
    imports = graph(in_functions=True)
    pairs = [
        f"{one} <-> {other}"
        for one, others in imports.items()
        for other in others
        if one < other and one in imports[other]
    ]
    assert not pairs, "\n".join(["these import each other; move what both need down:", *pairs])


@pytest.mark.slow
def test_no_ring_of_imports_at_the_top_of_files():
    found = [" -> ".join(ring) for ring in rings(graph(in_functions=False))]
    assert not found, "\n".join(["rings of imports:", *found])
