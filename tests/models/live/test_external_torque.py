"""A real Panda's external torque, touched link by link, read as a stream."""

import numpy as np
import pyarrow.csv as pa_csv
import pytest

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.external_torque.torque_logs import estimate_torque_logs
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveConfig, LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import Sample
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.robot.robot import Robot

SD = 0.25  # N m, as `estimate` finds it in the first of the logs


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


pytestmark = pytest.mark.usefixtures("one_thread")  # samples come one by one


def config_of(robot, **more):
    prior = WrenchReconstructionConfig().with_prior(*live_prior(robot.payload))
    observer = MomentumObserverConfig(time_step=0.0)
    return LiveConfig(WrenchEstimatorConfig(observer, prior), torque_sd=[SD], **more)


def samples_of(path):
    table = pa_csv.read_csv(path)
    t = table["t"].to_numpy()
    q, v, tau = (
        np.stack([table[f"{name}{j}"].to_numpy() for j in range(1, 8)], axis=1)
        for name in ("q", "v", "tau_ext")
    )
    samples = [
        Sample(t[k], t[k], q[k], v[k], tau[k], True, is_external=True) for k in range(len(t))
    ]
    return samples, table["contact"].to_numpy() == 1


@pytest.mark.parametrize(("name", "at_E"), [("link4_d3", False), ("link7_a4", True)])
@pytest.mark.long
def test_touches_read_as_estimate_reads_them_and_those_of_links_are_not_valid(
    data, panda, tmp_path, name, at_E
):
    log = data(f"link_contact/panda_{name}.csv")
    samples, touched = samples_of(log)
    live = LiveEstimator(panda, IdentifiedModel.nominal(panda), config_of(panda))
    live.contradicted = live.lacks_model = True  # no model has a part in it
    readings = [one for sample in samples for one in live.take(sample) if isinstance(one, Reading)]
    t = np.array([reading.t for reading in readings])

    config = EstimateConfig(torque="external", torque_sd=[SD], prior="live")
    result = estimate_torque_logs([log], "panda", tmp_path, config=config)
    table = pa_csv.read_csv(result.logs[0].table)
    at = np.clip(np.searchsorted(table["t"].to_numpy(), t), 0, len(table) - 1)
    same = np.abs(table["t"].to_numpy()[at] - t) < 1e-6  # the others are interpolated
    assert same.any()
    for k, axis in ((3, "fx"), (5, "fz"), (1, "my")):
        wrench = np.array([reading.wrench[k] for reading in readings])
        np.testing.assert_allclose(wrench[same], table[axis].to_numpy()[at][same], atol=1e-3)

    label = touched[np.searchsorted([sample.t for sample in samples], t + 1e-6) - 1]
    contact, valid, misfit = (
        np.array([getattr(reading, word) for reading in readings])
        for word in ("contact", "valid", "misfit")
    )
    late = np.convolve(label, np.ones(round(0.15 / live.step)), "full")[: len(label)]
    measured = ~np.array([reading.dropout for reading in readings])  # the log has many gaps
    inside = measured & label & (late > 0.14 / live.step)  # for 0.15 s already
    assert contact[inside].mean() > 0.95
    assert not contact[late == 0.0].any()
    assert valid[measured & ~contact].mean() > 0.9  # all but the first half second
    if at_E:
        # Joint 7 is silent: some of it may be on link 6, and is not valid.
        assert valid[inside].mean() > 0.85
        assert not misfit.any()
    else:
        assert not valid[contact].any()
        assert misfit[inside].mean() > 0.7


def test_without_an_sd_nothing_is_read(panda):
    live = LiveEstimator(panda, IdentifiedModel.nominal(panda))
    zero = np.zeros(7)
    with pytest.raises(InputError, match="--torque-sd"):
        for k in range(600):
            live.take(Sample(k / 1e3, k / 1e3, zero, zero, zero, True, is_external=True))
