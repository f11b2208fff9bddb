"""Arms in MuJoCo: what acts on them has the right sign, and the figures count what they say."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="needs MuJoCo: python -m pip install 'wrenchsight[study]'")

from wrenchsight.analyses.experiments.foreign_physics.arms import MujocoArm, draw_arm
from wrenchsight.analyses.experiments.foreign_physics.cases import BALL_TOOL, CASES, JOINT_STIFFNESS
from wrenchsight.analyses.experiments.foreign_physics.experiment import (
    EXPERIMENT,
    result_of,
    summed_up,
)
from wrenchsight.analyses.experiments.foreign_physics.motions import pick_and_place, wave
from wrenchsight.analyses.experiments.foreign_physics.mujoco_world import simulate
from wrenchsight.analyses.experiments.foreign_physics.plain_tools import PlainModel
from wrenchsight.analyses.experiments.foreign_physics.readings import (
    EstimatedLog,
    figures,
    read_log,
)
from wrenchsight.analyses.experiments.foreign_physics.scenes import MujocoScene
from wrenchsight.models.identification.identified_model import IdentifiedModel

STEPS = 600  # of 1 ms
# N m: a sample's noise of .08 A at 12 N m/A, averaged over 20 samples, four times, and the rounding
# of positions (1e-4 rad) at 2500 /s^2 and 10 kg m^2
TORQUE_NOISE = 1.5


@pytest.fixture(scope="module")
def arm() -> MujocoArm:
    """A drawn UR10e without friction, whose statics are exact."""
    drawn = draw_arm("ur10e", 3)
    return replace(drawn, coulomb=0.0 * drawn.coulomb, viscous=drawn.viscous)


def _still(arm: MujocoArm) -> MujocoScene:
    none = np.zeros((STEPS, arm.robot.num_joints))
    return MujocoScene(none + arm.robot.home, none, none)


def _torque_beyond_gravity(arm: MujocoArm, log) -> np.ndarray:
    """(n,) N m at the end of a log at rest."""
    q, current = log.recording.q[-20:], log.recording.current[-20:]
    tau_J = arm.robot.joint_torque(current)
    return np.mean(tau_J - arm.chain.gravity_torque(q), axis=0)


def test_the_motors_hold_against_a_push(arm: MujocoArm) -> None:
    wrench = np.array([1.0, -2.0, 3.0, 20.0, 30.0, -40.0])
    scene = replace(_still(arm), wrench=np.tile(wrench, (STEPS, 1)))
    log = simulate(arm, scene, 0)
    np.testing.assert_allclose(log.wrench[-1], wrench)
    expected = -arm.chain.jacobian(log.recording.q[-1]).T @ wrench
    assert np.abs(expected).max() > 10 * TORQUE_NOISE
    np.testing.assert_allclose(_torque_beyond_gravity(arm, log), expected, atol=TORQUE_NOISE)


def test_a_load_weighs_what_it_weighs_and_the_motors_carry_it(arm: MujocoArm) -> None:
    mass, centre_E = 3.0, np.array([0.05, 0.02, 0.1])
    log = simulate(arm, replace(_still(arm), load=(mass, centre_E)), 0)
    R_WE, _ = arm.chain.pose(log.recording.q[-1])
    weight = np.array([0.0, 0.0, -9.81 * mass])
    expected = np.concatenate([np.cross(R_WE @ centre_E, weight), weight])
    # It still moves by .1 mm/s^2 or so, and q is rounded
    np.testing.assert_allclose(log.wrench[-1], expected, atol=0.05)
    carried = -arm.chain.jacobian(log.recording.q[-1]).T @ expected
    np.testing.assert_allclose(_torque_beyond_gravity(arm, log), carried, atol=TORQUE_NOISE)


def test_a_ball_on_a_plane_pushes_back_along_the_normal_and_the_motors_push(arm: MujocoArm) -> None:
    _, p_WE = arm.chain.pose(arm.robot.home)
    z = arm.chain.pose(arm.robot.home)[0][:, 2]
    scene = replace(
        _still(arm),
        push=np.full(STEPS, 50.0),
        plane_point=p_WE + (BALL_TOOL.length - 0.001) * z,
        plane_normal=-z,
        plane_friction=0.0,
        tool=BALL_TOOL,
    )
    log = simulate(arm, scene, 0)
    force = log.wrench[-1, 3:]
    np.testing.assert_allclose(force @ -z, 50.0, atol=2.0)  # the controller's integrator has 4 1/s
    # MuJoCo's least coefficient of friction is 1e-5
    np.testing.assert_allclose(force, (force @ -z) * -z, atol=1e-5 * 50.0 * 1.5)
    # The ball's centre is on E's axis: a force along it has no moment but for the arm's deflection
    np.testing.assert_allclose(log.wrench[-1, :3], 0.0, atol=0.3)
    expected = -arm.chain.jacobian(log.recording.q[-1]).T @ log.wrench[-1]
    np.testing.assert_allclose(_torque_beyond_gravity(arm, log), expected, atol=TORQUE_NOISE)


def test_the_same_seed_gives_the_same_log_and_another_does_not() -> None:
    logs = []
    for seed in (0, 0, 1):
        drawn = draw_arm("ur10e", seed)
        scene = CASES["steps"](drawn.robot, drawn.coulomb, seed)
        short = replace(
            scene,
            **{name: getattr(scene, name)[3000:3300] for name in ("q", "v", "vdot", "wrench")},
        )
        logs.append(simulate(drawn, short, seed))
    one, same, other = (log.recording for log in logs)
    for name in ("t", "q", "v", "current"):
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name))
    np.testing.assert_array_equal(logs[0].wrench, logs[1].wrench)
    assert np.abs(one.current - other.current).max() > 0.1


def test_elastic_gears_follow_the_motors_and_hold_the_same_gravity(arm: MujocoArm) -> None:
    scene = _still(arm)
    rigid, elastic = (
        simulate(arm, s, 0) for s in (scene, replace(scene, stiffness=JOINT_STIFFNESS))
    )
    torques = [_torque_beyond_gravity(arm, log) for log in (rigid, elastic)]
    np.testing.assert_allclose(torques[0], torques[1], atol=2 * TORQUE_NOISE)


@pytest.mark.parametrize("motion", [wave, pick_and_place])
def test_velocities_and_accelerations_are_those_of_the_positions(arm: MujocoArm, motion) -> None:
    q, v, vdot = motion(arm.robot, 8.0, 0)
    # Second-order differences at 1 ms of motions of .3 Hz and quintics
    np.testing.assert_allclose(np.gradient(q, 1e-3, axis=0)[1:-1], v[1:-1], atol=1e-4)
    np.testing.assert_allclose(np.gradient(v, 1e-3, axis=0)[1:-1], vdot[1:-1], atol=0.02)


def test_a_drawn_arm_keeps_within_its_spreads_and_is_physical() -> None:
    drawn = draw_arm("ur10e", 5)
    stated, true = (chain.inertial_parameters for chain in (drawn.robot.chain, drawn.chain))
    mass = true[:, 0] / stated[:, 0]
    assert (np.abs(mass - 1.0) <= 0.15).all() and np.ptp(mass) > 0.05
    shift = np.linalg.norm(true[:, 1:4] / true[:, :1] - stated[:, 1:4] / stated[:, :1], axis=1)
    assert (shift <= 0.035).all() and shift.max() > 0.005
    # About its own centre of mass each link is as it was, but for the mass
    for k in range(6):
        ratio = _about_centre(true[k]) - mass[k] * _about_centre(stated[k])
        np.testing.assert_allclose(ratio, 0.0, atol=1e-12)


def _about_centre(parameters: np.ndarray) -> np.ndarray:
    m, c = parameters[0], parameters[1:4] / parameters[0]
    xx, xy, yy, xz, yz, zz = parameters[4:]
    about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return about_origin - m * (c @ c * np.eye(3) - np.outer(c, c))


@pytest.mark.long
def test_plain_tools_read_a_push_and_find_the_friction() -> None:
    drawn = draw_arm("ur10e", 2)
    logs = [
        simulate(drawn, MujocoScene(*wave(drawn.robot, 12.0, k, 1.0)), k).recording for k in (7, 8)
    ]
    plain = PlainModel.fit(drawn.robot, logs)
    # Noise of .06 A in 2 x 300 rows and the acceleration's rows share the rest
    np.testing.assert_allclose(plain.coulomb, drawn.coulomb, rtol=0.15)
    scene = CASES["constant"](drawn.robot, drawn.coulomb, 2)
    log = simulate(drawn, scene, 2)
    middle = slice(500, 1200)
    error = plain.read(log.recording)[middle] - log.wrench[middle, 3:]
    assert np.sqrt(np.mean(error**2)) < 5.0  # N, of 30


def _reading(truth: np.ndarray, error: np.ndarray, contacts) -> EstimatedLog:
    N = len(truth)
    return EstimatedLog("", truth + error, np.ones((N, 6)), np.zeros(N, np.int64), contacts, ())


def test_figures_count_shares_false_and_missed_contacts() -> None:
    drawn = draw_arm("ur10e", 0)
    log = simulate(drawn, _still(drawn), 0)
    N = 1000
    recording = replace(
        log.recording,
        t=0.01 * np.arange(N),
        **{name: np.zeros((N, 6)) for name in ("q", "v", "current")},
        dropout=np.zeros(N, bool),
    )
    wrench = np.zeros((N, 6))  # rotation first
    wrench[200:300, 3] = wrench[600:700, 4] = 20.0
    truth = np.roll(wrench, 3, axis=1)
    error = np.zeros((N, 6))
    error[800:, 0], error[900:, 1] = 2.5, 4.0
    contacts = ((2.02, 3.1), (8.0, 8.4))
    found = figures(
        replace(log, recording=recording, wrench=wrench), _reading(truth, error, contacts)
    )
    counted = N - 50 - 4 * 25  # the start, and after two edges each
    np.testing.assert_allclose(found["inside_95_pct"][0], 100.0 * (1.0 - 200 / counted))
    np.testing.assert_allclose(found["beyond_3sd_pct"][:2], [0.0, 100.0 * 100 / counted])
    assert (found["false_contacts"], found["missed"], found["true_contacts"]) == (1, 1, 2)
    assert found["share_valid_pct"] == 100.0
    assert found["invalid"] == {}


def test_a_refused_log_counts_as_not_valid_and_spoils_no_share() -> None:
    read = {
        "inside_95_pct": np.full(6, 96.0),
        "beyond_3sd_pct": np.zeros(6),
        "share_valid_pct": 90.0,
        "invalid": {"settling_pct": 10.0},
        "sd_n": np.ones(3),
        "false_contacts": 1,
        "seconds": 36.0,
        "missed": 0,
        "true_contacts": 2,
        "refused": 0.0,
        "ours": {"rmse_n": np.ones(3)},
        "plain": {"rmse_n": np.ones(3)},
    }
    nothing = {"inside_95_pct": np.full(6, np.nan), "beyond_3sd_pct": np.full(6, np.nan)}
    refused = read | nothing | {"share_valid_pct": 0.0, "refused": 1.0, "false_contacts": 0}
    refused["invalid"] = {}
    figure = summed_up([read, refused])
    np.testing.assert_array_equal(figure["inside_95_pct"]["worst"], np.full(6, 96.0))
    assert figure["share_valid_pct"]["worst"] == 0.0
    assert figure["all_false_contacts_per_hour"] == pytest.approx(50.0)
    assert figure["false_contacts_per_hour"]["worst"] == pytest.approx(100.0)
    assert figure["refused"] == 1.0
    assert figure["invalid"] == {"settling_pct": 5.0}  # of all draws

    # A case without any valid sample has no share at all, and the README's row does not name it.
    metrics = result_of({"ur10e": {"free": [read], "steps": [refused]}}, [], False)
    assert "inside_95_pct" not in metrics.metrics["ur10e"]["steps"]
    np.testing.assert_array_equal(metrics.metrics["ur10e"]["worst_inside_pct"], [96.0])
    [row] = metrics.comparison
    assert row.label.endswith("of 1, ur10e: free") and row.remark.endswith("in steps")


@pytest.mark.long
def test_a_short_log_is_read_by_the_command_s_own_call(tmp_path) -> None:
    drawn = draw_arm("ur10e", 4)
    drawn = replace(drawn, chain=drawn.robot.chain, coulomb=0.0 * drawn.coulomb)
    drawn = replace(drawn, viscous=0.0 * drawn.viscous)
    wrench = np.zeros((3000, 6))
    wrench[1000:, 5] = -30.0
    scene = replace(MujocoScene(*wave(drawn.robot, 3.0, 0)), wrench=wrench)
    log = simulate(drawn, scene, 4)
    reading = read_log(drawn, IdentifiedModel.nominal(drawn.robot), log, tmp_path, draws=False)
    assert not reading.refusal
    assert (tmp_path / "estimate" / "wrench.csv").is_file()
    # The observer's lag is over after 1 s; the prior draws the rest to zero by some newtons
    np.testing.assert_allclose(reading.wrench[220:, 2].mean(), -30.0, atol=4.0)


@pytest.mark.slow  # excite, two identifications and six logs
def test_the_experiment_runs(run_experiment) -> None:
    ran = run_experiment(EXPERIMENT, quick=True)
    assert ran.metrics["ur10e"]["steps"]["missed"]["worst"] == 0
