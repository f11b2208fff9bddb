"""Commands are found by their modules, and summed up without importing them."""

from importlib.metadata import EntryPoint

import pytest
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.analyses.commands import discovery
from wrenchsight.analyses.commands.discovery import find_commands, load_command
from wrenchsight.models.files.input_error import InputError

_MODULE = '''
"""A command of another package."""

import sys

ORDER = 11


def command(loud: bool = False) -> None:
    """Greet.

    More about it.
    """
    sys.stdout.write("HELLO" if loud else "hello")
'''


@pytest.fixture
def offered(tmp_path, monkeypatch):
    """Returns a function that has an installed package offer a module as a command."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def offer(name, text):
        (tmp_path / f"{name}.py").write_text(text)
        points = [EntryPoint(name, name, discovery.ENTRY_POINTS)]
        monkeypatch.setattr(discovery, "entry_points", lambda group: points)

    return offer


def test_every_command_has_a_summary_and_options():
    for name, entry in find_commands().items():
        assert entry.summary.endswith("."), name
        assert entry.summary in (load_command(entry).help or ""), name


def test_another_package_adds_a_command_by_its_module(offered):
    offered("say_hello", _MODULE)
    names = list(find_commands())
    assert names[names.index("study") + 1] == "say-hello"  # by its ORDER
    assert "Greet." in CliRunner().invoke(app, ["--help"]).output
    assert CliRunner().invoke(app, ["say-hello", "--loud"]).output == "HELLO"


def test_a_module_that_is_no_command_is_named(offered):
    offered("no_command", "x = 1\n")
    with pytest.raises(InputError, match=r"no_command.*no function"):
        find_commands()
