"""The files of an experiment, and the labels that their names give."""

from __future__ import annotations

import glob
import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...io.files import MOTION, expand_paths, find_files, shown
from .words import find_label

LEVELS = ("subject", "condition", "run")
FIELDS = ("subject", "session", "condition", "block", "run")  # a session is put before the run
_SHORT = {
    "s": "subject",
    "p": "subject",
    "pp": "subject",
    "vp": "subject",
    "sj": "subject",
    "c": "condition",
    "r": "run",
    "t": "run",
    "ses": "session",
}
_WORD = 3  # letters, from which on a key is a word of its own and no part of the label


def key_level(word: str) -> str:
    """The level that a word before a label names, as in ``sub-01``; "" for none."""
    return _SHORT.get(word.casefold(), "") or find_label(word)


def labelled(text: str) -> tuple[str, str, str]:
    """Level, text before the label, and label of ``S01``, ``run2`` or ``task-x``.

    The level is "" where the text does not say it, and then all of it is the label.
    """
    match = re.fullmatch(r"([^\W\d_]+)([-=_ ]?)(.+)", text)
    if match and (match[2] or match[3][0].isdigit()) and (level := key_level(match[1])):
        key = match[1] + match[2]
        return (level, key, match[3]) if match[2] or len(match[1]) >= _WORD else (level, "", text)
    return "", "", text


def natural(text: object) -> list[tuple[int, int, str]]:
    """A key by which run 2 comes before run 10."""
    parts = re.split(r"(\d+)", str(text))
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts if p]


_FIELD = re.compile(r"\{([^{}/\\]*)\}")
_SHOWN = 5  # files in a message


def has_fields(text: str) -> bool:
    """Whether a path is a pattern with named fields."""
    return bool(_FIELD.search(text)) and not os.path.exists(text)


class SomeFilesError(ValueError):
    """A pattern matches some of the files that are there, and nobody said that these are meant."""


def match_pattern(text: str, *, some: bool) -> tuple[list[Path], list[dict[str, str]], str]:
    """The files that match a pattern, the labels that their names give, and a remark.

    The others below the pattern's fixed folder, of the same kind, are counted: unless ``some``
    are wanted, all must match.
    """
    text = os.path.expanduser(text)
    form, search = _compiled(text)
    found = []
    for name in glob.glob(search):
        match = form.fullmatch(name.replace(os.sep, "/"))
        if match and os.path.isfile(name):
            found.append((Path(name), match.groupdict()))
    if not found:
        raise FileNotFoundError(
            f"No file matches the pattern {text!r} (working folder: {Path.cwd()}).{_near(text)}"
        )
    files = [path for path, _ in found]
    others = sorted(_beside(text, files), key=natural)
    remark = f"{len(files)} of {len(files) + len(others)} files match the pattern"
    if others and not some:
        raise SomeFilesError(
            f"{remark} {text!r}; the others are such as {shown(others[0])}. Give a pattern that "
            "matches all of them, or say that some are meant: --some in the command, some=True "
            "in Python."
        )
    labels = [labels for _, labels in found]
    return files, labels, f"{remark}, the others are not read" if others else ""


def _beside(text: str, files: Sequence[Path]) -> set[Path]:
    """Recordings of the same kind below the folder where a pattern begins, that it leaves out."""
    folder = Path(re.split(r"[*?{]", text, maxsplit=1)[0] + "_").parent
    suffixes = {path.suffix for path in files}
    try:
        return {path for path in find_files(folder)[0] if path.suffix in suffixes} - {*files}
    except (ValueError, FileNotFoundError):  # of several kinds: the pattern says which are meant
        return set()


def _compiled(text: str) -> tuple[re.Pattern[str], str]:
    """A pattern as an expression for names with slashes, and as a glob pattern."""
    unknown = [name for name in _FIELD.findall(text) if name not in FIELDS]
    if unknown:
        raise ValueError(
            f"The pattern {text!r} has the field {{{unknown[0]}}}; fields are "
            f"{', '.join(f'{{{name}}}' for name in FIELDS)}. Write * for a part that varies and "
            "means nothing."
        )
    search, expression, seen = "", "", set[str]()
    for number, piece in enumerate(_FIELD.split(text)):
        if number % 2 == 0:
            search += "".join(c if c in "*?" else glob.escape(c) for c in piece)
            expression += "".join(_wild(c) for c in piece)
        else:
            search += "*"
            expression += f"(?P={piece})" if piece in seen else f"(?P<{piece}>[^/]+?)"
            seen.add(piece)
    return re.compile(expression.replace(re.escape(os.sep), "/")), search


def _wild(character: str) -> str:
    return {"*": "[^/]*", "?": "[^/]"}.get(character) or re.escape(character)


def _near(text: str) -> str:
    """What there is where the pattern stops to match."""
    folder = Path(text.split("{", maxsplit=1)[0])
    folder = folder if text.split("{", maxsplit=1)[0].endswith(("/", os.sep)) else folder.parent
    while not folder.is_dir() and folder != folder.parent:
        folder = folder.parent
    names = sorted(path.name for path in folder.iterdir())
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    listed = ", ".join(map(repr, names[:_SHOWN]))
    return f" {str(folder)!r} has: {listed}{more}." if names else f" {str(folder)!r} is empty."


_LISTED = 4  # labels in a message
_GLUED = re.compile(r"(?:[^\W\d_]{1,3}\d+){2,}")


class UnclearNamesError(ValueError):
    """Names of files do not say which part of them is the subject, the condition or the run."""


@dataclass(frozen=True)
class _Token:
    """A part of a name: ``before`` is the text since the last label, ``level`` "" if not said.

    ``joined`` says that it was put together from several.
    """

    before: str
    label: str
    level: str
    joined: bool = False


def names_guess(
    files: Sequence[Path], root: Path, wanted: Sequence[str]
) -> tuple[list[dict[str, str]], str]:
    """Labels of the files for the wanted levels, and the pattern of the first of them.

    Parts that are the same in all names and of no known key are no labels. Where single words do
    not say what is what, those of a folder, or beside each other in a name, are one label:
    ``fast_tired`` and ``no_motion`` are conditions, beside ``fast`` and ``motion``.
    """
    words = [_tokens(path, root) for path in files]
    keyed = [_keyed(row, path) for row, path in zip(words, files, strict=True)]
    for rows in (words, whole := list(map(_join, words))):
        given = _levels_of(rows, wanted)
        if given is not None:
            break
    else:
        raise _unclear(files, root, words, whole, keyed[0], wanted)
    if rows is whole:
        keyed = [_keyed(row, path) for row, path in zip(whole, files, strict=True)]
    labels = [
        {level: label for level, label in own.items() if level in wanted or level not in LEVELS}
        | {level: _open(row)[k].label for k, level in given.items()}
        for own, row in zip(keyed, rows, strict=True)
    ]
    return labels, _example(rows[0], given, files[0], wanted)


def _open(row: list[_Token]) -> list[_Token]:
    """The parts whose level is not said."""
    return [token for token in row if not token.level]


def _levels_of(rows: list[list[_Token]], wanted: Sequence[str]) -> dict[int, str] | None:
    """Which of the parts without a key is which level; None if that is not clear."""
    open_rows = list(map(_open, rows))
    if len({len(row) for row in open_rows}) > 1:
        return None
    varying = _varying(rows)
    known = {token.level for row in rows for token in row if token.level}
    missing = [level for level in LEVELS if level in wanted and level not in known]
    given = _assign(varying, missing, open_rows, len(open_rows[0]), bool(known))
    joined = {level: any(row[k].joined for row in open_rows) for k, level in (given or {}).items()}
    for k, level in (given or {}).items():
        tokens = [row[k] for row in open_rows]
        beside = k and all("/" not in token.before for token in tokens)
        words = all(len(t.label) > 1 and not any(map(str.isdigit, t.label)) for t in tokens)
        # fast_tired.csv is no run "tired" of the condition "fast".
        if level == "run" and ((beside and words) or joined["run"]):
            return None
        # Whether anna_fast or fast_tired is a person, nobody knows.
        if level == "subject" and joined["subject"] and not joined.get("condition"):
            return None
    return given


def _join(row: list[_Token]) -> list[_Token]:
    """Parts beside each other that say no level, or that of a condition, as one.

    A number at the end of a name stays alone, and so does the first part of a name without folders:
    they are the run and the person.
    """
    person = any(token.level == "subject" or "/" in token.before for token in row)
    found: list[_Token] = []
    for number, token in enumerate(row):
        alone = number + 1 == len(row) and token.label.isdecimal()
        alone |= not person and number == 1
        both = {token.level, found[-1].level if found else "run"}
        if found and "/" not in token.before and not alone and both <= {"", "condition"}:
            last = found.pop()
            label = last.label + token.before + token.label
            token = _Token(last.before, label, max(both), joined=True)
        found.append(token)
    return found


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
    words: list[list[_Token]],
    whole: list[list[_Token]],
    keyed: dict[str, str],
    wanted: Sequence[str],
) -> UnclearNamesError:
    """What the parts of the names are, and the pattern that matches the most of them."""
    missing = [level for level in LEVELS if level in wanted and level not in keyed]
    what = " and ".join(missing) if missing else "subject, condition and run, which are known"
    counts = [len(_open(row)) for row in words]
    if len(set(counts)) > 1:
        odd = next(k for k, count in enumerate(counts) if count != counts[0])
        said = (
            f"Names of files are built differently: {_relative(files[0], root)!r} and "
            f"{_relative(files[odd], root)!r}."
        )
    else:
        seen = []
        for number, k in enumerate(_varying(words), 1):
            labels = list(dict.fromkeys(_open(row)[k].label for row in words))
            more = f" and {len(labels) - _LISTED} more" if len(labels) > _LISTED else ""
            seen.append(f"part {number} is {', '.join(map(repr, labels[:_LISTED]))}{more}")
        said = (
            f"Names of files, such as {_relative(files[0], root)!r}, do not say which part is the "
            f"{what}: {'; '.join(seen)}."
        )
    tried = {}
    for rows in (words, whole):
        for row, path in zip(rows, files, strict=True):
            varying = _varying([other for other in rows if len(_open(other)) == len(_open(row))])
            names = (missing or list(LEVELS)) + ["*"] * len(varying)
            given = dict(zip(varying, names, strict=False))
            text = str(root / _example(row, given, path).replace("{*}", "*"))
            if text not in tried:
                form, _ = _compiled(text)
                tried[text] = sum(bool(form.fullmatch(one.as_posix())) for one in files)
    best = max(tried, key=lambda text: tried[text])
    how_many = "all" if tried[best] == len(files) else f"{tried[best]} of {len(files)}"
    return UnclearNamesError(
        f"{said} Give the pattern, such as {best!r}, which matches {how_many} files, or a list of "
        "files."
    )


def _varying(rows: list[list[_Token]]) -> list[int]:
    """Places of the parts without a key that are not the same in all rows, which are as long."""
    kinds = zip(*map(_open, rows), strict=False)
    return [k for k, tokens in enumerate(kinds) if len({token.label for token in tokens}) > 1]


@dataclass(frozen=True)
class Sources:
    """Files, and the labels that a pattern found in their names; None: names may be guessed.

    ``root`` is the folder below which names mean something. ``listed`` files keep their order.
    """

    files: list[Path]
    root: Path
    labels: list[dict[str, str]] | None = None
    listed: bool = False
    remark: str = ""


def find_sources(paths: Any, *, some: bool) -> Sources:
    """The files that a user names; with ``some``, a pattern may leave out others beside them."""
    if isinstance(paths, str | os.PathLike):
        text = os.fspath(paths)
        if has_fields(text):
            files, labels, remark = match_pattern(text, some=some)
            return Sources(files, Path(), labels, remark=remark)
        folder = Path(text).expanduser()
        if folder.is_dir():
            return _of_folder(folder)
        files = expand_paths(paths)
        return Sources(_different(files), _common(files), listed=not glob.has_magic(text))
    items = list(paths) if isinstance(paths, Iterable) else [paths]
    if any(isinstance(item, str) and has_fields(item) for item in items):
        raise ValueError(
            "A pattern with fields such as {subject} stands alone: give one pattern, or read part "
            "by part and join: pd.concat([X1, X2])."
        )
    files = expand_paths(items)
    return Sources(_different(files), _common(files), listed=True)


def _of_folder(folder: Path) -> Sources:
    kept, aside = find_files(folder)
    depths = {len(path.relative_to(folder).parts): path for path in kept}
    if len(depths) > 1 and not kept[0].name.endswith(MOTION):
        some = [shown(path.relative_to(folder)) for _, path in sorted(depths.items())]
        raise ValueError(
            f"The folder {shown(folder)} has files at several depths, such as "
            f"{' and '.join(map(repr, some[:2]))}: say which are the recordings, with a pattern "
            f"such as {os.fspath(folder / '{subject}' / '{condition}_{run}.csv')!r}."
        )
    remark = f"{aside} other tables in the folder are not read" if aside else ""
    return Sources(sorted(kept, key=natural), folder, remark=remark)


def _common(files: list[Path]) -> Path:
    """The folder that the files share."""
    return Path(os.path.commonpath([os.path.abspath(path.parent) for path in files]))


def _different(files: list[Path]) -> list[Path]:
    twice = [path for path, number in Counter(files).items() if number > 1]
    if twice:
        raise ValueError(f"{shown(twice[0])} is named twice in paths.")
    return files
