"""The stored file, and the comparison with it."""

import hashlib
import json
import platform
import re
from importlib.metadata import version
from pathlib import Path

LIBRARIES = ("numpy", "scipy", "numba", "pandas", "scikit-learn")
GROUPS = ("bits/", "text/")
# How far plain numbers may be off on another platform, relative to the largest of them: by the
# first pattern that the name of an item begins with.
TOLERANCES = (
    (r"bits/effects/(.*that has it|root_flow/arx)", 0.1),  # flat optima in so short a run
    (r"bits/(compare|displays|effect|experiment|greybox|remnant|study)", 1e-3),  # optimisers
    (r"bits/", 1e-6),
)


def split(name: str) -> tuple[str, str]:
    """The group of an item, if the name has one, and the rest."""
    group = next((group for group in GROUPS if name.startswith(group)), "")
    return group, name.removeprefix(group)


def here() -> dict[str, str]:
    """What bits depend on: processor and libraries."""
    processor = Path("/proc/cpuinfo")
    text = processor.read_text() if processor.exists() else platform.processor()
    model = re.search(r"model name\s*:\s*(.*)", text)
    flags = re.search(r"(?:flags|Features)\s*:\s*(.*)", text)
    known = " ".join(sorted(flags[1].split())) if flags else text
    return {
        "processor": f"{platform.machine()} {model[1] if model else platform.processor()}",
        "flags": hashlib.sha256(known.encode()).hexdigest()[:16],
        **{library: version(library) for library in LIBRARIES},
    }


def chosen(items: dict[str, list[str]], group: str, prefix: str) -> dict[str, list[str]]:
    return {
        name: values
        for name, values in items.items()
        if name.startswith(group) and split(name)[1].startswith(prefix)
    }


def write(path: Path, found: dict[str, list[str]], group: str, prefix: str) -> int:
    """Store items in place of those that are compared with them."""
    platform_here = here()
    items: dict[str, list[str]] = {}
    if (group or prefix) and path.exists():
        stored = json.loads(path.read_text())
        if stored["platform"] != platform_here:
            print("A part cannot be written beside items of another platform; write all of it.")
            return 1
        items = stored["items"]
        items = {k: v for k, v in items.items() if k not in chosen(items, group, prefix)}
    items |= found
    lines = [f"  {json.dumps(name)}: {json.dumps(items[name])}" for name in sorted(items)]
    head = json.dumps(platform_here, indent=1)
    path.write_text(f'{{"platform": {head},\n"items": {{\n' + ",\n".join(lines) + "\n}}\n")
    print(f"{len(found)} items written to {path}.")
    return 0


def compare(
    path: Path, found: dict[str, list[str]], group: str, prefix: str, broken: list[str]
) -> int:
    """Print what differs from the stored items; 1 if anything does, or a case is broken."""
    stored = json.loads(path.read_text())
    there, wanted = stored["platform"], chosen(stored["items"], group, prefix)
    other = [name for name, value in here().items() if there.get(name) != value]
    same = (lambda *_: False) if not other else close
    stopped = tuple(f"{group}{name}/" for group in GROUPS for name in broken)
    failed = noted = 0
    for name in sorted(wanted.keys() | found.keys()):
        one, two = wanted.get(name), found.get(name)
        if name.startswith(stopped):
            continue
        if one == two or (one and two and same(name, one, two)):
            continue
        note = bool(other) and name.startswith("text/")
        noted, failed = noted + note, failed + (not note)
        print(f"{'note: ' if note else ''}{name}: stored {told(one)}, found {told(two)}")
    how = f"plain numbers compared, as {', '.join(other)} differ" if other else "bits compared"
    notes = f", {noted} of another wording" if noted else ""
    stops = f", {len(broken)} cases stopped" if broken else ""
    print(f"{len(found)} items, {failed} differ{notes}{stops} ({how}).")
    return int(failed > 0 or bool(broken))


def close(name: str, one: list[str], two: list[str]) -> bool:
    """Whether the plain numbers of an item agree within its tolerance."""
    a, b = ([float(number) for number in values[1:]] for values in (one, two))
    if name.startswith("text/") or len(a) != len(b):
        return False
    scale = max((abs(number) for number in a), default=0.0)
    tolerance = next(share for pattern, share in TOLERANCES if re.match(pattern, name))
    return all(abs(p - q) <= tolerance * scale for p, q in zip(a, b, strict=True))


def told(values: list[str] | None) -> str:
    """The beginning of the checksum, and the plain numbers."""
    return "nothing" if values is None else f"{values[0][:8]} ({', '.join(values[1:])})"
