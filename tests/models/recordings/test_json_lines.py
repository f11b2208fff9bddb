"""Logs of JSON objects, one a line."""

import json
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings import json_lines
from wrenchsight.models.recordings.recording_reader import read_recording

T = 0.01 * np.arange(60)
Q = np.c_[np.sin(T), np.cos(T)]


def _objects() -> list[dict]:
    return [
        {
            "timestamp": float(t),
            "joint_positions": q.tolist(),
            "joint_velocities": [0, float(t)],  # whole numbers, then others
            "joint_currents": [1, 2],
            "state": {"mode": "AUTO"},
        }
        for t, q in zip(T, Q, strict=True)
    ]


@pytest.mark.parametrize("block", [1 << 22, 400])
def test_objects_are_read_as_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr(json_lines, "_BLOCK_BYTES", block)
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(json.dumps(entry) for entry in _objects()))
    log = read_recording(path)
    np.testing.assert_array_equal(log.t, T)
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.current, np.tile([1.0, 2.0], (60, 1)))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (json.dumps(_objects()), "not one object a line; write one object a line"),
        (json.dumps(_objects()[0], indent=2), "is one JSON object, expected one a sample"),
        (json.dumps({"t": T.tolist(), "q": Q.tolist()}), "numpy.savez('log.npz', **json.load("),
        ('{"t": 0.0, "q": [0.1\n', "cannot be read as JSON"),
        ('{"t": 0.0}\n{"t": [1.0]}\n', "all with the same entries"),
        ("t,q1\n0,1\n", "is no JSON"),
        ("", "is no JSON"),
    ],
)
def test_other_json_is_refused_with_a_remedy(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "log.json"
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        read_recording(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
