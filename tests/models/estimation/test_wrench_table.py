"""wrench.csv: the columns that people read, whole or not at all."""

from pathlib import Path

import numpy as np
import pytest

from models.estimation.wrench_table import COLUMNS, WrenchTableWriter
from models.files.input_error import InputError


def _rows(num_rows: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    condition_number = rng.uniform(5, 50, num_rows)
    condition_number[0] = np.inf
    wrench, sd = rng.normal(size=(2, num_rows, 6))
    return np.arange(num_rows) * 1e-3, wrench, np.abs(sd), condition_number, sd[:, 0] > 0


def test_the_columns_are_force_first_and_exact(tmp_path: Path) -> None:
    path = tmp_path / "wrench.csv"
    t, wrench, sd, condition_number, valid = _rows(200)
    with WrenchTableWriter(path) as table:
        for part in (slice(0, 70), slice(70, 70), slice(70, 200)):
            table.write(t[part], wrench[part], sd[part], condition_number[part], valid[part])
        assert table.num_rows == 200
        assert not path.exists()
    assert [p.name for p in tmp_path.iterdir()] == ["wrench.csv"]
    header = "t,fx,fy,fz,mx,my,mz,sd_fx,sd_fy,sd_fz,sd_mx,sd_my,sd_mz,condition_number,valid"
    assert path.read_text().splitlines()[0] == header == ",".join(COLUMNS)
    read = np.genfromtxt(path, delimiter=",", names=True)
    for k, axis in enumerate(("mx", "my", "mz", "fx", "fy", "fz")):  # rotation first inside
        np.testing.assert_array_equal(read[axis], wrench[:, k])
        np.testing.assert_array_equal(read[f"sd_{axis}"], sd[:, k])
    np.testing.assert_array_equal(read["t"], t)
    np.testing.assert_array_equal(read["condition_number"], condition_number)
    np.testing.assert_array_equal(read["valid"], valid)


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_interrupt_leaves_the_old_table(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "wrench.csv"
    path.write_text("old")
    with pytest.raises(error), WrenchTableWriter(path) as table:
        table.write(*_rows(10))
        raise error
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["wrench.csv"]


def test_a_place_that_cannot_be_written_to_is_one_line(tmp_path: Path) -> None:
    table = WrenchTableWriter(tmp_path / "nowhere" / "wrench.csv")
    with pytest.raises(InputError, match=r"wrench\.csv: cannot be written"), table:
        pass


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a disk that is always full")
def test_a_full_disk_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "wrench.csv"
    really_open = Path.open

    def full(self: Path, mode: str = "r", *args: object, **kwargs: object):
        target = Path("/dev/full") if self.name.endswith(".partial") else self
        return really_open(target, mode, *args, **kwargs)

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(InputError, match="No space left"), WrenchTableWriter(path) as table:
        for seed in range(20):
            table.write(*_rows(2000, seed))
    monkeypatch.undo()
    assert [p.name for p in tmp_path.iterdir()] == []
