"""MATLAB's files, written by scipy."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings import packed_file
from wrenchsight.models.recordings.recording_reader import read_recording

_T = 0.01 * np.arange(50)
_Q, _V, _I = np.random.default_rng(1).normal(size=(3, 50, 2))


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("kind", ["matrices", "transposed", "structure", "columns"])
def test_variables_are_read_by_their_names(tmp_path: Path, kind: str, compressed: bool) -> None:
    arrays = {"t": _T[:, None], "q": _Q, "v": _V, "i": _I}
    if kind == "transposed":
        arrays = {name: x.T for name, x in arrays.items()}
    if kind == "columns":
        arrays = {"t": _T[:, None]} | {
            f"{name}{j + 1}": x[:, j : j + 1]
            for name, x in (("q", _Q), ("v", _V), ("i", _I))
            for j in range(2)
        }
    path = tmp_path / "log.mat"
    content = {"log": arrays} if kind == "structure" else arrays
    savemat(path, content | {"remark": "hello", "rate": 100.0}, do_compression=compressed)
    recording = read_recording(path)
    np.testing.assert_array_equal(recording.t, _T)
    np.testing.assert_array_equal(recording.q, _Q)
    np.testing.assert_array_equal(recording.v, _V)
    np.testing.assert_array_equal(recording.current, _I)


def test_labelled_signals_of_a_scope_are_read(tmp_path: Path) -> None:
    """As Simulink saves a "structure with time"."""
    signals = np.zeros((1, 3), dtype=[("values", object), ("label", object)])
    for k, (label, values) in enumerate((("q", _Q), ("qd", _V), ("I", _I))):
        signals[0, k] = (values, label)
    path = tmp_path / "scope.mat"
    savemat(path, {"ScopeData": {"time": _T[:, None], "signals": signals}})
    recording = read_recording(path)
    np.testing.assert_array_equal(recording.t, _T)
    np.testing.assert_array_equal(recording.q, _Q)
    np.testing.assert_array_equal(recording.v, _V)
    np.testing.assert_array_equal(recording.current, _I)


def test_damaged_and_large_files_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {"t": _T, "q": _Q}, do_compression=True)
    data = path.read_bytes()
    for content in (data[:200], b"t,q1\n1,2\n" * 30, data[:140] + bytes(40) + data[180:]):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"no MATLAB file, or a damaged one|no arrays"):
            read_recording(path)
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(200))
    with pytest.raises(InputError, match="-v7"):
        read_recording(path)
    # The bound itself takes seconds to pack.
    monkeypatch.setattr(packed_file, "_LARGEST_FILE", 1 << 22)
    packed = zlib.compress(bytes(1 << 23))
    path.write_bytes(data[:128] + struct.pack("<II", 15, len(packed)) + packed)
    with pytest.raises(InputError, match="bytes that unpack to"):
        read_recording(path)
