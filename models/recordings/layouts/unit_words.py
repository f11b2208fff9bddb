"""Units as logs write them (`°/s`, `deg_s`, `U/min`, `Nm`), and as descriptions of columns do."""

import re
from typing import Final

from wrenchsight.models.recordings.recording_format import PER_CENT, PER_MILLE

_SPELLINGS: Final = {  # by the unit of a description; compared in lower case, without blanks
    "s": "s sec secs second seconds sek sekunden segundos secondes secondi 秒",
    "ms": "ms msec msecs millis millisec milliseconds milliseconden millisekunden 毫秒",
    "us": "us µs μs usec usecs micros microseconds mikrosekunden 微秒",
    "ns": "ns nsec nsecs nanos nanosec nanosecs nanoseconds 纳秒",
    "days": "days tage",
    "rad": "rad rads radian radians radianes radianti 弧度",
    "deg": "deg degs degree degrees ° º grad grd grado grados gradi degre degres 度",
    "rev": "rev revs turn turns revolution revolutions umdr u",
    "mm": "mm",
    "m": "m",
    "rad/s": "rad/s rad_s rads-1 rad*s^-1 rad.s-1 rad·s⁻¹ radps rad_per_s rad_per_sec rad/sec "
    "radians/s radian/s rad/second 弧度/秒",
    "deg/s": "deg/s °/s º/s deg_s degps dps deg_per_s deg_per_sec deg/sec degrees/s grad/s grd/s "
    "gradi/s grados/s °/sec 度/秒",
    "rpm": "rpm r/min rev/min u/min 1/min min-1 min^-1 upm 转/分",
    "rev/s": "rev/s rev_s turns/s turns_s 1/s",
    "mm/s": "mm/s mm_s",
    "m/s": "m/s m_s",
    "A": "a amp amps ampere amperes aeff arms a_rms apk 安 安培",
    "mA": "ma milliamp milliamps milliampere 毫安",
    "N m": "nm n*m n.m n·m n⋅m newtonmeter n-m 牛米",
    "mN m": "mnm mn*m mn.m mn·m",
    "N": "n",
    PER_CENT: "% percent pct prozent %rated",
    PER_MILLE: "‰ permille promille permil 0.1% 0,1%",
}
UNIT_OF_SPELLING: Final = {
    spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings.split()
}
"""The unit of a description, by a spelling in lower case without blanks."""
_LONGEST_UNIT: Final = 20  # characters


def unit_of(text: str) -> str:
    """The unit that a text is, perhaps in brackets, as descriptions have it; '' for none."""
    text = text.strip().strip("[](){}<>'\"").strip()
    if len(text) > _LONGEST_UNIT:
        return ""
    return UNIT_OF_SPELLING.get(re.sub(r"\s", "", text).lower(), "")
