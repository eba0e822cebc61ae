"""Functions are short and ask for little, wherever they stand."""

import ast
import re
from functools import cache

from support.places import ROOT

import skhoid

LONGEST = 120  # lines, the docstring among them
MOST = 10  # parameters, self among them; what users call may have more
# Compiled loops are in one piece: a cached kernel calls none of another file.
KERNELS = ROOT / "skhoid" / "_kernels"


@cache
def functions():
    """Every function of the package: its file, its class where it is a method, and its node."""
    found = []
    for path in sorted((ROOT / "skhoid").rglob("*.py")):
        if KERNELS not in path.parents:
            found += inside(path.relative_to(ROOT), ast.parse(path.read_text("utf-8")), None)
    return found


def inside(path, node, owner):
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            yield path, owner, child
        inner = child if isinstance(child, ast.ClassDef) else None
        yield from inside(path, child, inner)


def names_of_users():
    """What the API reference lists, and what the package exports."""
    text = (ROOT / "docs" / "api.md").read_text("utf-8")
    listed = re.findall(r"^   ([A-Za-z_][\w.]*)$", text, re.MULTILINE)
    return {name.rpartition(".")[2] for name in listed} | set(skhoid.__all__)


def parameters_of(function):
    a = function.args
    return [*a.posonlyargs, *a.args, *a.kwonlyargs, *(x for x in (a.vararg, a.kwarg) if x)]


def test_functions_are_short():
    too_long = [
        f"{path}:{node.lineno} {node.name} has {length} lines"
        for path, _, node in functions()
        if (length := node.end_lineno - node.lineno + 1) > LONGEST
    ]
    assert not too_long, "\n".join([f"longer than {LONGEST} lines; move steps out:", *too_long])


def test_functions_that_users_do_not_call_have_few_parameters():
    public = names_of_users()
    too_many = [
        f"{path}:{node.lineno} {node.name} has {len(parameters_of(node))} parameters"
        for path, owner, node in functions()
        if len(parameters_of(node)) > MOST
        and (owner.name if owner is not None else node.name) not in public
    ]
    assert not too_many, "\n".join(
        [f"more than {MOST} parameters; bundle those that belong together:", *too_many]
    )
