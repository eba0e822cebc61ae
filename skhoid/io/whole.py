"""Writing files so that they are either whole or not there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

__all__ = ["is_left_over", "written_whole"]


@contextmanager
def written_whole(path: str | Path, *, sync: bool = False) -> Iterator[Path]:
    """Give a hidden name beside ``path`` to write to, and move what was written to ``path``.

    After an error ``path`` is as it was, and nothing is left beside it. With ``sync`` the file is
    on the disk before it is moved.
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; name a file in it.")
    if path.exists() and not path.is_file():
        raise OSError(f"{path} is no ordinary file, and is not replaced.")  # a device, a pipe
    # Writers look at the last ending, or at two (.csv.gz).
    aside = path.with_name(f".{token_hex(8)}.tmp{''.join(path.suffixes[-2:])}")
    try:
        yield aside
        if sync:
            with open(aside, "rb+") as file:
                os.fsync(file.fileno())
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def is_left_over(path: Path) -> bool:
    """Whether a file was left by a process that was killed while it wrote."""
    return path.name.startswith(".") and ".tmp" in path.suffixes
