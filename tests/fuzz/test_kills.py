"""Commands that are ended at random moments; `make kills` ends a thousand."""

import shutil

import pytest
from fuzzing.clean_inputs import motion
from fuzzing.kills import COMMANDS, Kills

from models.recordings.recording_writer import write_recording


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("command", COMMANDS)
def test_an_end_at_any_moment_leaves_whole_results(clean, tmp_path, command):
    folder = tmp_path / "inputs"
    shutil.copytree(clean.folder, folder)
    write_recording(motion(6000), folder / "long.csv")
    run = Kills(command, folder)
    for seed in range(4):
        number, fault = run.fault(seed)
        assert fault is None, f"{number}: {fault}"
    assert run.left_behind() == []
