"""Some hundred spoilt inputs of fixed seeds; `make fuzz` takes thousands of others."""

import shutil

import pytest
from fuzzing.cases import make_case
from fuzzing.judging import beyond_its_band, checksums, fault_of, readings, stray, untellable

FIRST, COUNT, PER_TEST = 0, 120, 20
DRAWN = 3  # one case of so many draws its figures, as in `make fuzz` one of ten

pytestmark = pytest.mark.timeout(1800)  # where the kernels are not compiled yet


@pytest.fixture(scope="module")
def reading(sandbox, clean, tmp_path_factory):
    """The clean log's."""
    out = tmp_path_factory.mktemp("reading") / "out"
    case = ("estimate", clean.log, "--robot", clean.robot, "--prior", "30,2", "--out", out)
    assert sandbox.run(case, clean.folder).code == 0
    return out / "wrench.csv"


@pytest.mark.parametrize("first", range(FIRST, FIRST + COUNT, PER_TEST))
def test_spoilt_inputs_end_well(sandbox, clean, reading, tmp_path, first):
    problems = []
    for seed in range(first, first + PER_TEST):
        folder = tmp_path / str(seed)
        case = make_case(seed, clean, folder)
        before = checksums(folder)
        ending = sandbox.run(case.arguments, folder, draws=seed % DRAWN == 0)
        fault = fault_of(case, ending, folder, before)
        fault = fault or beyond_its_band(case, ending, folder, reading, clean)[1]
        if fault is not None:
            problems.append(f"{seed} {case.kind}, {case.what}: {fault}: {ending.stderr[-500:]}")
        shutil.rmtree(folder)
    assert not problems, "\n".join(problems)


def _spoilt_log(clean, path, *spoils):
    """Writes the clean log with some columns' cells changed: (columns, rows, factor) each."""
    head, *rows = [line.split(",") for line in clean.log.read_text().splitlines()]
    for columns, where, factor in spoils:
        for name in columns.split():
            for row in rows[where]:
                row[head.index(name)] = repr(float(row[head.index(name)]) * factor)
    path.write_text("\n".join(",".join(row) for row in (head, *rows)) + "\n")
    return path


@pytest.mark.parametrize(
    ("columns", "rows"), [("v2", slice(449, 450)), ("v1", slice(382, 392)), ("v3", slice(200, 203))]
)
def test_a_leap_of_the_velocity_stays_within_the_band(
    sandbox, clean, reading, tmp_path, columns, rows
):
    log = _spoilt_log(clean, tmp_path / "log.csv", (columns, rows, 10.0))
    ending = sandbox.run(
        ("estimate", log, "--robot", clean.robot, "--prior", "30,2", "--out", "out"), tmp_path
    )
    assert ending.code == 0, ending.stderr
    assert stray(reading, tmp_path / "out" / "wrench.csv") is None


def test_undetectable_faults_are_listed_with_their_reason(clean, tmp_path):
    def reason(*spoils, printed=""):
        log = _spoilt_log(clean, tmp_path / "log.csv", *spoils)
        return untellable(clean.log, log, clean.robot, printed)

    few = slice(100, 110)
    assert "drives can give" in reason(("i1", few, 3.0))
    assert reason(("i1", few, 1e6)) is None
    assert reason(("v1", few, 3.0)) is None
    assert reason(("q2", few, 1.01), ("i1", few, 3.0)) is None
    doubt = "note: the signs of the currents are doubtful"
    assert "said so" in reason(("i1 i2 i3 i4 i5 i6", slice(None), -1.0), printed=doubt)
    text = clean.log.read_text().replace("i1,i2", "i2,i1", 1)
    (tmp_path / "log.csv").write_text(text)
    assert "another joint" in untellable(clean.log, tmp_path / "log.csv", clean.robot)


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
