"""No code decides by reading words that were written for people: statuses and codes do."""

import ast
import re

from support.places import ROOT

READS = {"startswith", "endswith", "removeprefix", "removesuffix", "partition", "rpartition"}
READS |= {"split", "rsplit", "replace", "find", "index", "contains"}
WORDS = re.compile(r"[a-z]{2,} |: |; | [a-z]{2,}")
SENTENCE = re.compile(r"[a-z]{2,} [a-z]{2,} [a-z]{2,}")
# Text that is no sentence of ours: names of columns, labels of a plot, Python that was written.
ALLOWED = {
    "diagnosis/over_amplitude.py": "a quantity is a channel or its rate",
    "lab/report/plots.py": "labels of the artists of a plot",
    "plotting/tournament.py": "names of cells, made of their conditions",
}


def texts_in(node):
    return [
        part.value
        for part in ast.walk(node)
        if isinstance(part, ast.Constant) and isinstance(part.value, str)
    ]


def reads_words(node):
    """Whether a literal of words is looked for in a text, or compared with one."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        given = texts_in(node.args[0]) if node.func.attr in READS and node.args else []
        return any(WORDS.search(text) for text in given)
    if isinstance(node, ast.Compare):
        sides = [s for s in (node.left, *node.comparators) if not isinstance(s, ast.Call)]
        return any(SENTENCE.search(text) for side in sides for text in texts_in(side))
    return False


def test_no_sentence_is_read():
    found = {}
    for path in sorted((ROOT / "skhoid").rglob("*.py")):
        name = path.relative_to(ROOT / "skhoid").as_posix()
        if name.startswith("io/"):  # what others wrote in their files
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if reads_words(node):
                found.setdefault(name, []).append(f"line {node.lineno}: {ast.unparse(node)}")
    assert set(found) == set(ALLOWED), found
