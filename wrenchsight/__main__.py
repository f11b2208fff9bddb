"""The command line by the product's name: `wrenchsight` or `python -m wrenchsight`."""

import sys


def main() -> None:
    """Entry point of the console script."""
    try:
        import signal

        if signal.getsignal(signal.SIGINT) == signal.default_int_handler:
            # Not by an exception, which a destructor or a callback of the imports would drop.
            signal.signal(signal.SIGINT, _end_at_once)
        from wrenchsight.analyses.__main__ import main as command_line

        if signal.getsignal(signal.SIGINT) == _end_at_once:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        command_line()
    except KeyboardInterrupt:  # before the command had begun
        sys.stderr.write("interrupted\n")
        raise SystemExit(130) from None


def _end_at_once(signum: int, frame: object) -> None:
    """Ends the process before a command has begun: there is nothing yet to put in order."""
    import os

    sys.stderr.write("interrupted\n")
    sys.stderr.flush()
    os._exit(128 + signum)


if __name__ == "__main__":
    main()
