"""The estimator's kernels in processes side by side."""

import pytest

from wrenchsight.analyses.output import estimator_compilation
from wrenchsight.analyses.output.estimator_compilation import ESTIMATOR_PARTS, compile_estimator


@pytest.mark.parametrize("name", ESTIMATOR_PARTS)
def test_each_part_runs_its_stages(name: str) -> None:
    ESTIMATOR_PARTS[name]()


def test_nothing_is_compiled_where_all_is(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(estimator_compilation, "are_compiled", lambda kernels: True)
    compile_estimator(lambda share, left: said.append(left))
    assert said == []


def test_what_is_left_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(estimator_compilation, "are_compiled", lambda kernels: False)
    compile_estimator(lambda share, left: said.append(left))
    assert all(name in said[0] for name in ESTIMATOR_PARTS)
    assert len(said) == len(ESTIMATOR_PARTS)
