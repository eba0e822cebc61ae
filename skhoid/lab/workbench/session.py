"""The folder of a session: files that were uploaded, what is kept in JSON, reports, and a lock."""

from __future__ import annotations

import hashlib
import json
import os
import re
import unicodedata
from collections.abc import Container
from pathlib import Path
from typing import Any

from ... import __version__
from ...io import READERS, written_whole

VERSION = 1
FILE = "session.json"
SEARCH = "search.json"
LONGEST_NAME = 80  # characters before the ending


class SessionInUse(ValueError):
    """Another server works on this session."""


class BrokenSession(ValueError):
    """``session.json`` is not what was written."""


class NotSaved(ValueError):
    """Something could not be written, and nothing half-written is left."""


class SessionFolder:
    """The folder of a session, held by one server at a time."""

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path).absolute()
        self._lock: Any = None
        self.kept = False  # whether there is a session in it that is not to be overwritten

    @property
    def uploads(self) -> Path:
        """Where files that were uploaded lie."""
        return self.path / "files"

    def take(self) -> None:
        """Lock the folder; a lock whose server is gone is taken over."""
        if self.path.exists() and not self.path.is_dir():
            raise ValueError(f"{self.path} is a file; name a folder by --session.")
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            file = open(self.path / "lock", "a+", encoding="utf-8")  # noqa: SIM115
        except OSError as error:
            raise OSError(
                error.errno,
                f"the session cannot be kept there ({error.strerror}); name another folder by "
                "--session",
                str(self.path),
            ) from error
        if not _locked(file):
            file.seek(0)
            owner = file.read().strip() or "unknown"
            file.close()
            raise SessionInUse(
                f"The session {self.path} is open in another workbench (process {owner}): use "
                "that one, end it, or name another folder by --session."
            )
        file.seek(0)
        file.truncate()
        file.write(f"{os.getpid()}\n")
        file.flush()
        self._lock = file

    def give_back(self) -> None:
        """Unlock the folder."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def load(self, name: str = FILE) -> dict[str, Any] | None:
        """What was kept; None where there is no session yet."""
        path = self.path / name
        try:
            text = path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError) as error:
            raise self._broken(path, str(error)) from error
        try:
            found = json.loads(text)
        except ValueError as error:
            raise self._broken(path, str(error)) from error
        if not isinstance(found, dict) or not isinstance(found.get("version"), int):
            raise self._broken(path, "it holds no version")
        if found["version"] > VERSION:
            raise self._broken(
                path, f"it is of version {found['version']}, of a newer skhoid than {__version__}"
            )
        self.kept = True
        return found

    def _broken(self, path: Path, why: str) -> BrokenSession:
        return BrokenSession(
            f"{path} cannot be read: {why}. It is left as it is. Name another folder by --session, "
            f"or move the file away to begin anew with the files in {self.uploads}."
        )

    def save(self, content: dict[str, Any], name: str = FILE) -> None:
        """Keep the session: the file is the old one or the new one, never half of it."""
        text = json.dumps({"version": VERSION, "skhoid": __version__, **content}, indent=1)
        self.path.mkdir(parents=True, exist_ok=True)
        with written_whole(self.path / name) as aside:
            aside.write_text(text, encoding="utf-8")
        self.kept = True

    def free(self, name: str, folder: Path | None = None) -> Path:
        """A path in the folder under a name that is not taken: report.html, report-2.html."""
        folder = self.path if folder is None else folder
        taken = set(os.listdir(folder)) if folder.is_dir() else set()
        return folder / free_name(name, taken)

    def report(self, name: str) -> Path | None:
        """A report of this session by its name; None if there is none."""
        is_ours = name.startswith("report") and name.endswith(".html")
        if not is_ours or not self.path.is_dir() or name not in os.listdir(self.path):
            return None
        path = self.path / name
        return path if path.is_file() and not path.is_symlink() else None


def make_digest(path: Path) -> dict[str, Any]:
    """Size and SHA-256 of a file, by which it is known again."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"size": path.stat().st_size, "sha256": digest}


def _locked(file: Any) -> bool:
    """Lock a file, which the system unlocks when the process ends, however it ends."""
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        try:
            file.seek(1 << 30)  # a byte that is not read
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError:
            return False
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def safe_name(name: str) -> str:
    """A name for a file in a folder of ours, with the ending of a format that can be read.

    Whatever looks like a folder is cut off, and what is no letter, digit or one of ``-_.`` becomes
    an underscore.
    """
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", name))[-1]
    stem, dot, ending = last.rpartition(".")
    suffix = f".{ending.lower()}"
    if not dot or suffix not in READERS:
        raise ValueError(
            f"{name[:LONGEST_NAME]!r} cannot be read: skhoid reads files that end in "
            f"{', '.join(READERS)}. Save it in one of these formats, such as CSV."
        )
    stem = re.sub(r"[^\w.-]+", "_", stem)[:LONGEST_NAME].strip("._-") or "file"
    return stem + suffix


def free_name(name: str, taken: Container[str]) -> str:
    """The name, or with a number: file-2.csv."""
    stem, _, ending = name.rpartition(".")
    free, number = name, 2
    while free in taken:
        free, number = f"{stem}-{number}.{ending}", number + 1
    return free
