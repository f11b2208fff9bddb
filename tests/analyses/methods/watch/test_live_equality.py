"""A log replayed through a controller on this computer reads as `estimate` reads the log."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import knowing_model

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.estimation import estimate_log
from wrenchsight.analyses.methods.watch.rtde_controller import RtdeController
from wrenchsight.analyses.methods.watch.sources import open_source
from wrenchsight.models.estimation.wrench_table import FLAGS
from wrenchsight.models.identification.identified_model import FittedRobot
from wrenchsight.models.live.live_estimator import LiveConfig, LiveEstimator
from wrenchsight.models.live.reading import Reading
from wrenchsight.models.live.samples import Sample
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.rigid_body.spatial_vectors import WRENCH_AXES

pytestmark = pytest.mark.long  # streams run in real time, or whole


@pytest.mark.parametrize(
    ("name", "log_format"),
    [
        ("ur10e/ur-20_02_19_14harm50secLoad.csv", None),  # 100 Hz with jitter: resampled
        ("ur10e_contact/ramp_ACF_F15_r0.0z0_v0.10.csv", "ur10e-contact"),  # 500 Hz
    ],
)
@pytest.mark.parametrize(("scheme", "track"), [("rtde", False), ("replay", False), ("rtde", True)])
def test_a_replayed_log_reads_as_estimate_reads_it(
    data, ur10e, tmp_path, no_figures, one_thread, name, log_format, scheme, track
):
    log = data(name)
    model = replace(knowing_model(ur10e, 3.0, 5.0), fitted_robot=FittedRobot.of(ur10e))
    model.save(tmp_path / "model.yaml")
    # The step, the prior and the encoders' resolution that `estimate` found are stated to both.
    result = estimate_log(
        log,
        ur10e.source,
        tmp_path / "model.yaml",
        tmp_path / "out",
        log_format,
        EstimateConfig(prior="live", check=False, track=track),
    )
    table = np.genfromtxt(result.table, delimiter=",", names=True)
    recording = read_recording(log, log_format, ur10e, check=False)

    live = LiveEstimator(ur10e, model, LiveConfig(result.config.estimator, track=track), rate=0.0)
    readings: list[Reading] = []
    with RtdeController([recording], port=0, rate=0.0) as controller:
        url = f"rtde://127.0.0.1:{controller.port}"
        if scheme == "replay":
            url = f"replay://{log}?rate=0" + (f"&log_format={log_format}" if log_format else "")
        source = open_source(url, ur10e)
        count = 0
        while count < recording.num_samples:
            for item in source.read(1.0):
                if isinstance(item, Sample):
                    count += 1
                    readings += [r for r in live.take(item) if isinstance(r, Reading)]
        source.close()

    assert len(readings) == len(table)
    wrench = np.array([reading.force_first for reading in readings])
    columns = [*WRENCH_AXES, *(f"sd_{axis}" for axis in WRENCH_AXES)]
    expected = np.stack([table[column] for column in columns], axis=1)
    np.testing.assert_allclose(wrench, expected, rtol=0.0, atol=1e-9)
    mine = {
        column: np.array([float(getattr(reading, column)) for reading in readings])
        for column in ("t", "valid", *FLAGS)
    }
    for column in ("t", "contact", "rest", "out_of_range", "fault"):
        np.testing.assert_array_equal(mine[column], table[column], err_msg=column)
    # `estimate` judges each contact as a whole, also by what comes after a sample: whether it is
    # one at E, and so whether what is read during it is valid. Elsewhere both say the same.
    apart = mine["contact"] == 0.0
    for column in ("valid", "invalid", "misfit", "link"):
        np.testing.assert_array_equal(mine[column][apart], table[column][apart], err_msg=column)
    assert np.all(mine["valid"] >= table["valid"])
