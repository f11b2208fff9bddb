"""Kernels that are compiled in processes side by side: left on disk, and announced."""

import os
from functools import partial
from pathlib import Path

import pytest

from wrenchsight.analyses.output.compilation import are_compiled, compile_side_by_side
from wrenchsight.models.rigid_body.chain_kernels import all_terms

pytestmark = pytest.mark.long  # processes of their own


def mark(folder, name):
    (Path(folder) / name).write_text(str(os.getpid()))


def fail():
    raise ValueError("no kernel")


def test_calls_run_elsewhere_and_what_is_left_is_named(tmp_path):
    announced = []
    parts = {name: partial(mark, str(tmp_path), name) for name in ("one", "two", "three")}
    compile_side_by_side(parts, lambda share, words: announced.append((share, words)))
    pids = {(tmp_path / name).read_text() for name in parts}
    assert str(os.getpid()) not in pids
    assert announced[0][0] == 0.0
    assert announced[0][1].endswith("left: one, two, three")
    left = [words.partition("left: ")[2].split(", ") for _, words in announced]
    assert [len(names) for names in left] == sorted((len(names) for names in left), reverse=True)


def test_an_error_is_passed_on():
    with pytest.raises(ValueError, match="no kernel"):
        compile_side_by_side({"one": fail}, lambda share, words: None)


def test_a_kernel_that_no_cache_holds_is_not_compiled(tmp_path, monkeypatch, ur10e):
    ur10e.chain.terms(ur10e.home, 0.0 * ur10e.home)
    assert are_compiled([all_terms])
    monkeypatch.setattr(all_terms._cache._cache_file, "_load_index", dict)
    assert not are_compiled([all_terms])
