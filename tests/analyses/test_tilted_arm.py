"""One arm unlike the bundled ones through the whole pipeline.

Three joints, two of whose drives count their current the other way; a tool that is turned on the
flange and whose centre of mass lies beside it; a tilted base; joint ranges that are not symmetric.
No bundled arm has any of that, so that what ignores it works with them.

Nothing here is compared with what the code under test says of the arm. Poses and torques are
pinocchio's, which reads the URDF as it stands, bracket included, and is handed the tool; drives,
ranges and tool are written down once more.
"""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from called_commands import refused, succeeded
from pydrake.multibody.plant import MultibodyPlant
from sample_models import harmonic_motion

from wrenchsight.analyses.methods.excite.excitation import excite
from wrenchsight.analyses.methods.excite.excitation_config import ExcitationConfig
from wrenchsight.analyses.methods.simulate.simulation import simulate
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.diagrams.scenario import HoldMotion, Scenario, make_trajectory
from wrenchsight.models.control.wrench_script import WrenchStep
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.planning.excitation.excitation_limits import ExcitationLimits
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.force_torque_sensor import ForceTorqueSensorConfig
from wrenchsight.systems.impedance_controller import ImpedanceConfig

pytestmark = pytest.mark.long  # from a description to a wrench

# tests/robots/tilted_arm, once more.
_URDF = Path(__file__).parents[1] / "robots" / "tilted_arm" / "robot.urdf"
_E = ((0.05, -0.03, 0.14), (0.6, -0.7, 1.1))  # xyz in m and rpy in rad, on the flange
_TOOL_MASS, _TOOL_COM = 0.9, np.array([0.035, -0.02, 0.06])  # in the flange
_TOOL_INERTIA = np.array(
    [[0.0016, 0.0002, -0.0003], [0.0002, 0.0021, 0.00015], [-0.0003, 0.00015, 0.0011]]
)
_LOWER, _UPPER = np.array([-1.1, -2.2, -0.3]), np.array([2.4, 0.4, 2.1])
_AMPERE = np.array([-11.0, 12.0, -6.2])  # N m that one ampere, as counted by the drive, puts out
_ROTOR = np.array([0.5, 0.576, 0.21])  # kg m^2 on the joint side

_COULOMB, _VISCOUS, _OFFSET = np.array([[5.0, 6.0, 2.4], [7.0, 8.0, 3.0], [0.4, -0.3, 0.2]])
_HUNG = 2.0  # kg


class _Oracle:
    """Pinocchio's arm, in the room."""

    def __init__(self) -> None:
        self.model = pin.buildModelFromUrdf(str(_URDF))
        self.X_RW, flange = (
            pin.SE3(self.model.frames[self.model.getFrameId(name)].placement)  # a copy
            for name in ("base_link", "flange")
        )
        tool = pin.Inertia(_TOOL_MASS, _TOOL_COM, _TOOL_INERTIA)
        self.model.appendBodyToJoint(3, tool, flange)
        placement = flange * pin.SE3(pin.rpy.rpyToMatrix(*_E[1]), np.array(_E[0]))
        self.frame = self.model.addFrame(pin.Frame("E", 3, placement, pin.FrameType.OP_FRAME))
        self.model.armature = _ROTOR
        self.data = self.model.createData()
        # What a mass that hangs at E does to the robot: its weight, in axes of W, N.
        self.hung_force = self.X_RW.rotation.T @ [0.0, 0.0, -9.81 * _HUNG]

    def pose(self, q: Array) -> tuple[Array, Array]:
        """R_WE and p_WE."""
        pin.framesForwardKinematics(self.model, self.data, q)
        X = self.X_RW.inverse() * self.data.oMf[self.frame]
        return X.rotation.copy(), X.translation.copy()

    def motor_torque(self, q: Array, v: Array, vdot: Array, force: Array | None = None) -> Array:
        """(T, 3) without friction; `force` (3,) acts on the robot at E, axes of W."""
        rows = zip(q, v, vdot, strict=True)
        tau = np.array([pin.rnea(self.model, self.data, *row) for row in rows])
        if force is not None:
            for k, row in enumerate(q):
                J = pin.computeFrameJacobian(
                    self.model, self.data, row, self.frame, pin.LOCAL_WORLD_ALIGNED
                )
                tau[k] -= J[:3].T @ self.X_RW.rotation @ force  # it relieves the motors
        return tau

    def holding_torque(self, q: Array, hung: float = 0.0) -> Array:
        """(3,) N m with which the motors hold the arm, and a mass at E, at rest."""
        still = np.zeros((1, 3))
        return self.motor_torque(q[None], still, still, self.hung_force * hung / _HUNG)[0]


_ORACLE = _Oracle()
_FORCE_ONLY = WrenchEstimatorConfig(
    MomentumObserverConfig(), WrenchReconstructionConfig("force_only")
)
_HANGING = Scenario(
    duration=1.0,
    motion=HoldMotion([1.4, -0.4, 1.1]),
    friction="none",
    current_noise=False,
    wrench=[WrenchStep(force=_ORACLE.hung_force.tolist())],
    force_torque_sensor=ForceTorqueSensorConfig(),
    estimator=_FORCE_ONLY,
)


def _postures(count: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(_LOWER, _UPPER, (count, 3))


def _motion(t: Array, seed: int) -> tuple[Array, Array, Array]:
    """Three harmonics of 0.1 Hz within the joints' ranges."""
    rates = 0.2 * np.pi * np.arange(1, 4)
    motion = harmonic_motion(np.random.default_rng(seed), t, rates, 0.6, least=0.5)
    q, v, vdot = (x[:, :3] for x in motion)
    return q + 0.5 * (_LOWER + _UPPER), v, vdot


def _write_log(path: Path, t: Array, q: Array, v: Array, **signal: Array) -> Path:
    """A log as a user has it: t,q1..q3,v1..v3 and i1..i3 (A) or tau1..tau3 (N m)."""
    ((letter, values),) = signal.items()
    header = ["t", *(f"{name}{j}" for name in ("q", "v", letter) for j in (1, 2, 3))]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(np.column_stack([t, q, v, values]).tolist())
    return path


def _wrenches(out: Path) -> tuple[Array, Array, Array]:
    """Time, wrench (T, 6) force first and flags of an estimate's table."""
    table = np.genfromtxt(out / "wrench.csv", delimiter=",", skip_header=1)
    return table[:, 0], table[:, 1:7], table[:, 14]


@pytest.fixture(autouse=True)
def _no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes longer than all else, and has tests of its own."""
    monkeypatch.setattr(OutputFolder, "write_figure", lambda self, name, figure: self.path / name)


# The arm as it is read ----------------------------------------------------------------------------


def test_E_is_where_the_drawing_puts_it(tilted_arm: Robot) -> None:
    """Flange, tool frame (its rotation, too) and joints: 1e-12 is rounding."""
    for q in _postures(50, 1):
        R, p = tilted_arm.chain.pose(q)
        R_WE, p_WE = _ORACLE.pose(q)
        np.testing.assert_allclose(R, R_WE, atol=1e-12)
        np.testing.assert_allclose(p, p_WE, atol=1e-12)


def test_dynamics_are_those_of_the_arm_in_the_room(tilted_arm: Robot) -> None:
    """The bracket's tilt, the tool's mass, centre and inertia, the rotors."""
    rng = np.random.default_rng(2)
    q, v, vdot = _postures(20, 3), *rng.normal(size=(2, 20, 3))
    expected = _ORACLE.motor_torque(q, v, vdot)
    np.testing.assert_allclose(tilted_arm.chain.inverse_dynamics(q, v, vdot), expected, atol=1e-10)
    # And of the plant that is simulated.
    plant = MultibodyPlant(0.0)
    tilted_arm.add_to_plant(plant)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    for k in range(len(q)):
        plant.SetPositions(context, q[k])
        plant.SetVelocities(context, v[k])
        tau = plant.CalcMassMatrix(context) @ vdot[k] + plant.CalcBiasTerm(context)
        tau -= plant.CalcGravityGeneralizedForces(context)
        np.testing.assert_allclose(tau, expected[k], atol=1e-10)


def test_drives_and_ranges_are_the_files(tilted_arm: Robot) -> None:
    gain = tilted_arm.current_sign * tilted_arm.torque_per_ampere
    np.testing.assert_allclose(gain, _AMPERE, rtol=1e-12)
    np.testing.assert_allclose(tilted_arm.reflected_inertia, _ROTOR, rtol=1e-12)
    np.testing.assert_array_equal(tilted_arm.position_lower, _LOWER)
    np.testing.assert_array_equal(tilted_arm.position_upper, _UPPER)


# Estimate -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hung_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds at rest, a mass hung at the tool: currents of the static oracle."""
    q = np.array([0.9, -1.1, 0.6])
    t = 0.005 * np.arange(400)
    still = np.zeros((400, 3))
    current = np.tile(_ORACLE.holding_torque(q, _HUNG) / _AMPERE, (400, 1))
    folder = tmp_path_factory.mktemp("hung")
    return _write_log(folder / "log.csv", t, np.tile(q, (400, 1)), still, i=current)


def test_a_known_mass_is_read_as_its_weight(
    tilted_arm_file: Path, hung_log: Path, tmp_path: Path
) -> None:
    options = ("--robot", tilted_arm_file, "--method", "force_only")
    succeeded("estimate", hung_log, *options, "--out", tmp_path)
    t, wrench, _ = _wrenches(tmp_path)
    # K_0 is 20 /s: e^-20 is left after a second, 1e-8 of 20 N.
    np.testing.assert_allclose(wrench[t > 1.0, :3] - _ORACLE.hung_force, 0.0, atol=1e-5)
    np.testing.assert_array_equal(wrench[:, 3:], 0.0)


def test_measured_torque_does_without_the_drives_sign(
    tilted_arm_file: Path, tmp_path: Path
) -> None:
    """Torque in the log is the joints' own, whichever way the drives count."""
    q, t = np.array([1.4, -0.4, 1.1]), 0.005 * np.arange(400)
    rows = np.tile(np.concatenate([q, np.zeros(3), _ORACLE.holding_torque(q, _HUNG)]), (400, 1))
    log = _write_log(tmp_path / "log.csv", t, rows[:, :3], rows[:, 3:6], tau=rows[:, 6:])
    out = tmp_path / "out"
    succeeded("estimate", log, "--robot", tilted_arm_file, "--method", "force_only", "--out", out)
    t, wrench, _ = _wrenches(out)
    np.testing.assert_allclose(wrench[t > 1.0, :3] - _ORACLE.hung_force, 0.0, atol=1e-5)


def test_three_joints_cannot_determine_six_components(
    tilted_arm_file: Path, hung_log: Path, tmp_path: Path
) -> None:
    """Eq. 22 has no inverse here: finite, flagged throughout."""
    succeeded(
        "estimate", hung_log, "--robot", tilted_arm_file, "--method", "inverse", "--out", tmp_path
    )
    _, wrench, valid = _wrenches(tmp_path)
    assert np.isfinite(wrench).all()
    assert not valid.any()


def test_currents_counted_the_wrong_way_are_named(tilted_arm_file: Path, tmp_path: Path) -> None:
    """As if the robot's file had no current_sign: the joints are named, and nothing is valid."""
    t = np.arange(0.0, 20.0, 0.01)
    q, v, vdot = _motion(0.1 * t, 5)  # slow: gravity is all there is
    current = _ORACLE.motor_torque(q, 0.1 * v, 0.01 * vdot) / np.abs(_AMPERE)
    log = _write_log(tmp_path / "log.csv", t, q, 0.1 * v, i=current)
    out = tmp_path / "out"
    said = succeeded("estimate", log, "--robot", tilted_arm_file, "--out", out)
    assert "currents of the opposite sign at waist, elbow" in said
    assert "turned: [1, 3]" in said
    assert not _wrenches(out)[2].any()
    right = _write_log(tmp_path / "right.csv", t, q, 0.1 * v, i=current * np.sign(_AMPERE))
    said = succeeded("estimate", right, "--robot", tilted_arm_file, "--out", tmp_path / "right")
    assert "opposite sign" not in said


@pytest.mark.parametrize(
    ("joint", "position", "fits"),
    [(0, 2.3, True), (0, -2.2, False), (1, -2.1, True), (1, 1.4, False), (2, -1.3, False)],
)
def test_each_side_of_a_range_counts(
    tilted_arm: Robot, tmp_path: Path, joint: int, position: float, fits: bool
) -> None:
    """What lies within the wider side's size, but on the narrower side, is beyond the range."""
    q = tilted_arm.home.copy()
    q[joint] = position
    t, still = 0.005 * np.arange(400), np.zeros((400, 3))
    current = np.tile(_ORACLE.holding_torque(q) / _AMPERE, (400, 1))
    log = _write_log(tmp_path / "log.csv", t, np.tile(q, (400, 1)), still, i=current)
    words = ("estimate", log, "--robot", tilted_arm.source, "--out", tmp_path / "out")
    scenario = replace(_HANGING, motion=HoldMotion(q.tolist()))
    if fits:
        succeeded(*words)
        make_trajectory(scenario, tilted_arm)
    else:
        assert f"q is {position:g} rad, expected {_LOWER[joint]:g} to" in refused(*words)
        with pytest.raises(InputError, match=f"{tilted_arm.joint_names[joint]} .* beyond"):
            make_trajectory(scenario, tilted_arm)


# Identify, then estimate --------------------------------------------------------------------------


def _friction(v: Array) -> Array:
    return np.asarray(_COULOMB * np.sign(v) + _VISCOUS * v + _OFFSET)


@pytest.fixture(scope="module")
def identified(tilted_arm_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the command's results: two logs fitted, a third predicted."""
    folder = tmp_path_factory.mktemp("identified")
    t = np.arange(0.0, 20.0, 0.01)
    logs = []
    for seed in (1, 2, 3):
        q, v, vdot = _motion(t, seed)
        current = (_ORACLE.motor_torque(q, v, vdot) + _friction(v)) / _AMPERE
        logs.append(_write_log(folder / f"run_{seed}.csv", t, q, v, i=current))
    out = folder / "out"
    options = ("--robot", tilted_arm_file, "--validate", logs[2], "--out", out)
    output = succeeded("identify", *logs[:2], *options)
    assert "inconsistent gravity" not in output and "unexplained" not in output
    return out


def test_identify_finds_the_arm(identified: Path, tilted_arm: Robot) -> None:
    model = IdentifiedModel.load(identified / "model.yaml", tilted_arm)
    law = model.friction.coulomb_viscous
    # The instant of a reversal is known to 10 ms: see test_identification.
    np.testing.assert_allclose(law.coulomb, _COULOMB, rtol=0.02)
    np.testing.assert_allclose(law.viscous, _VISCOUS, rtol=0.02)
    np.testing.assert_allclose(law.offset, _OFFSET, atol=0.05)
    q, v, vdot = _motion(np.linspace(0.0, 10.0, 200), 7)
    torque = model.chain(tilted_arm).inverse_dynamics(q, v, vdot)
    # 0.05 N m of 30: what sgn(v) on a grid leaves.
    np.testing.assert_allclose(torque, _ORACLE.motor_torque(q, v, vdot), atol=0.05)
    validation = json.loads((identified / "metrics.json").read_text())["validation"]["run_3"]
    assert max(validation["relative_pct"]) < 1.0


def test_torque_in_the_log_identifies_the_same_arm(
    identified: Path,
    tilted_arm_file: Path,
    tilted_arm: Robot,
    tmp_path: Path,
) -> None:
    t = np.arange(0.0, 20.0, 0.01)
    logs = []
    for seed in (1, 2):
        q, v, vdot = _motion(t, seed)
        tau = _ORACLE.motor_torque(q, v, vdot) + _friction(v)
        logs.append(_write_log(tmp_path / f"run_{seed}.csv", t, q, v, tau=tau))
    succeeded("identify", *logs, "--robot", tilted_arm_file, "--out", tmp_path / "out")
    coulomb, expected = (
        np.array(json.loads((folder / "metrics.json").read_text())["friction"]["coulomb_nm"])
        for folder in (tmp_path / "out", identified)
    )
    np.testing.assert_allclose(coulomb, expected, rtol=1e-6)
    # What the observer errs by is learnt with the drives' signs, though no drive was read.
    of_torques, of_currents = (
        IdentifiedModel.load(folder / "model.yaml", tilted_arm).torque_error
        for folder in (tmp_path / "out", identified)
    )
    assert of_torques is not None and of_currents is not None
    np.testing.assert_allclose(of_torques.constant, of_currents.constant, rtol=1e-3)


def test_a_moving_arms_load_is_read(
    identified: Path, tilted_arm_file: Path, tmp_path: Path
) -> None:
    """A constant force on an arm that moves steadily, with friction."""
    t, rate = 0.002 * np.arange(1000), np.array([-0.4, 0.3, -0.2])
    q = np.array([1.4, -0.4, 1.1]) + t[:, None] * rate
    v, vdot = np.tile(rate, (1000, 1)), np.zeros((1000, 3))
    current = (_ORACLE.motor_torque(q, v, vdot, _ORACLE.hung_force) + _friction(v)) / _AMPERE
    log = _write_log(tmp_path / "log.csv", t, q, v, i=current)
    options = ("--model", identified / "model.yaml", "--out", tmp_path / "out")
    given = ("--robot", tilted_arm_file, "--method", "force_only", "--k0", "50")
    succeeded("estimate", log, *given, *options)
    error = _wrenches(tmp_path / "out")[1][t > 0.5, :3] - _ORACLE.hung_force
    # K_0 of 50 /s lags by 20 ms what changes by 5 N m a second over levers of 0.2 m and more, and
    # the identified torque is good to 0.05 N m.
    assert np.abs(error).max() < 0.8


# Simulate -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", ["none", "full"])
def test_the_simulated_arm_holds_a_mass_with_the_statics_currents(
    tilted_arm: Robot, friction: str
) -> None:
    """The plant, its drives, its sensor and the estimator in the loop, against statics."""
    run = simulate(replace(_HANGING, friction=friction, duration=1.5), tilted_arm)
    assert np.abs(run.v[-1]).max() < 1e-4
    torque = run.current[-1] * _AMPERE
    # Stiction holds what it can: then only what motor and friction hold together is known.
    within = 1e-4 if friction == "none" else tilted_arm.truth.stiction
    assert np.all(np.abs(torque - _ORACLE.holding_torque(run.q[-1], _HUNG)) <= within)
    assert run.ft_wrench is not None
    np.testing.assert_allclose(run.ft_wrench[-1, 3:], _ORACLE.hung_force, atol=1e-3)
    np.testing.assert_allclose(run.ft_wrench[-1, :3], 0.0, atol=1e-3)
    if friction == "none":
        np.testing.assert_allclose(run.wrench[-1, 3:], _ORACLE.hung_force, atol=1e-3)


def test_the_simulated_log_is_read_as_in_the_loop(tilted_arm_file: Path, tmp_path: Path) -> None:
    """By the commands: a scenario's file, its log.csv, and `estimate` on it."""
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(
        f"""
Swing:
  robot: {tilted_arm_file}
  duration: 1.2
  motion: !JointSineMotion
    {{amplitude: [0.2, 0.15, 0.2], frequency: [0.5], centre: [1.2, -0.3, 1.0], ramp: 0.5}}
  friction: none
  current_noise: false
  wrench:
  - !WrenchStep {{force: {_ORACLE.hung_force.tolist()}}}
  estimator: {{reconstruction: {{method: force_only}}}}
"""
    )
    out = tmp_path / "simulated"
    succeeded("simulate", "--scenario", scenario, "--no-recording", "--out", out)
    metrics = json.loads((out / "metrics.json").read_text())
    given = ("--robot", tilted_arm_file, "--method", "force_only", "--out", tmp_path / "read")
    succeeded("estimate", out / "log.csv", *given)
    t, wrench, _ = _wrenches(tmp_path / "read")
    error = wrench[:, :3] - _ORACLE.hung_force
    # 20 time constants of the observer; then its lag of 50 ms behind what the motion changes.
    assert np.abs(error[t > 1.0]).max() < 1.5
    for k, axis in enumerate("xyz"):
        # The loop's own reading. It takes its currents as held over a tick, `estimate` those of a
        # log as samples: half a tick of 1 ms beside the observer's 50 ms.
        rmse = np.sqrt(np.mean(error[:, k] ** 2))
        assert metrics[f"rmse_f{axis}_n"] == pytest.approx(rmse, rel=0.02)


@pytest.mark.parametrize("axes", ["W", "E"])
def test_a_spring_in_axes_of_the_tool_gives_way_along_them(tilted_arm: Robot, axes: str) -> None:
    """Three stiffnesses: the weight stretches each by its own share, in W or as E is turned."""
    stiffness, damping = np.array([3000.0, 6000.0, 12000.0]), np.array([300.0, 400.0, 500.0])
    spring = ImpedanceConfig(
        axes, np.append(stiffness, np.zeros(3)), np.append(damping, np.zeros(3))
    )
    run = simulate(replace(_HANGING, controller=spring, duration=2.0), tilted_arm)
    assert np.abs(run.v[-1]).max() < 1e-3
    (_, start), (R_WE, end) = (_ORACLE.pose(np.array(q)) for q in (_HANGING.motion.q, run.q[-1]))
    R = R_WE if axes == "E" else np.eye(3)
    stretched = R.T @ (end - start)
    # The moment that such a spring has as well, its stretch times its force, turns the arm a bit.
    np.testing.assert_allclose(stretched, R.T @ _ORACLE.hung_force / stiffness, atol=2e-4)


# What to do with the arm --------------------------------------------------------------------------


def test_an_excitation_keeps_ranges_that_are_not_symmetric(tilted_arm: Robot) -> None:
    limits = ExcitationLimits(position_margin=0.1, torque_share=0.2, floor=None)
    config = ExcitationConfig(limits=limits, num_starts=4, iterations=25)
    result = excite(tilted_arm, config)
    assert result.undetermined == ()
    q, v, vdot = result.trajectory.sample(np.linspace(0.0, result.trajectory.period, 2000))
    # 1e-6: what the solver calls equal.
    assert np.all(q >= _LOWER + 0.1 - 1e-6) and np.all(q <= _UPPER - 0.1 + 1e-6)
    peak = np.abs(_ORACLE.motor_torque(q, v, vdot)).max(axis=0)
    # Another 2000 moments than the command's: between them the torque hardly changes.
    np.testing.assert_allclose(result.peak_torque_share * [120.0, 110.0, 60.0], peak, rtol=1e-3)
    assert np.all(result.peak_torque_share <= 0.2)


@pytest.mark.parametrize(
    "words",
    [
        ("place", "--task", "linear_path"),
        ("place", "--task", "linear_path", "--objective", "force-sd"),
        ("place", "--task", "linear_path", "--solver", "pso-ga"),
        ("redundancy", "--task", "blade_path"),
        ("jcn-map", "--samples", "100"),
        ("jcn-map", "--samples", "100", "--slice", "z=0.3"),
    ],
)
def test_a_command_that_needs_six_joints_reports_it(
    tilted_arm_file: Path, tmp_path: Path, words: tuple[str, ...]
) -> None:
    line = refused(*words, "--robot", tilted_arm_file, "--out", tmp_path / "out")
    assert line.startswith("tilted_arm: 3 joints cannot hold position and orientation")
    assert not (tmp_path / "out" / "metrics.json").exists()
