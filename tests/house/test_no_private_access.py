"""Nobody reaches into the private attributes of another object."""

import ast
import re

from support.places import ROOT

PUBLIC_IN_SPITE_OF_THEIR_NAME = {
    "_kernels",  # a module of the package
    "_replace",  # of named tuples, documented
    "_fields",
    "_asdict",
    "_repr_html_",  # IPython's protocol
    "_parameter_constraints",  # scikit-learn's protocol
}
# Of other libraries, where there is no public way.
ALLOWED = {
    ("_sklearn.py", "_getframe"): "who asks for coef_; Python documents it",
    ("plotting/_display.py", "_left_title"): "Matplotlib gives the words, but not the artist",
    ("plotting/_display.py", "_suptitle"): "the same",
}

MAY_REACH = re.compile(r"(?<!\bself)(?<!\bcls)(?<!\bskhoid)\._[a-z]|attr\(")


def is_private(name):
    return name.startswith("_") and not name.startswith("__")


def is_own(node):
    """Whether it is the object itself: self, cls, mcs or super()."""
    if isinstance(node, ast.Call):
        node = node.func
        return isinstance(node, ast.Name) and node.id == "super"
    return isinstance(node, ast.Name) and node.id in {"self", "cls", "mcs"}


def made_in(cls):
    """Names that a class gives its instances: methods, fields, and what it sets of self."""
    made = set()
    for node in ast.walk(cls):
        if isinstance(node, ast.FunctionDef):
            made.add(node.name)
        elif not isinstance(getattr(node, "ctx", None), ast.Store):
            continue
        elif isinstance(node, ast.Name):
            made.add(node.id)
        elif isinstance(node, ast.Attribute) and is_own(node.value):
            made.add(node.attr)
    return made


def used(node):
    """Whose attribute an expression uses, and its name, also where that is a string."""
    if isinstance(node, ast.Attribute):
        yield node.value, node.attr
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        match node.args:
            case [whose, ast.Constant(value=str(name)), *_]:
                if node.func.id in {"getattr", "hasattr", "setattr", "delattr"}:
                    yield whose, name


def reached(node, own=frozenset()):
    """Private attributes of others that a tree uses; a class knows those of its instances."""
    if isinstance(node, ast.ClassDef):
        own = own | made_in(node)
    yield from (
        name
        for whose, name in used(node)
        if is_private(name) and not is_own(whose)
        if name not in own | PUBLIC_IN_SPITE_OF_THEIR_NAME
    )
    for child in ast.iter_child_nodes(node):
        yield from reached(child, own)


def test_no_private_attribute_of_another_object_is_used():
    package = ROOT / "skhoid"
    sources = {path: path.read_text(encoding="utf-8") for path in package.rglob("*.py")}
    found = {
        (path.relative_to(package).as_posix(), name)
        for path, source in sources.items()
        if MAY_REACH.search(source)  # parsing takes long
        for name in reached(ast.parse(source))
    }
    assert found == set(ALLOWED)
