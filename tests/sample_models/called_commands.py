"""The command line, called in this process."""

from typing import Any

from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app


def invoke(*words: object) -> Any:
    """Exit code, stdout and stderr of the program."""
    return CliRunner().invoke(app, [str(word) for word in words])


def succeeded(*words: object) -> str:
    """All that the program says on its way to a good end."""
    result = invoke(*words)
    assert result.exit_code == 0, f"{words}: {result.output}{result.stderr}"
    return str(result.stdout + result.stderr)


def refused(*words: object) -> str:
    """The one line that the program says where it refuses."""
    result = invoke(*words)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.endswith("\n") and result.stderr.count("\n") == 1
    return str(result.stderr)
