"""Words in the names of a log's columns: the quantity, its unit, and what is left of the name.

English, German, French, Italian and Spanish words, and those of robot makers: KUKA
(`$AXIS_ACT.A1`, `AIPos.A1`, `MACur.A1`), ABB (`rax_1`), Beckhoff (`ActPos`), ODrive
(`axis0.encoder.pos_estimate`, turns), others (`posFbk`).
"""

import re
import unicodedata
from typing import NamedTuple

from wrenchsight.models.recordings.recording_format import PER_CENT, PER_MILLE, UNITS

QUANTITIES = {  # in this order: "current as torque" is a torque, "joint speed" a velocity
    "velocity": {"vel", "velo", "velocity", "velocities", "velocityactual", "speed", "speeds", "qd",
                 "dq", "qdot", "qvel", "omega", "v", "geschw", "geschwindigkeit", "vitesse",
                 "velocita", "velocidad"},
    "motor_torque": {"tau", "trq", "torque", "torques", "moment", "effort", "efforts", "eff",
                     "taumsr", "drehmoment", "couple", "coppia"},
    "current": {"cur", "curr", "current", "currents", "amp", "amps", "ampere", "i", "iq", "strom",
                "courant", "corrente", "corriente"},
    "position": {"pos", "position", "positions", "angle", "angles", "theta", "q", "qpos", "winkel",
                 "posizione", "angolo", "posicion", "angulo"},
}  # fmt: skip
_ASIDE = {  # words of what is no measured signal of a joint
    "target", "desired", "des", "d", "cmd", "command", "commanded", "goal", "ref", "reference",
    "set", "setpoint", "soll", "ext", "external", "error", "err", "temp", "temperature", "voltage",
    "limit", "max", "min", "acc", "acceleration", "tcp", "ee", "wrench", "mode", "status",
    "gripper", "finger", "digital", "output", "input", "gravity", "coriolis", "friction", "control",
    "temperatur", "spannung", "drehzahl", "rpm", "schleppfehler", "consigne", "consigna",
}  # fmt: skip
_AXIS_WORDS = {
    "joint", "joints", "jnt", "j", "jt", "axis", "axes", "ax", "a", "rax", "achse", "gelenk", "axe",
    "articulation", "asse", "giunto", "eje", "articulacion",
}  # fmt: skip
_VALUE_WORDS = {"actual", "act", "measured", "meas", "msr", "real", "ist", "feedback", "fb", "fbk",
                "wert", "value", "mesure", "misurato", "medido"}  # fmt: skip
_MEASURED = (_AXIS_WORDS - {"j", "jt", "a"}) | _VALUE_WORDS | {"motor", "raw"}
_PROGRAM_WORDS = {
    # of KUKA's sensor interface: axes' actual and set positions, motor currents
    "AIPos": "axis ist pos",
    "ASPos": "axis soll pos",
    "MACur": "motor cur",
    # of ODrive: its current controller's measured current
    "current_control.Iq_measured": "Iq",
}
_PROGRAM_UNITS = {"pos_estimate": "rev", "vel_estimate": "rev/s"}  # of ODrive
_FIRST_WORDS = ("ist", "soll", "motor", "achsen", "achs", "gelenk")  # of German compounds
_UNITS = {
    "rad": "rad", "rads": "rad", "radian": "rad", "radians": "rad", "deg": "deg", "degree": "deg",
    "degrees": "deg", "°": "deg", "grad": "deg", "rev": "rev", "turns": "rev", "mm": "mm",
    "rad/s": "rad/s", "rad_s": "rad/s", "radps": "rad/s", "rad_per_s": "rad/s", "rad/sec": "rad/s",
    "deg/s": "deg/s", "°/s": "deg/s", "deg_s": "deg/s", "degps": "deg/s", "deg_per_s": "deg/s",
    "deg/sec": "deg/s", "grad/s": "deg/s", "rpm": "rpm", "u/min": "rpm", "1/min": "rpm",
    "rev/s": "rev/s", "turns/s": "rev/s", "a": "A", "amp": "A", "ampere": "A", "amperes": "A",
    "ma": "mA", "nm": "N m", "n*m": "N m", "n.m": "N m", "n m": "N m", "mnm": "mN m",
    "%": PER_CENT, "percent": PER_CENT, "pct": PER_CENT, "permille": PER_MILLE,
    "promille": PER_MILLE, "‰": PER_MILLE,
}  # fmt: skip
_INNER_UNITS = ("rad", "deg", "ma", "nm", "mnm", "percent", "pct", "permille", "promille")
_IN_BRACKETS = re.compile(r"\s*[\[(<]\s*([^\])>]+?)\s*[\])>]\s*")
_AT_END = re.compile(
    r"[\s_.\-](rad[_/]s|rad_per_s|deg[_/]s|deg_per_s|rad/sec|deg/sec|[a-z%°‰]+)$", re.IGNORECASE
)
_MAX_NAME = 200  # characters


class ColumnName(NamedTuple):
    """What the name of a column says.

    Attributes:
        quantity: key of a description; empty where the column is no signal of a joint, or does not
            say which.
        unit: as descriptions have it; empty where the name states none.
        words: of its joint: all but quantity and unit.
        is_bare: whether it names an axis or an actual value, but no quantity: where no other
            column is a position, this one may be.
    """

    quantity: str
    unit: str
    words: tuple[str, ...]
    is_bare: bool = False


def column_name(name: str) -> ColumnName:
    """Takes the name of a column apart."""
    if len(name) > _MAX_NAME:
        return ColumnName("", "", ())
    unit, rest = _unit(name.strip())
    unit = unit or next((u for word, u in _PROGRAM_UNITS.items() if rest.endswith(word)), "")
    tokens = name_tokens(rest)
    if not unit:  # percent_1, or pos_deg_1
        unit = next((_UNITS[token] for token in tokens if token in _INNER_UNITS), "")
        tokens = [token for token in tokens if token not in _INNER_UNITS]
    named = [key for key, words in QUANTITIES.items() if words & set(tokens)]
    quantity = named[0] if named else next(
        (key for key in QUANTITIES if unit in UNITS[key] and unit not in (PER_CENT, PER_MILLE)), ""
    )  # fmt: skip
    if not tokens or _ASIDE & set(tokens):
        return ColumnName("", unit, tuple(tokens))
    quantity_words = set().union(*(QUANTITIES[key] for key in named))
    joint = tuple(token for token in tokens if token not in quantity_words)
    return ColumnName(quantity, unit, joint, not quantity and not unit and _is_bare(tokens))


def name_tokens(text: str) -> list[str]:
    """Words and numbers of a name, in lower case, without accents; AxisAct_A1 has four."""
    for word, words in _PROGRAM_WORDS.items():
        text = text.replace(word, words)
    plain = unicodedata.normalize("NFKD", text)
    plain = "".join(letter for letter in plain if not unicodedata.combining(letter))
    tokens = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", plain)
    return [part for token in tokens for part in _compound_parts(token.lower())]


def without_joint_words(joint: str) -> str:
    """A joint's name, its words joined by _, without those that say no more than that it is one."""
    return "_".join(word for word in joint.split("_") if word not in _MEASURED) or joint


def _is_bare(tokens: list[str]) -> bool:
    """Whether a name is an axis with its number (J1, A1_Istwert), or an actual value (Base_Ist)."""
    words = {token for token in tokens if not token.isdigit()}
    is_numbered_axis = len(words) < len(tokens) and words <= _AXIS_WORDS | _VALUE_WORDS
    return bool(words) and (is_numbered_axis or bool(words & _VALUE_WORDS))


def _compound_parts(token: str) -> list[str]:
    """The parts of a German compound: iststrom, motormoment, achswinkel."""
    known = set().union(_ASIDE, _VALUE_WORDS, *QUANTITIES.values())
    for first in _FIRST_WORDS:
        rest = token.removeprefix(first)
        if rest not in (token, "") and token not in known:
            parts = _compound_parts(rest)
            if set(parts) <= known | set(_FIRST_WORDS):
                return [first, *parts]
    return [token]


def _unit(name: str) -> tuple[str, str]:
    """The unit in a column's name, in brackets or at its end, and the name without it."""
    for pattern in (_IN_BRACKETS, _AT_END):
        for match in pattern.finditer(name):
            if match[1].lower() in _UNITS and match.start():
                rest = f"{name[: match.start()]} {name[match.end() :]}"
                return _UNITS[match[1].lower()], rest.strip()
    return "", name
