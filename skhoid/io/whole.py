"""Writing files so that they are either complete or absent."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

__all__ = ["failing_as", "is_left_over", "written_whole"]


@contextmanager
def written_whole(path: str | Path, *, sync: bool = False) -> Iterator[Path]:
    """Give a hidden name in the folder of ``path`` to write to, and move the result to ``path``.

    After an error ``path`` is unchanged, and nothing else is left behind. A symbolic link is
    followed: its target is replaced. With ``sync`` the file is on the disk before it is moved.
    """
    path = Path(os.path.realpath(path))
    if path.is_symlink():
        raise OSError(f"{path} is a link to itself.")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; name a file in it.")
    if path.exists() and not path.is_file():
        raise OSError(f"{path} is not a regular file and is not replaced.")  # a device, a pipe
    # Writers look at the last ending, or at two (.csv.gz).
    aside = path.with_name(f".{token_hex(8)}.tmp{''.join(path.suffixes[-2:])}")
    try:
        with failing_as(path):
            yield aside
            if sync:
                with open(aside, "rb+") as file:
                    os.fsync(file.fileno())
            aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


@contextmanager
def failing_as(path: Path) -> Iterator[None]:
    """Let disk errors name the intended file, not the hidden one or none."""
    try:
        yield
    except OSError as error:
        named = error.filename is not None and not is_left_over(Path(error.filename))
        if named or error.errno is None:
            raise
        raise OSError(error.errno, os.strerror(error.errno), os.fspath(path)) from error


def is_left_over(path: Path) -> bool:
    """Whether a file was left by a process that was killed while writing it."""
    return path.name.startswith(".") and ".tmp" in path.suffixes
