import sys
from pathlib import Path

import pytest

from wrenchsight.models.files.input_error import InputError, install_of, needing_extra


def test_an_extra_is_installed_for_the_python_that_runs(monkeypatch, tmp_path):
    python = tmp_path / ".venv" / "bin" / "python"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setenv("PATH", "")
    assert install_of("study") == ".venv/bin/python -m pip install 'wrenchsight[study]'"
    monkeypatch.chdir("/")
    assert install_of("study") == f"{python.relative_to('/')} -m pip install 'wrenchsight[study]'"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\n")
    python.chmod(0o755)
    monkeypatch.setenv("PATH", str(python.parent))
    assert install_of("study") == "python -m pip install 'wrenchsight[study]'"


def test_a_package_that_is_missing_names_its_extra():
    with (
        pytest.raises(InputError, match=r"needs a package .*\(no_such\); .* 'wrenchsight\[view\]'"),
        needing_extra("view", "--view"),
    ):
        raise ImportError(name="no_such")
    assert Path(sys.executable).name in install_of("view")
