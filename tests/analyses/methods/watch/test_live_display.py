"""What a person sees of a live robot."""

import io

import numpy as np
import pytest
from rich.console import Console

from wrenchsight.analyses.methods.watch.live_display import LiveSummary, say_event
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import EventKind, StreamEvent


def rows(count, valid=1.0, link=0.0):
    display_rows = []
    for k in range(count):
        zero = np.zeros(6)
        reading = Reading.of(
            np.arange(1.0, 7.0),
            np.diag(np.arange(1.0, 7.0) ** 2),
            zero,
            zero,
            t=5.0 + 0.002 * k,
            received=1.0,
            invalid=1.0 - valid,
            contact=1.0,
            misfit=float(link > 0),
            link=link,
        )
        reading.publish(1.0003)
        display_rows.append(reading.row)
    return np.array(display_rows)


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
    assert "NOT VALID (settling), contact, misfit at link 3" in summary.line()


def timed(times):
    """Rows of readings that came and went at these times, s."""
    display_rows = rows(len(times))
    for row, (received, published) in zip(display_rows, times, strict=True):
        row[1:3] = received, published
    return display_rows


def queue(arrivals, ready, work):
    """(came, went) of samples that an estimator takes one by one, from `ready` s on."""
    out, free = [], ready
    for came in arrivals:
        free = max(free, came) + work
        out.append((came, free))
    return out


def test_start_up_is_no_latency_and_is_said_once():
    # Samples of 500 Hz; the estimator knows their step after 0.46 s, and takes 0.5 ms for each.
    summary = LiveSummary("x")
    times = queue(10.0 + 0.002 * np.arange(2000), 10.4598, 0.0005)
    lines = []
    for k in range(0, 2000, 100):
        lines += summary.add(timed(times[k : k + 100]), [])
    p50, p99 = summary.latencies()
    assert p50 == pytest.approx(0.5, rel=1e-6)
    assert p99 == pytest.approx(0.5, rel=1e-6)
    (event,) = lines
    assert event.kind is EventKind.START_UP
    waited = sum(went - came > 0.000501 for came, went in times)
    assert event.text.startswith(f"the first {waited} samples waited for the estimator to start, ")
    assert "460 ms at most" in event.text
    assert "start-up" in shown(summary)


def test_latency_after_start_up_is_shown():
    summary = LiveSummary("x")
    times = queue(10.0 + 0.002 * np.arange(1000), 10.46, 0.0005)
    summary.add(timed(times), [])
    stalled = queue(12.0 + 0.002 * np.arange(1000), 12.3, 0.0005)
    assert summary.add(timed(stalled), []) == []
    assert summary.latencies()[1] > 200.0


def test_an_estimator_that_never_keeps_up_is_late():
    summary = LiveSummary("x")
    (event,) = summary.add(timed(queue(0.002 * np.arange(4000), 0.46, 0.0025)), [])
    assert event.kind is EventKind.START_UP
    assert summary.latencies()[0] > 1000.0


def test_a_stream_without_start_up_counts_from_its_first_sample():
    summary = LiveSummary("x")
    times = [(1.0, 1.002), *queue(1.1 + 0.002 * np.arange(9), 1.1, 0.0005)]
    assert summary.add(timed(times), []) == []
    assert summary.latencies()[1] > 1.5
    assert "starting" in LiveSummary("x").line()


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
