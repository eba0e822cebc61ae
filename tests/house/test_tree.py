"""Where tests live: beside the module that each tests, helpers in one place, no file too long."""

from __future__ import annotations

from pathlib import Path

from support.places import ROOT

TESTS = ROOT / "tests"
PACKAGE = ROOT / "skhoid"
LONGEST = 600  # lines
ELSEWHERE = {
    "house": "rules of the whole house",
    "facts": "the thesis's numbers",
    "fuzz": "hostile input for all public doors",
    "browser": "what only a real browser shows",
}
SOURCES = sorted(p for top in (TESTS, PACKAGE) for p in top.rglob("*.py"))
FILES = [p.relative_to(TESTS) for p in SOURCES if p.is_relative_to(TESTS)]
NOT_OURS = {Path("montecarlo/data")}  # a study's folder, as a user keeps it


def modules_of(file: Path) -> list[Path]:
    """What tests/<folder>/test_<words>.py may test: a module of its first words, or the folder."""
    source = TESTS if file.parent.name == "support" else PACKAGE
    words = file.stem.removeprefix("test_").split("_")
    starts = ["_".join(words[:n]) for n in range(1, len(words) + 1)]
    folder = source / file.parent
    modules = [folder / f"{prefix}{start}.py" for start in starts for prefix in ("", "_")]
    packages = [folder.parent / s / "__init__.py" for s in starts if s == folder.name]
    return [path for path in modules + packages if path.exists()]


def test_each_file_belongs_to_a_module():
    """Else name it test_<module>.py or test_<module>_<aspect>.py, beside the module's folder."""
    files = [f for f in FILES if f.name.startswith("test_") and f.parts[0] not in ELSEWHERE]
    assert files
    assert [str(f) for f in files if not modules_of(f)] == []


def test_helpers_stand_in_support():
    helpers = [f for f in FILES if not (f.name.startswith("test_") or f.name == "conftest.py")]
    folders = {f.parent for f in helpers if not any(f.is_relative_to(d) for d in NOT_OURS)}
    assert folders == {Path("support")}


def test_no_file_is_too_long():
    """Else split it by theme."""
    lines = {str(p.relative_to(ROOT)): len(p.read_text("utf-8").splitlines()) for p in SOURCES}
    assert {path: n for path, n in lines.items() if n > LONGEST} == {}
