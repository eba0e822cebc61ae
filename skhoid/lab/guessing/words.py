"""Words in headers, in four languages, and likenesses of values, that say what a column is."""

from __future__ import annotations

import re
import unicodedata

import numpy as np

from ...io.delimited import TIME_UNITS, UNITS
from ...io.files import split_header
from ...runs.roles import names_time, put_in_words, singular

STRONG = 6  # scores from here up stand alone; lower ones only where nothing else is there


def _words(text: str) -> set[str]:
    return {singular(word) for word in text.split()}


ERROR = _words(
    "error err fehler regelfehler abweichung regelabweichung erreur ecart fout afwijking deviation"
)
TARGET = _words(
    "target tgt trg stimulus ref reference goal setpoint desired des commanded wanted forcing "
    "soll sollwert ziel zielposition fuhrungsgrosse fuehrungsgroesse consigne cible doel gewenst "
    "guidance 目標値"
)
DEVICE = _words(
    "joy gamepad tiller thumbstick trackball cyclic collective gimbal finger grip master leader "
    "stick joystick sidestick device wheel steering pedal yoke lever throttle handle knob "
    "manipulator inceptor mouse pen stylus hand aileron elevator rudder deflection knuppel "
    "knueppel steuerknuppel steuerknueppel manche stuurknuppel lenkrad lenkwinkel volant stuur"
)
ACTOR = _words("operator human pilot person driver rider")
CONTROL = _words(
    "control controller ctrl ctl command cmd commande steuer steuersignal steuerung stellgrosse "
    "stellgroesse stellsignal response action force torque actuator effort stuursignaal commando "
    "manipulated 操作量"
)
PLANT = _words("plant system vehicle aircraft process controlled strecke procede slave")
PLACE = _words(
    "cursor position pos attitude angle pitch roll yaw heading altitude height theta phi psi ist "
    "istwert regelgrosse regelgroesse lage winkel hoek positie displacement location bank "
    "att actual act measured meas state uitgang ausgang sortie follower mesure messwert meetwaarde "
    "制御量"
)
_PLAIN = _words(  # which may be of the target as well
    "position pos attitude angle pitch roll yaw heading altitude height displacement location"
)
DISTURBANCE = _words(
    "disturbance disturb dist dis perturbation storung stoerung storgrosse verstoring gust wind"
)
MOTION = _words("motion platform gyro")
OF_OTHERS = _words(
    "rate velocity vel speed dot deriv derivative diff filtered filt raw smoothed smooth abs "
    "absolute squared sq rms cumulative cum mean avg average std var integral score geschwindigkeit"
)
SYMBOLS = {
    "e": ("e", 10),
    "u": ("u", 10),
    "x": ("x", 9),
    "y": ("x", 6),
    "f t": ("f_t", 10),
    "ft": ("f_t", 10),
    "r": ("f_t", 6),
    "sp": ("f_t", 6),
    "pv": ("x", 6),
    "op": ("u", 6),
    "f d": ("dist", 10),
    "fd": ("dist", 10),
    "d": ("dist", 5),
    "w": ("dist", 4),
    "f": ("f_t", 4),
    "delta": ("u", 6),
}
RUNS = _words("run trial rep repetition recording versuch durchgang lauf essai proef poging")
RUNS |= _words("passage replicate replication epoch attempt tria messung meting wiederholung")
RUNS |= _words("drive ride lap fahrt rit flight test")
OUTER = {"subject": _words("subject subj sub participant part proband versuchsperson vp sujet")}
OUTER["subject"] |= _words("proefpersoon ppn pp probandin subjid pid sid") | ACTOR
OUTER["condition"] = _words("condition cond configuration config bedingung conditie task group")
OUTER["condition"] |= _words("difficulty schwierigkeit scenario")
OUTER["session"] = _words("session sitzung sessie seance")
OUTER["block"] = _words("block bloc blok")
_NUMBERING = _words("id no nr num number index idx name code label n nummer count")
TIMES = _words("datetime stamp zeit temps tijd zeitstempel tijdstip clock uhrzeit")
ROW_NUMBERS = _words(
    "sample frame row index idx count counter no nr num tick unnamed step seq sequence"
)
OTHERS = _words(
    "button trigger fps gaze pupil eye key pressed taster knop comment remark opmerking"
)
AXES = {word: word[0] for word in ("x", "y", "z", "pitch", "roll", "yaw")}
AXES |= {"lat": "lateral", "lateral": "lateral", "long": "longitudinal"}
AXES |= {"lon": "longitudinal", "longitudinal": "longitudinal"}
AXES |= {"horizontal": "horizontal", "vertical": "vertical", "left": "left", "right": "right"}


def folded(header: str) -> str:
    """A header without accents, unit in brackets, argument ``(t)`` and the path of its struct."""
    name = split_header(header)[0]
    name = re.sub(r"\s*[\[(]\s*\W*\s*[\])]\s*$|\(t\)\s*$|\(k\)\s*$", "", name.strip()) or name
    # A parenthesis that touches the name is a unit too, in "err(deg)".
    name = re.sub(r"(?<=\w)\([^\W\d_][^()]*\)$", "", name)
    name = unicodedata.normalize("NFKD", name.replace("ß", "ss"))
    return "".join(c for c in name if not unicodedata.combining(c))


def find_axis(header: str) -> str:
    """The axis that a header names, as in ``targetPosX`` and ``STICK_PITCH``; "" for none."""
    words = put_in_words(folded(header))
    return AXES.get(words[-1], "") if len(words) > 1 else ""


def _own_words(header: str) -> list[str]:
    whole = put_in_words(folded(header))
    path, _, last = folded(header).rpartition(".")
    field = put_in_words(last)
    words = field if field and field not in (["value"], ["data"], ["signal"]) else whole
    # The axis of a signal: plant.position.x, joy.axes.0.
    if path and (not field or (field[0] in ("x", "y", "z") and len(field) == 1)):
        above = put_in_words(path)
        words = above if max(_of_words(set(above)).values(), default=0) >= STRONG else words
    while len(words) > 1 and (words[-1] in UNITS and len(words[-1]) > 1):
        words = words[:-1]
    if len(words) > 1 and words[-1] in ("m", "v", "n", "g") and len(words[-2]) > 1:
        words = words[:-1]
    return words


def unit_by_name(header: str, *, time: bool = False) -> str | None:
    """Unit at the end of a name: ``err_deg`` is in deg, ``time_ms`` in ms."""
    touching = re.search(r"(?<=\w)\(([^\W\d_][^()]*|%|°)\)$", header.strip())
    if touching and touching[1] not in ("t", "k"):
        return touching[1]
    raw = [word.casefold() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", folded(header))]
    if time and raw:
        whole = raw[-1] in TIME_UNITS and (len(raw) > 1 or raw[0] != "t")
        return TIME_UNITS[raw[-1]] if whole else None
    if len(raw) < 2 or (len(raw[-1]) == 1 and len(raw[-2]) == 1):
        return None
    return UNITS.get(raw[-1])


def may_be_time(header: str) -> bool:
    """Whether a column may be a clock by its name."""
    field = folded(header).rpartition(".")[2] or folded(header)
    words = set(put_in_words(field))
    return (names_time(field) or bool(words & TIMES)) and not words & _words(
        "reaction response delay run trial block session since"
    )


def is_row_number(header: str) -> bool:
    """Whether a column counts rows by its name, or has none."""
    words = put_in_words(folded(header).rpartition(".")[2]) or put_in_words(folded(header))
    return all(word in ROW_NUMBERS for word in words) if words else not re.search(r"\d", header)


def is_no_signal(header: str) -> bool:
    """Whether a column is by its name none of the loop: a button, a comment, the eye."""
    return bool(set(put_in_words(folded(header))) & OTHERS)


def is_derived(header: str) -> bool:
    """Whether a column is by its name computed from another signal: its rate, its mean."""
    return bool(set(put_in_words(folded(header))) & OF_OTHERS)


def find_label(header: str) -> str:
    """The level of the row index that a column may be by its name; "" for none."""
    field = folded(header).rpartition(".")[2] or folded(header)
    words = [word for word in put_in_words(field) if word not in _NUMBERING] or put_in_words(field)
    if len(words) == 2:  # feedback_condition
        level = find_label(words[1])
        return level if level in ("run", "condition") else ""
    if len(words) != 1:
        return ""
    if words[0] in RUNS:
        return "run"
    return next((level for level, some in OUTER.items() if words[0] in some), "")


_OF_MATRIX = re.compile(r"\((:,\d+|\d+,:)\)$")


def roles_by_name(header: str) -> dict[str, int]:
    """Roles that a column may have by its name (``u`` for the output), with a score up to 10."""
    if _OF_MATRIX.search(header):  # the name is that of all channels
        return {}
    words = _own_words(header)
    if not words:
        return {}
    there = set(words)
    if there & OTHERS:
        return {}
    less = 5 if there & OF_OTHERS else 0
    found = _of_symbols(words) or _of_words(there)
    if there - AXES.keys() <= _PLAIN and (path := set(put_in_words(folded(header)))) & (
        ERROR | TARGET
    ):
        found = _of_words(path)  # reference.position
    if not found and len(words) == 2 and words[1] in ("u", "y"):  # controle_u, saida_y
        found = {"u": 5} if words[1] == "u" else {"x": 5}
    return {role: score - less for role, score in found.items() if score > less}


def _of_symbols(words: list[str]) -> dict[str, int]:
    if " ".join(words) in SYMBOLS:
        role, score = SYMBOLS[" ".join(words)]
        return {role: score}
    if len(words) == 2 and words[0] in "eux" and (words[0] == "e" or len(words[1]) == 1):
        return {words[0]: 7}  # u_h, e_theta
    if words[0] == "delta":  # of the elevator, the ailerons
        return {"u": 6}
    if len(words) == 2 and words[1] == "e":
        return {"e": 6}
    return {}


def _of_words(there: set[str]) -> dict[str, int]:
    if there & ERROR:
        return {"e": 8}
    if there & DISTURBANCE:
        return {"dist": 8}
    if there & TARGET or {"set", "point"} <= there:
        return {"f_t": 8}
    if any(word.endswith("ref") or word.startswith("soll") for word in there):  # yref, Sollspur
        return {"f_t": 6}
    if there & DEVICE:
        return {"u": 8}
    if there & ACTOR:
        return {"u": 8} if there & (CONTROL | {"output", "input", "u"}) else {"u": 3}
    if there & PLANT:
        return {"u": 8} if there & ({"input"} | CONTROL - {"controlled"}) else {"x": 8}
    if there & MOTION:
        return {"motion": 6}
    if there & PLACE or any(word.startswith("ist") for word in there):  # Istspur
        return {"f_t": 7, "u": 3} if there & {"command", "cmd"} else {"x": 7}
    if there & CONTROL:
        return {"u": 8}
    if there & {"output", "out"}:
        return {"u": 5, "x": 3}
    if there & {"input", "in", "inp"}:
        return {"e": 4, "u": 4}
    return {}


_EXACT = 0.01  # of the spread of the smaller: what rounding in a file leaves of f_t - x - e


def moves(values: np.ndarray) -> bool:
    """Whether a signal is ever another than at first."""
    there = values[np.isfinite(values)]
    return bool(there.size and np.ptp(there) > 0)


def _spread(values: np.ndarray) -> float:
    """How much most values differ, whatever fill values there are."""
    return float(np.subtract(*np.quantile(values, [0.9, 0.1])))


def equal(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two signals are the same but for rounding and a few rows."""
    if one.shape != other.shape:
        return False
    there = np.isfinite(one) & np.isfinite(other)
    if there.sum() < 3 or not moves(one[there]) or not moves(other[there]):
        return False
    apart = np.quantile(np.abs(one[there] - other[there]), 0.9)
    return bool(apart <= _EXACT * min(_spread(one[there]), _spread(other[there])))


def find_factor(one: np.ndarray, other: np.ndarray) -> float | None:
    """The factor between two signals that are otherwise the same."""
    there = np.isfinite(one) & np.isfinite(other)
    if one.shape != other.shape or there.sum() < 3 or not moves(other[there]):
        return None
    factor = float(one[there] @ other[there] / (other[there] @ other[there]))
    return factor if equal(one, factor * other) else None


def coherence(one: np.ndarray, other: np.ndarray) -> float:
    """Share of the changes of a signal that go with those of another, at whatever delay."""
    from scipy import signal

    there = np.isfinite(one) & np.isfinite(other)
    if one.shape != other.shape or there.sum() < 300 or not moves(one[there]):
        return 0.0
    changes = np.diff(one[there]), np.diff(other[there])
    n_rows = min(256, there.sum() // 8)
    with np.errstate(invalid="ignore", divide="ignore"):
        _, share = signal.coherence(*changes, nperseg=n_rows)
    power = signal.welch(changes[1], nperseg=n_rows)[1]
    return float(np.nansum(share * power) / power.sum()) if power.sum() else 0.0


def alike(signals: list[np.ndarray]) -> bool:
    """Whether columns are one signal, in other units."""
    first = signals[0]
    for other in signals[1:]:
        if other.shape != first.shape:
            return False
        there = np.isfinite(first) & np.isfinite(other)
        if there.sum() < 3 or not moves(first[there]) or not moves(other[there]):
            return False
        if np.corrcoef(first[there], other[there])[0, 1] < 0.9999:
            return False
    return True
