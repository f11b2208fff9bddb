"""What the tests of spoilt inputs share: clean ones, and a process that forks for each command."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from fuzzing.clean_inputs import CleanInputs, make_clean_inputs
from fuzzing.sandbox import Sandbox

_HERE = Path(__file__).parent


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All of these are long: each runs commands, with kernels of their own."""
    for item in items:
        if item.path.is_relative_to(_HERE):
            item.add_marker("long")


@pytest.fixture(scope="session")
def clean(tmp_path_factory: pytest.TempPathFactory) -> CleanInputs:
    return make_clean_inputs(tmp_path_factory.mktemp("clean") / "inputs")


@pytest.fixture(scope="session")
def sandbox(clean: CleanInputs, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sandbox]:
    folder: Path = tmp_path_factory.mktemp("warm")
    estimate = ("estimate", clean.log, "--robot", clean.robot, "--prior", "30,2", "--out", "clean")
    model = clean.folder / "model.yaml"
    watch = ("watch", f"replay://{clean.log}?rate=0", "--robot", clean.robot, "--model", model)
    simulate = ("simulate", "--duration", "0.02", "--no-recording", "--out", "simulated")
    with Sandbox() as sandbox:
        sandbox.warm_up([estimate, watch, simulate], folder)
        yield sandbox
