"""A LeRobot data set read as one log: each frame of the copy has what was read at its time."""

from dataclasses import replace

import numpy as np
import pytest
from lerobot_data_sets import write_data_set

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.estimate_data_set import SD, VALID, WRENCH
from wrenchsight.analyses.methods.estimate.estimation import estimate_log
from wrenchsight.models.identification.identified_model import IdentifiedModel, Provenance
from wrenchsight.models.recordings.lerobot.data_set import load_data_set
from wrenchsight.models.recordings.parquet_table import ParquetTable
from wrenchsight.models.robot.robot import Robot

_FPS, _ROWS = 100, 150
_FORCES = (np.zeros(3), np.array([0.0, 0.0, 30.0]), np.array([20.0, -10.0, 0.0]))


def _episode(robot: Robot, force: np.ndarray, seed: int) -> dict[str, np.ndarray]:
    """A slow motion under a constant force on E."""
    t = np.arange(_ROWS) / _FPS
    rate = np.random.default_rng(seed).uniform(0.4, 0.9, robot.num_joints)
    phase = np.outer(t, rate) + 2.0 * seed  # so that positions jump from episode to episode
    q = robot.home + 0.3 * np.sin(phase)
    v, vdot = 0.3 * rate * np.cos(phase), -0.3 * rate**2 * np.sin(phase)
    tau = np.asarray(robot.chain.inverse_dynamics(q, v, vdot))
    tau -= np.einsum("kij,i->kj", robot.chain.jacobian(q)[:, 3:], force)
    return {"observation.state": q, "observation.velocity": v, "observation.effort": tau}


@pytest.mark.parametrize(("version", "table"), [("v2.1", "csv"), ("v3.0", "parquet")])
def test_each_frame_has_its_wrench(tmp_path, ur10e, no_figures, version, table):
    episodes = [_episode(ur10e, force, e) for e, force in enumerate(_FORCES)]
    episodes[1]["observation.effort"][70] = np.nan  # a frame without a number
    root = write_data_set(tmp_path / "set", version, episodes, _FPS)
    model = replace(
        IdentifiedModel.nominal(ur10e),
        residual_covariance=0.3**2 * np.eye(6),
        provenance=Provenance(method="made up"),
    )
    model.save(tmp_path / "model.yaml")
    config = EstimateConfig(prior="60,3", table=table)
    result = estimate_log(root, "ur10e", tmp_path / "model.yaml", tmp_path / "out", config=config)
    assert result.num_samples == 3 * _ROWS - 1 + 1  # the gap of one frame is bridged
    assert any("lack a number: 1 (first" in text for text in result.notices)
    copied = load_data_set(tmp_path / "out" / "data_set")
    for one, force in zip(copied.episodes, _FORCES, strict=True):
        frames = ParquetTable(one.file, one.rows)
        assert frames.names is not None
        wanted = [k for k, name in enumerate(frames.names) if name.startswith(WRENCH)]
        names = [frames.names[k] for k in wanted]
        values = np.concatenate([x for x, _ in frames.blocks(wanted)])
        assert names[:6] == [f"{WRENCH}.{k + 1}" for k in range(6)]
        assert names[6:] == [*(f"{SD}.{k + 1}" for k in range(6)), VALID]
        late = values[_ROWS // 2 + 20 :]  # 1 s, after the observer has settled
        np.testing.assert_allclose(late[:, :3].mean(axis=0), force, atol=3.0)
        assert late[:, 12].all()
        assert (late[:, 6:12] > 0.0).all()
        if one.index == 1:
            assert not values[70, 12]
        assert not values[0, 12]  # of the one before nothing is held to be valid
