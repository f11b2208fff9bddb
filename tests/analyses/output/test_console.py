"""What commands print: nothing that a file says reaches a terminal as a command to it."""

import io

from rich.console import Console

from wrenchsight.analyses.output.console import new_table, plain_text, say
from wrenchsight.analyses.output.progress import Progress, ProgressDisplay

_ODD = "a\x1b[31mb\x9b2J\rc"
_SHOWN = r"a\x1b[31mb\x9b2J\rc"


def _printed(show) -> str:
    console = Console(file=io.StringIO(), width=120)
    show(console)
    return console.file.getvalue()


def test_escape_sequences_are_shown():
    assert _printed(lambda console: say(console, f"one\n{_ODD}")) == f"one\n{_SHOWN}\n"
    table = new_table("joint", "torque")
    table.add_row(_ODD, "1")
    assert _SHOWN in _printed(lambda c: c.print(table))
    assert plain_text(f"`{_ODD}`").plain == _SHOWN


def test_square_brackets_in_tables_are_shown():
    """Units of headings, and names of joints: none of them is a markup."""
    table = new_table("joint [red]", "closest\n[mm]", "rotor\n[kg m^2]", "[rad]")
    table.add_row("[/b]elbow[a]", "[s]", "1", "2")
    shown = _printed(lambda console: console.print(table))
    for text in ("joint [red]", "[mm]", "[kg m^2]", "[rad]", "[/b]elbow[a]", "[s]"):
        assert text in shown


def test_control_characters_in_progress_are_escaped():
    def follow(console):
        with ProgressDisplay(console, ("work",)) as watch:
            watch(Progress("work", "failed", action=_ODD))

    assert _SHOWN in _printed(follow)
    assert "\x1b[31m" not in _printed(follow)
