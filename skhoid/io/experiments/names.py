"""Subject, condition and run guessed from the names of folders and files."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .._paths import shown
from .levels import FIELDS, LEVELS, key_level, labelled

__all__ = ["UnclearNamesError", "levels_in_names", "names_guess"]

_SHOWN = 4  # labels in a message
_GLUED = re.compile(r"(?:[^\W\d_]{1,3}\d+){2,}")


class UnclearNamesError(ValueError):
    """Names of files do not say which part of them is the subject, the condition or the run."""


@dataclass(frozen=True)
class _Token:
    """A part of a name: ``before`` is the text since the last label, ``level`` "" if not said."""

    before: str
    label: str
    level: str


def names_guess(
    files: Sequence[Path], root: Path, wanted: Sequence[str]
) -> tuple[list[dict[str, str]], str]:
    """Labels of the files for the wanted levels, and the pattern of the first of them.

    Parts that are the same in all names and of no known key are no labels.
    """
    rows = [_tokens(path, root) for path in files]
    keyed = [_keyed(row, path) for row, path in zip(rows, files, strict=True)]
    open_rows = [[token for token in row if not token.level] for row in rows]
    counts = [len(row) for row in open_rows]
    usual = max(set(counts), key=counts.count)
    if len(set(counts)) > 1:
        odd = next(k for k, count in enumerate(counts) if count != usual)
        fine = counts.index(usual)
        alike = [row for row in open_rows if len(row) == usual]
        varying = [k for k in range(usual) if len({row[k].label for row in alike}) > 1]
        said = {level for labels in keyed for level in labels}
        names = [level for level in LEVELS if level not in said]
        example = _example(root, rows[fine], dict(zip(varying, names, strict=False)), files[fine])
        raise UnclearNamesError(
            f"Names of files are built differently: {_relative(files[fine], root)!r} and "
            f"{_relative(files[odd], root)!r}. Give the pattern, such as {str(root / example)!r}, "
            "or a list of files."
        )
    varying = [k for k in range(usual) if len({row[k].label for row in open_rows}) > 1]
    known = {level for labels in keyed for level in labels}
    missing = [level for level in LEVELS if level in wanted and level not in known]
    given = _assign(varying, missing, open_rows, usual, bool(known))
    if given is None:
        raise _unclear(files, root, rows, open_rows, varying, missing)
    labels = [
        {level: label for level, label in own.items() if level in wanted or level not in LEVELS}
        | {level: row[k].label for k, level in given.items()}
        for own, row in zip(keyed, open_rows, strict=True)
    ]
    return labels, _example(root, rows[0], given, files[0], wanted)


def levels_in_names(files: Sequence[Path], root: Path) -> set[str]:
    """Levels that the names of files say by a key, as ``sub-01`` does."""
    return {token.level for path in files for token in _tokens(path, root) if token.level}


def _assign(
    varying: list[int], missing: list[str], rows: list[list[_Token]], count: int, some_keyed: bool
) -> dict[int, str] | None:
    """Which of the varying parts is which level; None if that is not clear."""
    if not varying:
        return {}
    if len(varying) > len(missing):
        return None
    if len(varying) == len(missing):
        return dict(zip(varying, missing, strict=True))
    last_is_number = all(row[varying[-1]].label.isdecimal() for row in rows)
    if len(varying) == 2:  # of three levels
        return dict(
            zip(varying, ("subject", "run" if last_is_number else "condition"), strict=True)
        )
    if len(missing) == 2 and (some_keyed or "subject" not in missing):
        if "run" in missing and last_is_number:
            return {varying[0]: "run"}
        return {varying[0]: missing[0]} if not last_is_number else None
    alone = count == 1 and not last_is_number and "subject" in missing
    return {varying[0]: "subject"} if alone else None


def _tokens(path: Path, root: Path) -> list[_Token]:
    relative = _relative(path, root)
    stem = relative[: -len(path.suffix)] if path.suffix else relative
    found: list[_Token] = []
    before = ""
    for number, component in enumerate(stem.split("/")):
        before += "/" if number else ""
        for token in _of_component(component):
            found.append(_Token(before + token.before, token.label, token.level))
            before = ""
    return found


def _of_component(text: str) -> list[_Token]:
    pieces = re.split(r"([_\s]+)", text)
    found: list[_Token] = []
    before, position = "", 0
    while position < len(pieces):
        piece = pieces[position]
        separator = pieces[position + 1] if position + 1 < len(pieces) else ""
        following = pieces[position + 2] if position + 2 < len(pieces) else ""
        if piece and following.isdecimal() and piece.isalpha() and key_level(piece):
            found.append(_Token(before + piece + separator, following, key_level(piece)))
            position += 2
            separator = pieces[position + 1] if position + 1 < len(pieces) else ""
            before = separator
        elif piece:
            for token in _of_piece(piece):
                found.append(_Token(before + token.before, token.label, token.level))
                before = ""
            before = separator
        else:
            before += separator
        position += 2
    return found


def _of_piece(piece: str) -> list[_Token]:
    level, key, label = labelled(piece)
    glued = bool(_GLUED.fullmatch(piece))
    if level and (key or "-" not in piece) and (key.endswith(("-", "=")) or not glued):
        return [_Token(key, label, level)]
    if glued:
        parts = re.findall(r"[^\W\d_]+\d+", piece)
        if all(labelled(part)[0] for part in parts):
            return [_Token(labelled(p)[1], labelled(p)[2], labelled(p)[0]) for p in parts]
    found, before = [], ""
    for part in piece.split("-"):
        level, key, label = labelled(part) if part else ("", "", "")
        if part:
            found.append(_Token(before + key, label, level))
            before = ""
        before += "-"
    return found


def _keyed(row: list[_Token], path: Path) -> dict[str, str]:
    """Labels by their keys; a level that is named twice must have one label."""
    found: dict[str, str] = {}
    for token in row:
        if not token.level:
            continue
        other = found.setdefault(token.level, token.label)
        if other != token.label:
            raise UnclearNamesError(
                f"The name of {shown(path)} gives two labels of the {token.level}, {other!r} and "
                f"{token.label!r}: give the pattern with {{{token.level}}} where it is."
            )
    return found


def _relative(path: Path, root: Path) -> str:
    return os.path.relpath(path, root).replace(os.sep, "/")


def _example(
    root: Path,
    row: list[_Token],
    given: dict[int, str],
    path: Path,
    wanted: Sequence[str] = FIELDS,
) -> str:
    """The pattern that the tokens of a file stand for."""
    text, position = "", 0
    for token in row:
        level = token.level if token.level in wanted or token.level not in LEVELS else ""
        if not token.level:
            level = given.get(position, "")
            position += 1
        text += token.before + (f"{{{level}}}" if level else token.label)
    return f"{text}{path.suffix}"


def _unclear(
    files: Sequence[Path],
    root: Path,
    rows: list[list[_Token]],
    open_rows: list[list[_Token]],
    varying: list[int],
    missing: list[str],
) -> UnclearNamesError:
    seen = []
    for number, k in enumerate(varying, 1):
        labels = list(dict.fromkeys(row[k].label for row in open_rows))
        more = f" and {len(labels) - _SHOWN} more" if len(labels) > _SHOWN else ""
        seen.append(f"part {number} is {', '.join(map(repr, labels[:_SHOWN]))}{more}")
    names = (missing or list(LEVELS)) + ["*"] * len(varying)
    given = dict(zip(varying, names, strict=False))
    example = _example(root, rows[0], given, files[0]).replace("{*}", "*")
    what = " and ".join(missing) if missing else "subject, condition and run, which are known"
    return UnclearNamesError(
        f"Names of files, such as {_relative(files[0], root)!r}, do not say which part is the "
        f"{what}: {'; '.join(seen)}. Give the pattern, such as "
        f"{str(root / example)!r}."
    )
