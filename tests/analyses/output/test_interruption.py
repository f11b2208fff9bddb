"""Signals that end a command."""

import os
import signal
import sys
import time
import weakref

import pytest

from wrenchsight.analyses.output.interruption import (
    TerminatedError,
    signals_are_interrupts,
    uninterrupted,
)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_an_end_is_an_exception_that_names_its_signal(number):
    with pytest.raises(TerminatedError, match=number.name) as caught, signals_are_interrupts():
        os.kill(os.getpid(), number)
    assert caught.value.signum == number
    assert signal.getsignal(number) == signal.SIG_DFL


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_end_that_a_library_makes_its_own_error_is_still_known(number):
    before = signal.getsignal(number)
    with pytest.raises(ImportError), signals_are_interrupts() as came:
        try:
            os.kill(os.getpid(), number)
        except KeyboardInterrupt as error:
            raise ImportError("initialization failed") from error
    assert came == [number]
    assert signal.getsignal(number) == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_end_inside_a_callback_that_drops_exceptions_is_raised_again(number, capfd):
    class Node:
        pass

    node = Node()
    reference = weakref.ref(node, lambda _: os.kill(os.getpid(), number))
    assert reference() is node
    before = sys.unraisablehook
    with pytest.raises(KeyboardInterrupt) as caught, signals_are_interrupts() as came:
        del node  # the handler runs inside the callback
        for _ in range(500):
            time.sleep(0.01)
    assert set(came) == {number}
    assert getattr(caught.value, "signum", signal.SIGINT) == number
    assert capfd.readouterr().err == ""
    assert sys.unraisablehook is before


def test_other_exceptions_that_python_drops_are_told_as_before(monkeypatch):
    class Careless:
        def __del__(self):
            raise ValueError("lost")

    messages = []
    monkeypatch.setattr(
        sys, "unraisablehook", lambda unraisable: messages.append(str(unraisable.exc_value))
    )
    with signals_are_interrupts():
        Careless()
    assert messages == ["lost"]


def test_an_ignored_end_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with signals_are_interrupts(), uninterrupted():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize(
    ("number", "error"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, TerminatedError)]
)
def test_an_interrupt_waits_for_the_end_of_the_block(number, error):
    steps = []
    with pytest.raises(error), signals_are_interrupts():
        with uninterrupted():
            os.kill(os.getpid(), number)
            os.kill(os.getpid(), number)
            steps.append("inside")
        steps.append("behind")
    assert steps == ["inside"]


@pytest.mark.parametrize("when", ["before", "within", "after"])
def test_an_interrupt_acts_where_it_may_and_leaves_what_is_around_whole(when):
    steps = []
    with (
        pytest.raises(TerminatedError),
        signals_are_interrupts(),
        uninterrupted() as interruptible,
    ):
        try:
            if when == "before":
                os.kill(os.getpid(), signal.SIGTERM)
            steps.append("before")
            with interruptible():
                if when == "within":
                    os.kill(os.getpid(), signal.SIGTERM)
                steps.append("within")
        finally:
            if when == "after":
                os.kill(os.getpid(), signal.SIGTERM)
            steps.append("after")
    assert steps == (["before", "within", "after"] if when == "after" else ["before", "after"])
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_of_several_interrupts_that_wait_only_the_first_acts():
    came = []
    earlier = signal.signal(signal.SIGTERM, lambda number, frame: came.append(number))
    try:
        with uninterrupted() as interruptible:
            os.kill(os.getpid(), signal.SIGTERM)
            os.kill(os.getpid(), signal.SIGTERM)
            os.kill(os.getpid(), signal.SIGINT)
            with interruptible():
                pass
    finally:
        signal.signal(signal.SIGTERM, earlier)
    assert came == [signal.SIGTERM]


def test_without_a_signal_nothing_happens():
    before = signal.getsignal(signal.SIGINT)
    with uninterrupted():
        pass
    assert signal.getsignal(signal.SIGINT) == before
