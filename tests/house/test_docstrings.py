"""What is documented is what is there: every public object against numpydoc."""

import inspect
import re
from enum import Enum
from importlib import import_module

from numpydoc.docscrape import FunctionDoc
from support.places import ROOT

import skhoid

PUBLIC_MODULES = [
    "skhoid",
    "skhoid.diagnosis",
    "skhoid.effects",
    "skhoid.exceptions",
    "skhoid.lab.experiment",
    "skhoid.human",
    "skhoid.interpret",
    "skhoid.io",
    "skhoid.lab.studies",
    "skhoid.plotting",
    "skhoid.recordings",
    "skhoid.lab.report",
    "skhoid.search",
    "skhoid.simulation",
    "skhoid.testing",
]


def is_documented_kind(obj):
    return inspect.isclass(obj) or inspect.isroutine(obj)


def public_objects():
    found = {}
    for module_name in PUBLIC_MODULES:
        module = import_module(module_name)
        for name in module.__all__:
            obj = getattr(module, name)
            if is_documented_kind(obj):
                found.setdefault(id(obj), (f"{module_name}.{name}", obj))
    return dict(found.values())


def public_methods():
    found = {}
    for class_name, cls in OBJECTS.items():
        if not inspect.isclass(cls):
            continue
        for name, method in inspect.getmembers(cls, inspect.isroutine):
            written_here = (getattr(method, "__module__", None) or "").startswith("skhoid")
            called = hasattr(method, "__qualname__")  # 3.13: a cached_property is a routine
            if written_here and called and not name.startswith("_"):
                found.setdefault(
                    f"{method.__module__}.{method.__qualname__}", (f"{class_name}.{name}", method)
                )
    return dict(found.values())


OBJECTS = public_objects()
METHODS = public_methods()
# The hooks of an effect are told once, in docs/add-an-effect.md, not in each effect.
METHODS_CALLED = {
    name: obj for name, obj in METHODS.items() if not name.startswith("skhoid.effects.")
}
# An exception is raised, a protocol kept, a member of an enumeration named; none is called.
CALLABLES = {
    name: obj
    for name, obj in OBJECTS.items()
    if not (inspect.isclass(obj) and issubclass(obj, (BaseException, Enum)))
    and not getattr(obj, "_is_protocol", False)
}


def real_parameters(obj):
    names = list(inspect.signature(obj).parameters)
    is_unbound_method = inspect.isfunction(obj) and names[:1] == ["self"]
    return names[1:] if is_unbound_method else names


def documented_parameters(obj):
    return [
        name.strip().lstrip("*")
        for entry in FunctionDoc(obj)["Parameters"]
        for name in entry.name.split(",")
    ]


def test_summaries_are_one_line():
    wrong = {}
    for name, obj in (OBJECTS | METHODS).items():
        summary = FunctionDoc(obj)["Summary"]
        if len(summary) != 1 or not summary[0].strip().endswith("."):
            wrong[name] = summary
    assert wrong == {}, "a summary is one line that ends in a full stop"


def test_documented_parameters_are_the_real_ones():
    wrong = {
        name: (documented_parameters(obj), real_parameters(obj))
        for name, obj in (CALLABLES | METHODS_CALLED).items()
        if documented_parameters(obj) != real_parameters(obj)
    }
    assert wrong == {}


def test_everything_public_has_a_running_example():
    # That the examples run and are right, `--doctest-modules` tests.
    # What raises an exception stands in docs/troubleshooting.md.
    without = [
        name
        for name, obj in OBJECTS.items()
        if not (inspect.isclass(obj) and issubclass(obj, BaseException))
        and ">>> " not in "\n".join(FunctionDoc(obj)["Examples"])
    ]
    assert without == []


def test_the_package_tells_what_it_is_for():
    named = set(re.findall(r"`([\w.]+)`", skhoid.__doc__))
    told_elsewhere = {
        *skhoid.exceptions.__all__,
        "Comparison",
        "Finding",
        "RemnantEstimate",
        "Report",
    }
    assert set(skhoid.__all__) - told_elsewhere <= named
    for name in named - set(skhoid.__all__):
        assert name in {"X", "y", "run", "time"} or import_module(name)


def test_every_public_name_is_in_the_api_page():
    api_page = ROOT / "docs" / "api.md"
    words = api_page.read_text(encoding="utf-8").split()
    listed = {word.rpartition(".")[2] for word in words}
    listed |= set(skhoid.effects.catalogue()["class"])  # their cards are written by the build
    assert {name.rpartition(".")[2] for name in OBJECTS} <= listed
