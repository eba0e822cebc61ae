"""Draws the pictures of a page: ``python docs/draw.py docs/find-what-is-missing.md``.

Runs the page's Python blocks until all that it shows is there. Where the page shows
``_static/<page>-<name>.png``, the Display that it calls ``name`` is saved there, with twice the
pixels that it has on the page: sharp screens show them, and the build takes its size from the
resolution in the file.
"""

import re
import sys
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

page = Path(sys.argv[1])
text = page.read_text(encoding="utf-8")
blocks = re.findall(r"^```python\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
shown = re.findall(rf"_static/{page.stem}-(\w+)\.png", text)
variables: dict[str, Any] = {}
for block in blocks:
    if variables.keys() >= set(shown):
        break
    if not block.startswith(">>>"):
        exec(compile(block, str(page), "exec"), variables)
for name in shown:
    file = page.parent / "_static" / f"{page.stem}-{name}.png"
    variables[name].figure_.savefig(file, dpi=200, bbox_inches="tight", metadata={"Software": None})
    print(file)
