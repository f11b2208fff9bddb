"""Objects of JSON behind other text are read; what stands before them may be their time."""

import json
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.json_lines import has_text_before_objects
from wrenchsight.models.recordings.recording_reader import read_recording

T = 0.01 * np.arange(60)
Q = np.round(np.c_[np.sin(T), np.cos(T)], 6)

_BEFORE = {  # text before an object at t, and whether the object has its time
    "topic": ("dt/arm-3/state ", True),
    "stream": ("data: ", True),
    "logger": ("2024-03-01 12:00:{t:09.6f} INFO [driver]: ", False),
    "unix": ("[{epoch:.6f}] topic=/arm ", False),
}


@pytest.mark.parametrize("form", _BEFORE)
@pytest.mark.parametrize("suffix", [".txt", ".jsonl"])
def test_objects_behind_other_text_are_read(tmp_path: Path, form: str, suffix: str) -> None:
    before, has_time = _BEFORE[form]
    lines = []
    for t, q in zip(T.tolist(), Q.tolist(), strict=True):
        entry = ({"ts": t} if has_time else {}) | {"q": q, "state": {"current": [1.0, 2.0]}}
        lines.append(before.format(t=t, epoch=1.7e9 + t) + json.dumps(entry))
    lines.insert(5, "connection lost, trying again")
    path = tmp_path / f"log{suffix}"
    path.write_text("\n".join(lines) + "\n")
    log = read_recording(path)
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.current, np.tile([1.0, 2.0], (60, 1)))
    np.testing.assert_allclose(log.t - log.t[0], T, rtol=0, atol=1e-6)
    assert any("objects are read from behind other text" in text for text in log.notices)


def test_a_damaged_object_is_told(tmp_path: Path) -> None:
    lines = [f'state {{"ts": {t}, "q": [0.1, {t}]}}' for t in T.tolist()]
    lines[20] = 'state {"ts": 0.2, "q": [0.1 0.2]}'
    path = tmp_path / "log.txt"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="cannot be read as JSON"):
        read_recording(path)


def test_other_text_has_no_objects() -> None:
    lines = ["t,q1,mode", *(f"{t},1,{{run}}" for t in T), ""]
    assert not has_text_before_objects("\n".join(lines))
    assert not has_text_before_objects('{"t": 0}\n{"t": 1}\n')
    assert not has_text_before_objects("x {'t': 0}\nx {'t': 1}\n")
