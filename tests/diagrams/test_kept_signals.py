import tempfile
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from wrenchsight.diagrams.closed_loop import make_closed_loop
from wrenchsight.diagrams.kept_signals import KeptSignals
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel


@pytest.fixture
def loop(sts):
    scenario = replace(load_scenario("Default"), duration=0.1)
    return make_closed_loop(scenario, sts, IdentifiedModel.nominal(sts))


def test_what_is_kept_is_what_a_log_would_hold(loop, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    plain = Simulator(loop.diagram)
    plain.AdvanceTo(0.1)
    t, signals = loop.logged(plain.get_context())

    stored = KeptSignals(loop)
    simulator = Simulator(loop.diagram)
    for end in (0.03, 0.04, 0.1):  # a first stretch, a short one, the rest
        simulator.AdvanceTo(end)
        stored.take(simulator.get_mutable_context())
        assert loop.log.FindLog(simulator.get_context()).num_samples() == 0
    kept_t, kept_signals = stored.logged()
    np.testing.assert_array_equal(kept_t, t)
    assert list(kept_signals) == list(signals)
    for name, values in signals.items():
        np.testing.assert_array_equal(kept_signals[name], values, err_msg=name)
    assert not list(tmp_path.iterdir())  # no file that a kill could leave behind


def test_nothing_taken_is_nothing_kept(loop):
    t, signals = KeptSignals(loop).logged()
    assert t.shape == (0,)
    assert signals["q"].shape == (0, 6)


def test_no_place_for_them_is_one_line(loop, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "absent"))
    with pytest.raises(InputError, match="absent: cannot be written"):
        KeptSignals(loop)
