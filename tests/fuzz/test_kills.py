"""Commands that are ended at random moments; `make kills` ends a thousand."""

from collections.abc import Iterator

import pytest
from fuzzing.kills import COMMANDS, EXPERIMENTS, STARTS, Kills, make_kill_inputs
from fuzzing.sandbox import Sandbox

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Iterator[tuple[Sandbox, object]]:
    folder = tmp_path_factory.mktemp("kills")
    (folder / "temporary").mkdir()
    with Sandbox(EXPERIMENTS, {"TMPDIR": str(folder / "temporary")}) as sandbox:
        make_kill_inputs(sandbox, folder / "inputs")
        yield sandbox, folder / "inputs"
    assert list((folder / "temporary").iterdir()) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_an_end_at_any_moment_leaves_whole_results(place, command):
    run = Kills(command, *place)
    for seed in range(6 if command == STARTS else 4):
        number, fault = run.fault(seed)
        assert fault is None, f"{number}: {fault}"
    assert run.left_behind() == []
