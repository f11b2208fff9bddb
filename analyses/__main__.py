"""The command line: `python -m analyses COMMAND`, or `wrenchsight COMMAND`.

Commands are modules of `analyses.commands`, found and summed up without importing them: help
answers at once.
"""

import errno
import signal
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from wrenchsight.analyses.commands.discovery import find_commands, load_command
from wrenchsight.analyses.output.interruption import signals_are_interrupts
from wrenchsight.models.files.files_read import remembering_files_read
from wrenchsight.models.files.input_error import InputError, one_line

_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_INTERRUPTED = "interrupted; what was written is whole"


class _Commands(TyperGroup):
    """Imports a command's module when it is to run, and not before.

    An error that a user can cause ends in one line on stderr and exit code 2; after Ctrl-C the code
    is 130, after SIGTERM 143, as a shell expects.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        return list(find_commands())

    def get_command(self, ctx: Any, cmd_name: str) -> TyperCommand | None:
        entry = find_commands().get(cmd_name)
        return None if entry is None else TyperCommand(cmd_name, help=entry.summary)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and not args[0].startswith("-") and args[0] not in find_commands():
            near = get_close_matches(args[0], find_commands(), n=1)
            hint = f'; did you mean "{near[0]}"?' if near else ""
            ctx.fail(f'there is no command "{args[0]}"{hint}')
        name, command, arguments = super().resolve_command(ctx, args)
        return name, command and load_command(find_commands()[str(command.name)]), arguments

    def main(self, args: Sequence[str] | None = None, *more: Any, **extra: Any) -> Any:
        """Runs a command and ends the process; a usage error is one line, like every other
        error."""
        self._has_reported = False
        try:
            code = super().main(args, *more, **{**extra, "standalone_mode": False})
            if code == 130 and not self._has_reported:  # before a command began
                _report("interrupted", code)
        except Exception as raised:
            error: Any = raised
            if not hasattr(error, "format_message"):  # the class's module differs by release
                raise
            if "NoArgsIsHelp" in type(error).__name__:
                error.show()
                code = 2
            else:
                context = getattr(error, "ctx", None)
                path = "wrenchsight" if context is None else context.command_path
                code = _report(f"{path}: {error.format_message()} (options: {path} --help)", 2)
        sys.exit(code if isinstance(code, int) else 0)

    def invoke(self, ctx: Any) -> Any:
        """Runs the command; an error of the user becomes one line and the exit code 2.

        A signal that ends the process becomes the exit code 128 + its number, also where a library
        turned the exception that it raised into one of its own. An error of the program is raised.
        The line is reported here: `main` is not to report an interrupt once more.
        """
        signals: list[int] = []  # numbers of those received; none before the block is entered
        try:
            # Files read from here on are known to `result_folder`, which refuses to replace them.
            with signals_are_interrupts() as signals, remembering_files_read():
                return super().invoke(ctx)
        except InputError as error:
            line, code = str(error), 2
        except MemoryError:
            line, code = "not enough memory; free some and run again", 2
        except OSError as error:
            if error.errno == errno.EPIPE:  # the reader of our output left: typer ends, silently
                raise
            reason = error.strerror or str(error)
            if error.errno in _NO_SPACE and not error.filename:
                reason = f"a file cannot be written ({reason}); free some space and run again"
            line, code = f"{error.filename}: {reason}" if error.filename else reason, 2
        except KeyboardInterrupt as error:
            # A command may have caught the signal's own exception, a TerminatedError with its
            # number, to end in good order, and raised another one.
            first_signal = signals[0] if signals else getattr(error, "signum", signal.SIGINT)
            line, code = _INTERRUPTED, 128 + first_signal
        except Exception:
            if not signals:  # an error of the program
                raise
            line, code = _INTERRUPTED, 128 + signals[0]
        self._has_reported = True
        raise typer.Exit(_report(line, code))


def _report(line: str, code: int) -> int:
    """Writes the one line that the user reads; returns the exit code."""
    sys.stderr.write(one_line(line) + "\n")
    return code


_HELP = """Estimates the wrench at an industrial arm's tool from its motor currents.

First look:  wrenchsight demo

Description of an arm:  wrenchsight robot ARM.urdf, then wrenchsight excite --robot robot.yaml

Its dynamic model:  wrenchsight identify LOG --robot robot.yaml

Force at the tool:  wrenchsight estimate LOG --robot robot.yaml --model model.yaml

Place of a task:  wrenchsight place --task linear_path --robot robot.yaml

Test of the method:  wrenchsight simulate, wrenchsight study
"""

app = typer.Typer(
    name="wrenchsight",
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,  # a traceback here is a defect: whole and plain
    help=_HELP,
)


def _version(wanted: bool) -> None:
    if wanted:
        from wrenchsight.analyses.study.study import software_version

        sys.stdout.write(f"wrenchsight {software_version()}\n")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Holds the options that belong to no command."""


def main() -> None:
    """Entry point of the console script."""
    app(prog_name="wrenchsight")


if __name__ == "__main__":
    main()
