"""The tables of docs/faults.md."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from wrenchsight.analyses.study.experiment import ResultTable

_SHIFTS: Final = tuple(
    f"{way}_{milliseconds}_ms" for way in ("late", "early") for milliseconds in (200, 300, 500)
)
WORDS: Final[Mapping[str, tuple[str, Sequence[str]]]] = {
    "undamaged": ("nothing", ("none",)),
    "shifted_50_ms": ("currents 50 ms late or early", ("late_50_ms", "early_50_ms")),
    "shifted_100_ms": ("currents 0.1 s late or early", ("late_100_ms", "early_100_ms")),
    "shifted_200_to_500_ms": ("currents 0.2 to 0.5 s late or early", _SHIFTS),
    "shifted_1_or_2_s": (
        "currents 1 or 2 s late or early",
        ("late_1000_ms", "early_1000_ms", "late_2000_ms", "early_2000_ms"),
    ),
    "averaged_100_ms": ("currents averaged over 0.1 s", ("averaged_100_ms",)),
    "averaged_250_ms": ("currents averaged over 0.25 s", ("averaged_250_ms",)),
    "averaged_500_ms": ("currents averaged over 0.5 s", ("averaged_500_ms",)),
    "centred_300_ms": ("currents averaged over 0.3 s about each sample", ("centred_300_ms",)),
    "centred_500_ms": ("currents averaged over 0.5 s about each sample", ("centred_500_ms",)),
    "drives_reordered": (
        "currents in another order: by name, backwards, two exchanged",
        ("drives_by_name", "drives_backwards", "drives_4_5", "drives_5_6"),
    ),
    "joints_exchanged": (
        "positions and velocities of two joints exchanged",
        ("joints_2_3", "joints_4_5"),
    ),
    "drives_turned": (
        "current of one joint, or of all, of the opposite sign",
        ("drive_1_turned", "drive_3_turned", "drive_5_turned", "drives_turned"),
    ),
    "joint_turned": ("a joint counts the other way", ("joint_2_turned", "joint_4_turned")),
    "zero_20_mrad": ("zero of the shoulder lift off by 0.02 rad", ("zero_2_20_mrad",)),
    "zero_50_mrad": ("zero of the shoulder lift off by 0.05 rad", ("zero_2_50_mrad",)),
    "zero_large": (
        "zero of the elbow off by 0.1 rad, of a wrist by a quarter turn",
        ("zero_3_100_mrad", "zero_4_quarter"),
    ),
    "mounting": ("wall, ceiling", ("wall", "ceiling")),
    "tilted_5_deg": ("base tilted by 5 deg", ("tilted_5_deg",)),
    "gravity_missing": ("torque without gravity", ("gravity_missing",)),
    "gain": (
        "milliamperes; one current doubled or halved",
        ("milliamperes", "drive_3_doubled", "drive_2_half"),
    ),
    "common_gain": ("all currents 1.15 or 0.87 times as large", ("all_times_115", "all_times_87")),
    "unsigned": ("currents without sign", ("unsigned",)),
}
"""By row of the table of whole logs: its words, and the kinds of damage that it has."""
ROWS: Final = {row: kinds for row, (_, kinds) in WORDS.items()}
BEGUN_WORDS: Final[Mapping[str, str]] = {
    "sign": "sign of one current turned",
    "doubled": "one current doubled",
    "offset": "2.5 A more or less in one motor",
    "noise": "noise of 3 A in one motor",
    "drift": "drift of 1 A/s, up or down, in one motor",
    "exchanged": "two currents exchanged",
    "late_100_to_300_ms": "all currents 0.1 to 0.3 s late",
    "late_500_ms": "all currents 0.5 s late",
    "late_650_to_1000_ms": "all currents 0.65 to 1 s late",
    "late_1300_ms": "all currents 1.3 s late",
    "early_100_to_300_ms": "all currents 0.1 to 0.3 s early",
    "early_500_ms": "all currents 0.5 s early",
    "early_650_to_1000_ms": "all currents 0.65 to 1 s early",
    "early_1300_ms": "all currents 1.3 s early",
}
PUSH_WORDS: Final[Mapping[str, str]] = {
    "none": "no push",
    "held": "held",
    "sine_1_hz": "swelling at 1 Hz",
    "sine_2_hz": "to and fro at 2 Hz",
    "by_hand": "by hand, at random",
    "growing": "growing for 3 s",
    "turning": "turning",
    "all": "all pushes",
}


def tables(metrics: Mapping[str, Any]) -> tuple[ResultTable, ...]:
    """The tables of a run: faults that begin in a log, pushes, and logs that are wrong whole."""
    begun_heads = ["fault", "number", "longest [s]", "of it checked [s]", "over 0.5 s"]
    begun_rows = [
        [
            words,
            f"<begun.{kind}.number:d>",
            f"<begun.{kind}.valid_and_wrong_s:.2f>",
            f"<begun.{kind}.checked_valid_and_wrong_s:.2f>",
            f"<begun.{kind}.too_long:d>",
        ]
        for kind, words in BEGUN_WORDS.items()
    ]
    push_heads = ["push", "number", "lost [%]", "of it checked [%]", "worst push [%]"]
    push_rows = [
        [
            words,
            f"<pushes.{course}.number:d>",
            f"<pushes.{course}.wrong_signal_pct:.2f>",
            f"<pushes.{course}.checked_wrong_signal_pct:.2f>",
            f"<pushes.{course}.worst_wrong_signal_pct:.0f>",
        ]
        for course, words in PUSH_WORDS.items()
    ]
    log_heads = ["damage", "named", "after [s]", "valid and wrong [s]", "largest [N]"]
    log_rows = [
        [
            words,
            f"<rows.{row}.named:d> of <rows.{row}.number:d>",
            f"<rows.{row}.recognised_after_s:.0f>",
            f"<rows.{row}.valid_and_wrong_s:.1f>",
            f"<rows.{row}.largest_n:.1f>",
        ]
        for row, (words, _) in WORDS.items()
    ]
    return (
        ResultTable("begun", "Faults that begin in a log", begun_heads, begun_rows),
        ResultTable("pushes", "Pushes taken for wrong signals", push_heads, push_rows),
        ResultTable("logs", "Logs that are wrong as a whole", log_heads, log_rows),
    )
