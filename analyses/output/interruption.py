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

_ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_REPEAT_DELAY = 0.01  # s after which an end that was lost is raised once more


class TerminatedError(KeyboardInterrupt):
    """The command was asked to end: by `kill`, or because its terminal was closed."""

    def __init__(self, signum: int) -> None:
        super().__init__(signal.Signals(signum).name)
        self.signum = signum


@contextmanager
def ends_are_interrupts() -> Iterator[list[int]]:
    """Raises `TerminatedError` in the block where SIGTERM or SIGHUP would end the process.

    Python drops what is raised inside a destructor or a weak reference's callback, and prints a
    traceback: such an exception is raised again some milliseconds later.

    Yields:
        The numbers of the signals received, SIGINT included: a library whose work was cut off, or
        whose import, may turn the exception into one of its own.
    """
    received: list[int] = []

    def end(signum: int, frame: FrameType | None) -> None:
        received.append(signum)
        if signum == signal.SIGINT:
            signal.default_int_handler(signum, frame)
        raise TerminatedError(signum)

    def resume_dropped(unraisable: Any) -> None:
        if received and isinstance(unraisable.exc_value, KeyboardInterrupt):
            # Not by `threading`, in whose locks the interrupted code may be.
            _thread.start_new_thread(end_again, (received[-1],))
        else:
            earlier_hook(unraisable)

    def end_again(signum: int) -> None:
        time.sleep(_REPEAT_DELAY)
        if sys.unraisablehook is resume_dropped:  # the block goes on
            signal.pthread_kill(main_thread, signum)

    if threading.current_thread() is not threading.main_thread():  # which alone gets signals
        yield received
        return
    handlers = {number: signal.getsignal(number) for number in _ENDS}
    for number, handler in handlers.items():
        # Not what is ignored: SIGHUP below nohup, SIGINT in the background of a shell.
        if handler in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, end)
    main_thread, earlier_hook = threading.get_ident(), sys.unraisablehook
    if end in map(signal.getsignal, _ENDS):  # not within another such block
        sys.unraisablehook = resume_dropped
    try:
        yield received
    finally:
        sys.unraisablehook = earlier_hook
        for number, handler in handlers.items():
            if handler is not None:
                signal.signal(number, handler)


@contextmanager
def uninterrupted() -> Iterator[Callable[[], AbstractContextManager[None]]]:
    """Holds SIGINT, SIGTERM and SIGHUP back until the block has ended.

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
    handlers = {number: signal.getsignal(number) for number in _ENDS}
    restorable = [
        number for number, h in handlers.items() if h is not None
    ]  # None: it is not Python's
    held = [number for number in restorable if handlers[number] != signal.SIG_IGN]

    def act() -> None:
        for number in restorable:
            signal.signal(number, handlers[number])
        if waiting:
            signal.raise_signal(waiting.pop(0))

    @contextmanager
    def interruptible() -> Iterator[None]:
        try:
            act()
            yield
        finally:
            for number in held:
                signal.signal(number, hold)

    for number in held:
        signal.signal(number, hold)
    try:
        yield interruptible
    finally:
        act()


@contextmanager
def for_this_process_alone() -> Iterator[None]:
    """Holds signals back from processes that start within the block, for all of their lives.

    Those that it starts besides, such as multiprocessing's resource tracker, would else die of a
    signal to the whole group.
    """
    earlier_mask = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDS)
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
    for number in _ENDS:
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
