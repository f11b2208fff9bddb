"""What a person sees of a live robot."""

import io

import numpy as np
from rich.console import Console

from wrenchsight.analyses.methods.live.live_display import LiveSummary, say_event
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, StreamEvent


def rows(count, valid=1.0, link=0.0):
    found = []
    for k in range(count):
        zero = np.zeros(6)
        reading = Reading.of(
            *(np.arange(1.0, 7.0), np.diag(np.arange(1.0, 7.0) ** 2), zero, zero),
            t=5.0 + 0.002 * k,
            received=1.0,
            valid=valid,
            contact=1.0,
            misfit=float(link > 0),
            link=link,
        )
        reading.publish(1.0003)
        found.append(reading.row)
    return np.array(found)


def shown(summary, width=120):
    console = Console(file=io.StringIO(), width=width, force_terminal=True, color_system=None)
    console.print(summary.picture())
    return console.file.getvalue()


def test_numbers_and_state_are_shown_force_first():
    summary = LiveSummary("rtde://robot")
    assert "waiting" in shown(summary)
    summary.add(rows(100), [])
    text = shown(summary)
    assert [line.split()[:3] for line in text.splitlines() if line.startswith(("fx", "mz"))] == [
        ["fx", "4.00", "4.00"],
        ["mz", "3.00", "3.00"],
    ]
    assert "valid, contact" in text
    assert "500 Hz, latency 0.30 ms (p99 0.30), 100 % valid, 100 readings" in text
    assert "fx 4.0+-4.0" in summary.line()
    summary.add(rows(1, valid=0.0, link=3.0), [])
    assert "NOT VALID, contact, misfit at link 3" in summary.line()


def test_a_reading_that_is_no_longer_valid_counts_once():
    summary = LiveSummary("x")
    one = rows(1)
    summary.add(one, [])
    summary.add(np.array([Reading(one[0]).unusable(2.0).row]), [])
    assert summary.count == 1
    assert not summary.last.valid


def test_nothing_from_the_wire_is_obeyed():
    summary = LiveSummary("rtde://x\x1b[2J[bold]")
    event = StreamEvent(EventKind.REFUSED, "\x1b]0;title\x07 [red]no[/red]\nsecond line", 0.0, 2)
    summary.add(rows(1), [event])
    text = shown(summary)
    assert "\x1b]0" not in text
    assert "\x1b[2J" not in text
    assert "[red]no[/red] second line" in text
    console = Console(file=io.StringIO(), width=120)
    say_event(console, event)
    line = console.file.getvalue()
    assert line.count("\n") == 1
    assert "(2 so far)" in line
