"""The command line by the product's name: `wrenchsight` or `python -m wrenchsight`."""

import sys

import wrenchsight


def main() -> None:
    """Entry point of the console script; ends in one line if our packages cannot be reached."""
    try:
        try:
            wrenchsight.refuse_shadows()
        except ImportError as error:
            sys.stderr.write(f"{error}\n")
            raise SystemExit(2) from None
        from analyses.__main__ import main as command_line

        command_line()
    except KeyboardInterrupt:  # before the command had begun
        sys.stderr.write("interrupted\n")
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
