"""Logs in npz files, against numpy's own reader."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings import npz_table
from wrenchsight.models.recordings.recording_reader import read_recording

_ROWS = 50


def _arrays() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(2)
    return {
        "t": 0.01 * np.arange(_ROWS),
        "q": rng.normal(size=(_ROWS, 3)),
        "v": rng.normal(size=(_ROWS, 3)),
        "current": rng.normal(size=(_ROWS, 3)).astype(np.float32),
    }


def _saved(tmp_path: Path, **arrays: object) -> Path:
    path = tmp_path / "log.npz"
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("block", [7, 1 << 16])
@pytest.mark.parametrize("compressed", [False, True])
def test_an_npz_of_one_array_per_signal_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, compressed: bool
) -> None:
    monkeypatch.setattr(npz_table, "_BLOCK_ROWS", block)
    arrays = _arrays() | {
        "v": np.asfortranarray(_arrays()["v"]),
        "jacobian": np.arange(_ROWS * 12.0).reshape(_ROWS, 4, 3),
        "names": np.array(["a", "b"]),
        "rate": np.array(100.0),
    }
    path = tmp_path / "log.npz"
    (np.savez_compressed if compressed else np.savez)(path, **arrays)
    recording = read_recording(path)
    for name in ("t", "q", "v", "current"):
        np.testing.assert_array_equal(getattr(recording, name), arrays[name])
    np.testing.assert_array_equal(
        recording.extra["jacobian"], arrays["jacobian"].reshape(_ROWS, 12)
    )
    assert recording.row is not None
    assert recording.row.tolist() == list(range(1, _ROWS + 1))
    assert any("names is left out: it holds no numbers" in notice for notice in recording.notices)
    assert any("left out: rate" in notice for notice in recording.notices)


def test_a_description_selects_rows_of_an_npz(tmp_path: Path) -> None:
    path = _saved(tmp_path, **_arrays())
    form = tmp_path / "form.yaml"
    form.write_text(
        "time: {columns: t}\nposition: {columns: 'q{1..3}'}\nrows: {log.npz: [5, 30]}\n"
    )
    np.testing.assert_array_equal(read_recording(path, form).q, _arrays()["q"][4:30])
    form.write_text("time: {columns: t}\nrows: {log.npz: [5, 300]}\n")
    with pytest.raises(InputError, match="has 50 rows, but the description selects rows 5 to 300"):
        read_recording(path, form)


def test_files_without_arrays_of_a_log_are_refused(tmp_path: Path) -> None:
    path = _saved(tmp_path, **_arrays())
    data = path.read_bytes()
    for content, words in (
        (b"", "is empty"),
        (data[: len(data) // 2], "no npz file, or a damaged one"),
        (b"t,q1\n", "no npz file"),
        (data[:200] + bytes(300) + data[500:], "damaged"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=words):
            read_recording(path)
    bad = _arrays()
    bad["t"][7] = np.nan
    with pytest.raises(InputError, match="row 8, column t"):
        read_recording(_saved(tmp_path, **bad))
    with pytest.raises(InputError, match="holds no arrays of numbers"):
        read_recording(_saved(tmp_path, words=np.array(["a"])))
    with pytest.raises(InputError, match="has no rows"):
        read_recording(_saved(tmp_path, t=np.empty(0)))


@pytest.mark.parametrize("order", [False, True])
@pytest.mark.parametrize("name", ["q", "extra"])
@pytest.mark.parametrize("shape", [(40, 10**9), (40, -3), (10**12,), (2**40, 2**40)])
def test_a_huge_shape_in_a_header_allocates_nothing(
    tmp_path: Path, name: str, shape: tuple[int, ...], order: bool
) -> None:
    arrays = {**_arrays(), "extra": np.zeros((40, 3))}
    path = tmp_path / "log.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for key, array in arrays.items():
            with archive.open(key + ".npy", "w") as member:
                if key != name:
                    np.lib.format.write_array(member, array)
                    continue
                header = {"descr": "<f8", "fortran_order": order, "shape": shape}
                np.lib.format.write_array_header_1_0(member, header)
                member.write(array.tobytes())
    with pytest.raises(InputError, match="damaged"):
        read_recording(path, check=False)


def test_arrays_of_pictures_are_left_out(tmp_path: Path) -> None:
    arrays = _arrays()
    path = _saved(tmp_path, **arrays, camera=np.zeros((len(arrays["t"]), 64, 65), np.uint8))
    log = read_recording(path, check=False)
    assert any("camera" in notice and "too large" in notice for notice in log.notices)


def test_arrays_with_a_sample_in_each_column_are_turned(tmp_path: Path) -> None:
    arrays = _arrays()
    turned = {"t": arrays["t"], "q": arrays["q"].T, "dq": arrays["v"].T, "tau": arrays["current"].T}
    recording = read_recording(_saved(tmp_path, **turned))
    np.testing.assert_array_equal(recording.q, arrays["q"])
    np.testing.assert_array_equal(recording.v, arrays["v"])
    np.testing.assert_array_equal(recording.tau_J, arrays["current"])
