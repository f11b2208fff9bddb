"""Signals that end a command: raised as exceptions or held back, here and in worker processes."""

import _thread
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from types import FrameType
from typing import Any

_END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_REPEAT_DELAY = 0.01
"""s until a dropped exception is raised once more. Python should then have left the destructor that
dropped it; where it has not, it drops the exception again, which is raised again as late."""


class TerminatedError(KeyboardInterrupt):
    """The command was asked to end: by `kill`, or because its terminal was closed."""

    def __init__(self, signum: int) -> None:
        super().__init__(signal.Signals(signum).name)
        self.signum = signum


class _Interrupter:
    """Raises exceptions for signals in the main thread, where it is made.

    Attributes:
        received: numbers of the signals, in the order in which they came; one that is raised once
            more counts again.
    """

    def __init__(self) -> None:
        self.received: list[int] = []
        self._main_thread = threading.get_ident()
        self._is_active = False
        self._earlier_hook = sys.unraisablehook

    def interrupt(self, signum: int, frame: FrameType | None) -> None:
        """Handler of a signal: raises its exception in what the main thread does."""
        self.received.append(signum)
        if signum == signal.SIGINT:
            raise KeyboardInterrupt
        raise TerminatedError(signum)

    @contextmanager
    def raising_dropped(self) -> Iterator[None]:
        """Raises an exception of `interrupt` once more where Python drops it, within the block."""
        sys.unraisablehook = self._take_dropped
        self._is_active = True
        try:
            yield
        finally:
            self._is_active = False
            sys.unraisablehook = self._earlier_hook

    def _take_dropped(self, unraisable: Any) -> None:
        """Takes what Python drops in a destructor or a callback (`sys.unraisablehook`)."""
        if self.received and isinstance(unraisable.exc_value, KeyboardInterrupt):
            # Not by `threading`, in whose locks the interrupted code may be.
            _thread.start_new_thread(self._send_again, (self.received[-1],))
        else:
            self._earlier_hook(unraisable)

    def _send_again(self, signum: int) -> None:
        time.sleep(_REPEAT_DELAY)
        if self._is_active:
            signal.pthread_kill(self._main_thread, signum)


@contextmanager
def signals_are_interrupts() -> Iterator[list[int]]:
    """Raises `TerminatedError` in the block where SIGTERM or SIGHUP would end the process.

    SIGINT raises KeyboardInterrupt. A signal that has another handler keeps it: one that is ignored
    (SIGHUP below nohup, SIGINT in the background of a shell) is ignored, and within another such
    block the outer one acts. Outside the main thread, which alone gets signals, nothing changes.

    Python drops what is raised inside a destructor or a weak reference's callback, and prints a
    traceback: such an exception is raised again some milliseconds later.

    Yields:
        The numbers of the signals received, SIGINT included: a library whose work was cut off, or
        whose import, may turn the exception into one of its own.
    """
    if threading.current_thread() is not threading.main_thread():
        yield []
        return
    interrupter = _Interrupter()
    handlers = {number: signal.getsignal(number) for number in _END_SIGNALS}
    # Python's own handler of SIGINT is what raises KeyboardInterrupt without us.
    taken_over = [
        number
        for number, handler in handlers.items()
        if handler in (signal.SIG_DFL, signal.default_int_handler)
    ]
    for number in taken_over:
        signal.signal(number, interrupter.interrupt)
    try:
        with interrupter.raising_dropped() if taken_over else nullcontext():
            yield interrupter.received
    finally:
        # All of them: what the block itself has set is undone, too.
        for number, handler in handlers.items():
            if handler is not None:  # None: it was not set by Python, which cannot set it again
                signal.signal(number, handler)


@contextmanager
def uninterrupted() -> Iterator[Callable[[], AbstractContextManager[None]]]:
    """Holds SIGINT, SIGTERM and SIGHUP back until the block has ended.

    The first that came then acts by the handler that it had before the block, which may raise; what
    came after it is dropped. Outside the main thread, which alone gets signals, nothing is held.

    Not by the thread's signal mask: a signal to the process would then reach another thread, of a
    numerical library, and Python's handler would still run here.

    Yields:
        A context in which they act: what is around it is then done whole, whenever they come.
    """
    waiting: list[int] = []

    def hold(signum: int, frame: object) -> None:
        waiting.append(signum)

    if threading.current_thread() is not threading.main_thread():
        yield nullcontext
        return
    handlers = {number: signal.getsignal(number) for number in _END_SIGNALS}
    # None: a handler was not set by Python, which cannot set it again.
    restorable = [number for number, handler in handlers.items() if handler is not None]
    held = [number for number in restorable if handlers[number] != signal.SIG_IGN]

    def let_act() -> None:
        """Restores the handlers, then passes the first signal that waits to its own.

        Those behind it are dropped, before it acts: it may raise.
        """
        for number in restorable:
            signal.signal(number, handlers[number])
        first = waiting[:1]
        waiting.clear()
        for signum in first:
            signal.raise_signal(signum)

    @contextmanager
    def interruptible() -> Iterator[None]:
        try:
            let_act()
            yield
        finally:
            for number in held:
                signal.signal(number, hold)

    for number in held:
        signal.signal(number, hold)
    try:
        yield interruptible
    finally:
        let_act()


@contextmanager
def for_this_process_alone() -> Iterator[None]:
    """Holds signals back from processes that start within the block, for all of their lives.

    Those that it starts besides, such as multiprocessing's resource tracker, would else die of a
    signal to the whole group.
    """
    earlier_mask = signal.pthread_sigmask(signal.SIG_BLOCK, _END_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, earlier_mask)


def begin_worker(parent: int, log: str | Path) -> None:
    """Runs first in a process of ours: it ends with its parent, and prints into a file.

    Args:
        parent: number of the process that started it.
        log: file that takes what Drake or numba print, which would tear progress lines apart.
    """
    # The terminal and `kill` tell the whole group; it is the parent that ends this process.
    for number in _END_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    with suppress(AttributeError, OSError):  # not Linux
        ctypes.CDLL(None).prctl(1, int(signal.SIGKILL))  # 1: PR_SET_PDEATHSIG
    if os.getppid() != parent:  # it was faster
        os._exit(1)
    with suppress(OSError):
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        sys.stdout.flush()
        os.dup2(descriptor, 1)
        os.dup2(descriptor, 2)
