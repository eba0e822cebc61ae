"""The page on troubleshooting quotes messages that skhoid has, word for word."""

import ast
import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow  # makes each trouble

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
MESSAGES = re.findall(r"^\| `([^`]+)` \| ", PAGE, flags=re.MULTILINE)


def texts() -> str:
    """All texts of the package, one a line, with … for what is filled in."""
    found = []
    for path in sorted((ROOT / "skhoid").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        found += [_text(node) for node in ast.walk(tree)]
    return "\n".join(text.replace("\n", " ") for text in found if text)


def _text(node: ast.AST) -> str:
    """Of a node and, of a sum of texts, of all of them."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(_text(part) or "…" for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return (_text(node.left) or "…") + (_text(node.right) or "…")
    return ""


@pytest.fixture(scope="module")
def package() -> str:
    return texts()


def test_there_are_messages():
    assert len(MESSAGES) > 30


@pytest.mark.parametrize("message", MESSAGES)
def test_message_is_one_of_the_package(message, package):
    parts = [re.escape(part.strip()) for part in message.split("…") if part.strip()]
    assert re.search(r"[^\n]*".join(parts), package), "no such message: correct the page"
