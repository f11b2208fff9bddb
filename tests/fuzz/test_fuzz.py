"""Some hundred spoilt inputs of fixed seeds; `make fuzz` takes thousands of others."""

import shutil

import pytest
from fuzzing.cases import make_case
from fuzzing.judging import checksums, fault_of, readings, stray

FIRST, COUNT, PER_TEST = 0, 120, 20

pytestmark = pytest.mark.timeout(1800)  # where the kernels are not compiled yet


@pytest.mark.parametrize("first", range(FIRST, FIRST + COUNT, PER_TEST))
def test_spoilt_inputs_end_well(sandbox, clean, tmp_path, first):
    found = []
    for seed in range(first, first + PER_TEST):
        folder = tmp_path / str(seed)
        case = make_case(seed, clean, folder)
        before = checksums(folder)
        ending = sandbox.run(case.arguments, folder)
        fault = fault_of(case, ending, folder, before)
        if fault is not None:
            found.append(f"{seed} {case.kind}, {case.what}: {fault}: {ending.stderr[-500:]}")
        shutil.rmtree(folder)
    assert not found, "\n".join(found)


def test_a_reading_beyond_its_band_is_seen(tmp_path):
    clean, other = tmp_path / "clean.csv", tmp_path / "other.csv"
    head = "t,fx,fy,fz,sd_fx,sd_fy,sd_fz,valid\n"
    clean.write_text(head + "0,1,2,3,1,1,1,1\n0.001,1,2,3,1,1,1,1\n")
    other.write_text(head + "0,1,2,4,1,1,1,1\n0.001,9,2,3,1,1,1,0\n")
    assert stray(clean, other) is None
    other.write_text(head + "0,1,2,3,1,1,1,1\n0.001,9,2,3,1,1,1,1\n")
    assert stray(clean, other) == (8.0, 0.001)
    other.write_text(head + "0,,2,3,1,1,1,1\n")
    assert stray(clean, other) == (float("inf"), 0.0)
    assert set(readings(clean)) == {0.0, 0.001}
