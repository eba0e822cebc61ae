"""Where tests live: beside the module that each tests, helpers in one place, no file too long."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.places import ROOT

TESTS = ROOT / "tests"
PACKAGE = ROOT / "skhoid"
LONGEST = 600  # lines
ELSEWHERE = {
    "house": "rules of the whole house",
    "facts": "the thesis's numbers",
    "browser": "what only a real browser shows",
}
SOURCES = sorted(p for top in (TESTS, PACKAGE) for p in top.rglob("*.py"))
FILES = [p.relative_to(TESTS) for p in SOURCES if p.is_relative_to(TESTS)]
NOT_OURS = {Path("montecarlo/data")}  # a study's folder, as a user keeps it


def named(paths):
    return [pytest.param(p, id=str(p)) for p in paths]


def tested_by(file: Path) -> list[Path]:
    """What tests/<folder>/test_<words>.py may test: the module of its first words, or its folder."""
    source = TESTS if file.parent.name == "support" else PACKAGE
    words = file.stem.removeprefix("test_").split("_")
    starts = ["_".join(words[:n]) for n in range(1, len(words) + 1)]
    folder = source / file.parent
    modules = [folder / f"{prefix}{start}.py" for start in starts for prefix in ("", "_")]
    packages = [folder.parent / s / "__init__.py" for s in starts if s == folder.name]
    return [path for path in modules + packages if path.exists()]


@pytest.mark.parametrize(
    "file", named(f for f in FILES if f.name.startswith("test_") and f.parts[0] not in ELSEWHERE)
)
def test_each_file_belongs_to_a_module(file):
    assert tested_by(file), (
        f"tests/{file} tests no module: name it test_<module>.py or test_<module>_<aspect>.py, in "
        "the folder of the module, or after the package itself"
    )


def test_helpers_stand_in_support():
    known = ("test_*.py", "conftest.py")
    helpers = [f for f in FILES if not any(f.match(name) for name in known)]
    assert {f.parent for f in helpers if not any(f.is_relative_to(d) for d in NOT_OURS)} == {
        Path("support")
    }


@pytest.mark.parametrize("path", named(p.relative_to(ROOT) for p in SOURCES))
def test_no_file_is_too_long(path):
    lines = len((ROOT / path).read_text(encoding="utf-8").splitlines())
    assert lines <= LONGEST, f"{path} has {lines} lines; split it by theme"
