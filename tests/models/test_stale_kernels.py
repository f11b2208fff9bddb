"""Compiled kernels do not outlive the sources that they were compiled from."""

import os
from pathlib import Path

from models import forget_stale_kernels


def _write(file: Path, time: float) -> Path:
    file.parent.mkdir(exist_ok=True)
    file.touch()
    os.utime(file, (time, time))
    return file


def test_a_newer_kernel_source_drops_every_older_compiled_kernel(tmp_path: Path) -> None:
    _write(tmp_path / "observer.py", 100.0)
    _write(tmp_path / "chain.py", 300.0)
    caller = _write(tmp_path / "__pycache__" / "observer.step-1.py311.nbi", 200.0)
    data = _write(tmp_path / "__pycache__" / "observer.step-1.py311.1.nbc", 200.0)
    fresh = _write(tmp_path / "__pycache__" / "chain.terms-1.py311.nbi", 400.0)
    forget_stale_kernels(tmp_path)
    assert not caller.exists()
    assert not data.exists()
    assert fresh.exists()


def test_a_source_without_kernels_drops_nothing(tmp_path: Path) -> None:
    _write(tmp_path / "observer.py", 100.0)
    _write(tmp_path / "robot.py", 300.0)
    cached = _write(tmp_path / "__pycache__" / "observer.step-1.py311.nbi", 200.0)
    forget_stale_kernels(tmp_path)
    assert cached.exists()
