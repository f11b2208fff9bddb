"""Words in the names of a log's columns: the quantity, its unit, and what is left of the name.

English, German, French, Italian, Spanish, Portuguese, Chinese and Japanese words, and those of
robot makers: KUKA (`$AXIS_ACT.A1`, `AIPos.A1`, `MACur.A1`), ABB (`rax_1`), Beckhoff (`ActPos`),
ODrive (`axis0.encoder.pos_estimate`, turns), others (`posFbk`).
"""

import re
import unicodedata
from typing import NamedTuple

from wrenchsight.models.recordings.layouts.unit_words import unit_of
from wrenchsight.models.recordings.recording_format import PER_CENT, PER_MILLE, UNITS

QUANTITIES = {  # in this order: "current as torque" is a torque, "joint speed" a velocity
    "velocity": {"vel", "vels", "velo", "velocity", "velocities", "velocityactual", "speed",
                 "speeds", "qd", "dq", "qdot", "qvel", "dot", "dtheta", "thetadot", "jvel", "omega",
                 "v", "geschw", "geschwindigkeit", "vitesse", "velocita", "velocidad",
                 "velocidade", "drehzahl", "速度", "转速"},
    "motor_torque": {"tau", "trq", "torq", "torque", "torques", "moment", "moments", "effort",
                     "efforts", "eff", "taumsr", "jtrq", "drehmoment", "couple", "coppia",
                     "momento", "par", "torsor", "力矩", "扭矩", "转矩", "トルク"},
    "current": {"cur", "curr", "crnt", "current", "currents", "amp", "amps", "ampere", "i", "iq",
                "jcur", "curs", "strom", "stroeme", "strome", "courant", "corrente", "corriente",
                "电流", "電流"},
    "position": {"pos", "position", "positions", "posn", "angle", "angles", "ang", "theta", "th",
                 "q", "qpos", "jpos", "winkel", "lage", "posizione", "angolo", "posicion",
                 "posicao", "angulo", "位置", "角度", "角"},
}  # fmt: skip
EASTERN_WORDS = tuple(
    word
    for words in QUANTITIES.values()
    for word in words
    if len(word) > 1 and ord(word[0]) > 0x3000
)
"""Words for quantities in Chinese and Japanese, by which such a code page is recognised."""
_COMMANDED = {  # words of what a controller commands
    "action", "actions", "target", "desired", "des", "cmd", "command", "commanded", "goal",
    "ref", "reference", "setpoint", "soll", "sollwert", "consigne", "consigna", "objetivo", "目标",
    "指令",
}  # fmt: skip
_ASIDE = _COMMANDED | {  # words of what is no measured signal of a joint
    "d", "set", "ext", "external", "error", "err", "temp", "temperature", "voltage", "limit",
    "max", "min", "acc", "acceleration", "tcp", "ee", "wrench", "mode", "status", "gripper",
    "finger", "digital", "output", "input", "gravity", "coriolis", "friction", "control",
    "scaling", "override", "following", "lag", "deviation", "residual", "accel", "acceleracion",
    "ddot", "ddq", "qdd", "ddtheta", "jerk", "cartesian", "pose", "flange", "temperatur",
    "spannung", "rpm", "schleppfehler", "设定", "期望", "温度", "电压", "误差", "目標", "runtime",
    "fault", "faults", "warning", "alarm",
}  # fmt: skip
_ROTATION_WORDS = {"drehzahl"}  # of a joint where a unit is stated, else of whatever turns
_AXIS_WORDS = {
    "joint", "joints", "jnt", "j", "jt", "axis", "axes", "ax", "a", "rax", "achse", "gelenk", "axe",
    "articulation", "asse", "giunto", "eje", "articulacion", "junta", "eixo", "关节", "轴", "軸",
    "関節",
}  # fmt: skip
_VALUE_WORDS = {"actual", "act", "measured", "meas", "msr", "real", "ist", "feedback", "fb", "fbk",
                "wert", "istwert", "value", "mesure", "misurato", "medido", "实际",
                "反馈", "当前", "pres", "present"}  # fmt: skip
_STATE_WORDS = {"state"}  # beside torques that of the positions, where no name is one of these
_QUALIFIERS = {"raw", "filtered", "filt", "smoothed"}  # of a signal that is logged without, too
_MEASURED = (_AXIS_WORDS - {"j", "jt", "a"}) | _VALUE_WORDS | {"motor", "raw"}
_PROGRAM_WORDS = {
    # of KUKA's sensor interface: axes' actual and set positions, motor currents
    "AIPos": "axis ist pos",
    "ASPos": "axis soll pos",
    "MACur": "motor cur",
    # of ODrive: its current controller's measured current
    "current_control.Iq_measured": "Iq",
    # objects of CiA 402: torque and current in per mille of the rated ones
    "6077": " torque permille ",
    "6078": " current permille ",
    # of MuJoCo: in joint space, and of the actuators, before their gears
    "qfrc_actuator": " torque ",
    "actuator_force": " actuator torque ",
    # of mc_rtc: velocities
    "alphaIn": " velocity in",
    "alphaOut": " velocity out",
    # of LeRobot's data sets
    "observation.state": "position",
}
_PROGRAM_UNITS = {"pos_estimate": "rev", "vel_estimate": "rev/s"}  # of ODrive
# Of compounds: iststrom, motormoment, achswinkel, jointpos, actvel, 关节角度.
_FIRST_WORDS = (
    "ist", "soll", "motor", "achsen", "achs", "gelenk", "joint", "axis", "actual", "act", "meas",
    "real", "target", "cmd", "电机", "关节", "実", "实际", "反馈", "目标", "轴",
)  # fmt: skip
_IDEOGRAMS = "\u3040-\u30ff\u3400-\u9fff"
_OBJECT = re.compile(r"\b\w*status[./](?=[^\W\d])", re.IGNORECASE)  # joint_status.position
_INNER_UNITS = ("rad", "deg", "ma", "nm", "mnm", "percent", "pct", "permille", "promille")
_IN_BRACKETS = re.compile(r"[\s_]*[\[(<{（]\s*([^\])>}）]+?)\s*[\])>}）]\s*")
_AT_END = re.compile(
    r"[\s_.\-](rad[_/]s|rad_per_s|rad_per_sec|deg[_/]s|deg_per_s|deg_per_sec|rev_s|turns_s|mm_s|"
    r"rad/sec|deg/sec|[^\s_.\-\d\w]|[^\W\d_]+)$",
    re.IGNORECASE,
)
_SCALED_UNIT = re.compile(r"(?<=[\s_\[(])(0\.\d{1,9}) ?([^\W\d_]+(?:/s)?)[\])]?$")  # 0.0001deg
_NUMBER_AT_END = re.compile(r"[._]?[\[(]?\d{1,4}[\])]?$")
_AXIS_LETTER = re.compile(r"[\s_.\-][A-Za-z]\d{1,4}$")  # AxisAct_A1 is in no ampere
_UNITS_OF_WORD = {  # where a unit is stated that a quantity cannot have, but one like it can
    ("velocity", "rad"): ("velocity", "rad/s"),
    ("velocity", "deg"): ("velocity", "deg/s"),
    ("velocity", "rev"): ("velocity", "rev/s"),
    ("motor_torque", "A"): ("current", "A"),
    ("motor_torque", "mA"): ("current", "mA"),
    ("current", "N m"): ("motor_torque", "N m"),
    ("current", "mN m"): ("motor_torque", "mN m"),
}
_WRAPPED = re.compile(r"([A-Za-z_]+[ _]?\d{0,4}) ?\(([^()]*[^\W\d][^()]*)\)")  # PROBE1(A1_ActPos)
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
        gain: of the unit, where the name states so many of it: 0.0001 of "0.0001 deg".
    """

    quantity: str
    unit: str
    words: tuple[str, ...]
    is_bare: bool = False
    gain: float = 1.0


def column_name(name: str) -> ColumnName:
    """Takes the name of a column apart."""
    if len(name) > _MAX_NAME:
        return ColumnName("", "", ())
    wrapped = _WRAPPED.fullmatch(name.strip())
    if wrapped and not unit_of(wrapped[2]) and not column_name(wrapped[1]).quantity:
        inner = column_name(wrapped[2])
        if inner.quantity and not names_quantity_alone(inner):
            return inner
    scaled = _SCALED_UNIT.search(name)
    if scaled and unit_of(scaled[2]):
        plain = column_name(f"{name[: scaled.start()]} {scaled[2]}")
        return plain._replace(gain=float(scaled[1]))
    unit, rest = _unit(_OBJECT.sub("", name.strip()))
    unit = unit or next((u for word, u in _PROGRAM_UNITS.items() if rest.endswith(word)), "")
    tokens = name_tokens(rest)
    if not unit:  # percent_1, or pos_deg_1
        unit = next((unit_of(token) for token in tokens if token in _INNER_UNITS), "")
        tokens = [token for token in tokens if token not in _INNER_UNITS]
    named = [key for key, words in QUANTITIES.items() if words & set(tokens)]
    quantity = named[0] if named else next(
        (key for key in QUANTITIES if unit in UNITS[key] and unit not in (PER_CENT, PER_MILLE)), ""
    )  # fmt: skip
    quantity, unit = _UNITS_OF_WORD.get((quantity, unit), (quantity, unit))
    is_of_motor = bool(_ROTATION_WORDS & set(tokens)) and (not unit or "motor" in tokens)
    if not tokens or _ASIDE & set(tokens) or is_of_motor:
        return ColumnName("", unit, tuple(tokens))
    quantity_words = set().union(*(QUANTITIES[key] for key in named))
    joint = tuple(token for token in tokens if token not in quantity_words)
    return ColumnName(quantity, unit, joint, not quantity and not unit and _is_bare(tokens))


def is_signal_word(token: str) -> bool:
    """Whether a word, or a number, may be of the name of a joint's signal."""
    return token.isdigit() or token in _AXIS_WORDS or any(token in x for x in QUANTITIES.values())


def is_commanded(name: str) -> bool:
    """Whether a column is a quantity that a controller commands: target_q_0."""
    tokens = set(name_tokens(name[:_MAX_NAME]))
    return bool(tokens & _COMMANDED) and any(tokens & words for words in QUANTITIES.values())


def names_quantity_alone(column: ColumnName) -> bool:
    """Whether a name is a quantity and no joint: position, actual_speed, motor current."""
    return bool(column.quantity) and set(column.words) <= _MEASURED


def is_of_drive(name: str) -> bool:
    """Whether a name may be of what is before a gear: Drehzahl, actuator_force."""
    return not (_ROTATION_WORDS | {"actuator"}).isdisjoint(name_tokens(name[:_MAX_NAME]))


def is_measured(column: ColumnName) -> bool:
    """Whether the name says that its value is measured."""
    return not _VALUE_WORDS.isdisjoint(column.words)


def is_raw(column: ColumnName) -> bool:
    """Whether the name says that its value is raw: before filters, or counts."""
    return "raw" in column.words


def is_qualified(column: ColumnName) -> bool:
    """Whether the name says that its value is raw or filtered."""
    return not _QUALIFIERS.isdisjoint(column.words)


def as_measured(words: tuple[str, ...]) -> tuple[str, ...]:
    """Words of a joint's command (qOut) as those of its measured value (qIn); others unchanged."""
    return tuple("in" if word == "out" else word for word in words)


def without_qualifiers(words: tuple[str, ...]) -> tuple[str, ...]:
    """Words of a joint without those that call its value raw or filtered."""
    return tuple(word for word in words if word not in _QUALIFIERS)


def without_value_words(words: tuple[str, ...]) -> tuple[str, ...]:
    """Words of a joint without those that call its value measured or actual."""
    return tuple(word for word in words if word not in _VALUE_WORDS)


def name_tokens(text: str) -> list[str]:
    """Words and numbers of a name, in lower case, without accents; AxisAct_A1 has four."""
    for word, words in _PROGRAM_WORDS.items():
        text = text.replace(word, words)
    plain = unicodedata.normalize("NFKD", text)
    plain = "".join(letter for letter in plain if not unicodedata.combining(letter))
    tokens = re.findall(rf"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+|[{_IDEOGRAMS}]+", plain)
    return [part for token in tokens for part in _compound_parts(token.lower())]


def without_joint_words(joint: str) -> str:
    """A joint's name, its words joined by _, without those that say no more than that it is one."""
    return "_".join(word for word in joint.split("_") if word not in _MEASURED) or joint


def _is_bare(tokens: list[str]) -> bool:
    """Whether a name is an axis with its number (J1, A1_Istwert), or an actual value or state."""
    words = {token for token in tokens if not token.isdigit()}
    is_numbered_axis = len(words) < len(tokens) and words <= _AXIS_WORDS | _VALUE_WORDS
    return bool(words) and (is_numbered_axis or bool(words & (_VALUE_WORDS | _STATE_WORDS)))


def _compound_parts(token: str) -> list[str]:
    """The parts of a compound: iststrom, motormoment, achswinkel, jointpos."""
    known = set().union(_ASIDE, _VALUE_WORDS, *QUANTITIES.values())
    for first in _FIRST_WORDS:
        rest = token.removeprefix(first)
        if rest not in (token, "") and token not in known:
            parts = _compound_parts(rest)
            if set(parts) <= known | set(_FIRST_WORDS):
                return [first, *parts]
    return [token]


def _unit(name: str) -> tuple[str, str]:
    """The unit in a column's name, in brackets or at its end, and the name without it.

    It may stand before the number of an array's entry: positions_deg.1, angle [deg][0].
    """
    number = _NUMBER_AT_END.search(name)
    parts = [name]
    if number is not None and not (number[0].isdigit() and _AXIS_LETTER.search(name)):
        parts.append(name[: number.start()])
    for part in parts:
        for pattern in (_IN_BRACKETS, _AT_END):
            for match in pattern.finditer(part):
                unit = unit_of(match[1])
                if unit and match.start():
                    rest = f"{part[: match.start()]} {name[match.end() :]}"
                    return unit, _without_unit(rest.strip(), unit)
    return "", name


def _without_unit(name: str, unit: str) -> str:
    """A name from which one unit was taken, without the same unit once more: pos_deg [deg]."""
    match = _AT_END.search(name)
    return name[: match.start()] if match and unit_of(match[1]) == unit else name
