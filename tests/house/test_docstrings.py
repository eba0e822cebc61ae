"""What is documented is what is there: every public object against numpydoc."""

import inspect
import re
from enum import Enum
from importlib import import_module

import pytest
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
            if written_here and not name.startswith("_"):
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


def each(objects):
    return pytest.mark.parametrize("obj", objects.values(), ids=objects.keys())


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


@each(OBJECTS | METHODS)
def test_summary_is_one_line(obj):
    summary = FunctionDoc(obj)["Summary"]
    assert len(summary) == 1, f"the summary must be one line, got {summary}"
    assert summary[0].strip().endswith("."), f"the summary must end in a full stop: {summary[0]!r}"


@each(CALLABLES | METHODS_CALLED)
def test_documented_parameters_are_the_real_ones(obj):
    assert documented_parameters(obj) == real_parameters(obj)


@each(OBJECTS)
def test_has_a_running_example(obj):
    # That the example runs and is right, `--doctest-modules` tests.
    examples = "\n".join(FunctionDoc(obj)["Examples"])
    assert ">>> " in examples, "the Examples section has no >>> line"


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
