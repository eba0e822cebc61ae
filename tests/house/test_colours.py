"""Colours have one home: skhoid/plotting/_roles.py."""

import ast
from pathlib import Path

import pytest
from matplotlib.colors import CSS4_COLORS, is_color_like

import skhoid

ROOT = Path(skhoid.__file__).parent
PAGES = Path(__file__).parents[2]
FILES = [
    path
    for folder in (ROOT / "plotting", ROOT / "thesis", PAGES / "examples", PAGES / "docs")
    for path in sorted(folder.rglob("*.py"))
    if path.name != "_roles.py" and not {"_build", "gallery", "generated"} & set(path.parts)
]
KEYWORDS = ("color", "colour", "facecolor", "edgecolor", "markeredgecolor", "colors", "mec", "mfc")


def literals(tree):
    """Strings that name a colour by themselves, or where a colour is expected."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            word = node.value
            if (word.startswith("#") and is_color_like(word)) or word.lower() in CSS4_COLORS:
                yield node
        pairs = []
        if isinstance(node, ast.Call):
            pairs = [(k.arg, k.value) for k in node.keywords]
        elif isinstance(node, ast.Dict):
            pairs = [
                (k.value, v)
                for k, v in zip(node.keys, node.values, strict=True)
                if isinstance(k, ast.Constant)
            ]
        for name, value in pairs:
            if name in KEYWORDS and isinstance(value, ast.Constant) and value.value != "none":
                yield value


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_nothing_else_names_a_colour(path):
    found = [
        f"line {node.lineno}: {node.value!r}" for node in literals(ast.parse(path.read_text()))
    ]
    assert found == []
