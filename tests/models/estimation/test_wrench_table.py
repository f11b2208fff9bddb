"""wrench.csv and wrench.parquet: the columns that people read, whole or not at all."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pa_parquet
import pytest

from wrenchsight.models.estimation.invalid import REASONS
from wrenchsight.models.estimation.wrench_table import (
    COLUMNS,
    COVARIANCE,
    FLAGS,
    WrenchRows,
    WrenchTableWriter,
    columns_of,
)
from wrenchsight.models.files.input_error import InputError


def _rows(num_rows: int, seed: int = 0) -> WrenchRows:
    rng = np.random.default_rng(seed)
    condition_number = rng.uniform(5, 50, num_rows)
    condition_number[0] = np.inf
    wrench, sd = rng.normal(size=(2, num_rows, 6))
    flags = {name: rng.integers(0, 2, num_rows) for name in FLAGS}
    flags["link"] = rng.integers(0, 8, num_rows)
    flags["invalid"] *= max(REASONS)  # the widest number there is
    return WrenchRows(
        t=np.arange(num_rows) * 1e-3,
        wrench=wrench,
        standard_deviation=np.abs(sd),
        condition_number=condition_number,
        tau_ext=rng.normal(size=(num_rows, 7)),
        statistic=rng.uniform(size=num_rows),
        flags=flags,
    )


def _part(rows: WrenchRows, part: slice) -> WrenchRows:
    flags = {name: values[part] for name, values in rows.flags.items()}
    signals = {
        name: signal[part]
        for name, signal in rows._asdict().items()
        if name not in ("flags", "covariance")
    }
    covariance = None if rows.covariance is None else rows.covariance[part]
    return WrenchRows(**signals, flags=flags, covariance=covariance)


def test_the_columns_are_force_first_and_exact(tmp_path: Path) -> None:
    path = tmp_path / "wrench.csv"
    rows = _rows(200)
    t, wrench, sd, condition_number, tau_ext, statistic, flags, _ = rows
    with WrenchTableWriter(path, 7) as table:
        for part in (slice(0, 70), slice(70, 70), slice(70, 200)):
            table.write(_part(rows, part))
        assert table.num_rows == 200
        assert not path.exists()
    assert [p.name for p in tmp_path.iterdir()] == ["wrench.csv"]
    header = "t,fx,fy,fz,mx,my,mz,sd_fx,sd_fy,sd_fz,sd_mx,sd_my,sd_mz,condition_number,valid"
    assert header == ",".join(COLUMNS)
    torques = ",".join(f"tau_ext_{j}" for j in range(1, 8))
    header += f",{torques},contact_statistic,contact,misfit,link,rest,out_of_range,fault,invalid"
    assert path.read_text().splitlines()[0] == header == ",".join(columns_of(7))
    read = np.genfromtxt(path, delimiter=",", names=True)
    for k, axis in enumerate(("mx", "my", "mz", "fx", "fy", "fz")):  # rotation first inside
        np.testing.assert_array_equal(read[axis], wrench[:, k])
        np.testing.assert_array_equal(read[f"sd_{axis}"], sd[:, k])
    np.testing.assert_array_equal(read["t"], t)
    np.testing.assert_array_equal(read["condition_number"], condition_number)
    np.testing.assert_array_equal(read["valid"], flags["invalid"] == 0)
    np.testing.assert_array_equal(read["contact_statistic"], statistic)
    for j in range(7):
        np.testing.assert_array_equal(read[f"tau_ext_{j + 1}"], tau_ext[:, j])
    for name, values in flags.items():
        np.testing.assert_array_equal(read[name], values)


def test_a_parquet_table_holds_the_same_and_the_covariance(tmp_path: Path) -> None:
    rows = _rows(50)
    spread = np.random.default_rng(1).normal(size=(50, 6, 6))
    covariance = spread + spread.transpose(0, 2, 1)
    path = tmp_path / "wrench.parquet"
    with WrenchTableWriter(path, 7, covariance=True) as table:
        for part in (slice(0, 20), slice(20, 50)):
            table.write(_part(rows._replace(covariance=covariance), part))
    assert [p.name for p in tmp_path.iterdir()] == ["wrench.parquet"]
    read = pa_parquet.read_table(path)
    assert read.column_names == [*columns_of(7), *COVARIANCE]
    assert len(COVARIANCE) == 21
    np.testing.assert_array_equal(read["fx"], rows.wrench[:, 3])
    np.testing.assert_array_equal(read["valid"], rows.flags["invalid"] == 0)
    order = {"mx": 0, "my": 1, "mz": 2, "fx": 3, "fy": 4, "fz": 5}
    for name in COVARIANCE:
        _, a, b = name.split("_")
        np.testing.assert_array_equal(read[name], covariance[:, order[a], order[b]])


def test_a_covariance_that_is_missing_is_said(tmp_path: Path) -> None:
    table = WrenchTableWriter(tmp_path / "wrench.csv", 7, covariance=True)
    with pytest.raises(ValueError, match="covariance is missing"), table:
        table.write(_rows(3))


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_interrupt_leaves_the_old_table(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "wrench.csv"
    path.write_text("old")
    with pytest.raises(error), WrenchTableWriter(path, 7) as table:
        table.write(_rows(10))
        raise error
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["wrench.csv"]


def test_a_place_that_cannot_be_written_to_is_one_line(tmp_path: Path) -> None:
    table = WrenchTableWriter(tmp_path / "nowhere" / "wrench.csv", 7)
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
    with pytest.raises(InputError, match="No space left"), WrenchTableWriter(path, 7) as table:
        for seed in range(20):
            table.write(_rows(2000, seed))
    monkeypatch.undo()
    assert [p.name for p in tmp_path.iterdir()] == []
