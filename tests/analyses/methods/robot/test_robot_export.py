"""An identified arm in Drake and in MuJoCo: the same accelerations, and the same motion."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from wrenchsight.analyses.methods.robot.robot_export import export_robot
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot

COULOMB = np.array([14.0, 11.0, 5.0, 2.5, 3.0, 2.5])  # N m
VISCOUS = np.array([20.0, 22.0, 14.0, 4.0, 2.5, 3.5])  # N m s/rad


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of other inertias than the robot's, physical, with friction."""
    robot = Robot.load("ur10e")
    rng = np.random.default_rng(0)
    mass, size = rng.uniform(0.7, 1.3, (6, 1)), rng.uniform(0.9, 1.1, (6, 1))
    powers = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    friction = SemiParametricFriction(CoulombViscous(COULOMB, VISCOUS, 0.1 * COULOMB))
    identified = replace(
        IdentifiedModel.nominal(robot),
        inertial_parameters=robot.chain.inertial_parameters * mass * size**powers,
        reflected_inertia=rng.uniform(0.1, 1.5, 6),
        friction=friction,
    )
    path = tmp_path_factory.mktemp("export") / "model.yaml"
    identified.save(path)
    return path


@pytest.fixture(scope="module")
def files(model: Path) -> dict[str, Path]:
    """The exported files, by format."""
    return {
        form: export_robot(model, form, model.parent / f"arm.{form}").path
        for form in ("urdf", "mjcf")
    }


def _plant(urdf: Path, builder: DiagramBuilder | None = None) -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    (instance,) = Parser(plant).AddModelsFromString(urdf.read_text(), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base_link", instance))
    plant.Finalize()
    return plant if builder is None else builder.AddSystem(plant)


def _mujoco(mjcf: Path, with_coulomb: bool) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    if not with_coulomb:  # which Drake's joints do not have
        model.dof_frictionloss[:] = 0.0
    return model, mujoco.MjData(model)


def test_both_files_give_the_model_s_torque(model: Path, files: dict[str, Path]) -> None:
    robot = Robot.load("ur10e")
    chain = IdentifiedModel.load(model, robot).chain(robot)
    plant, (mj, data) = _plant(files["urdf"]), _mujoco(files["mjcf"], with_coulomb=False)
    context = plant.CreateDefaultContext()
    for q, v, a in np.random.default_rng(1).uniform(-1.5, 1.5, (10, 3, 6)):
        expected = chain.inverse_dynamics(q, v, a) + VISCOUS * v
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        # Drake's forces come with damping; inverse dynamics takes it as one of them
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        np.testing.assert_allclose(
            plant.CalcInverseDynamics(context, a, forces), expected, atol=1e-9
        )
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(mj, data)
        np.testing.assert_allclose(data.qfrc_inverse, expected, atol=1e-9)


def test_mujoco_has_the_coulomb_friction_beside(files: dict[str, Path]) -> None:
    mj, _ = _mujoco(files["mjcf"], with_coulomb=True)
    np.testing.assert_allclose(mj.dof_frictionloss, COULOMB, rtol=1e-6)
    np.testing.assert_allclose(mj.dof_damping, VISCOUS, rtol=1e-6)


def test_the_arm_falls_alike_in_drake_and_in_mujoco(files: dict[str, Path]) -> None:
    builder = DiagramBuilder()
    plant = _plant(files["urdf"], builder)
    torque = np.array([5.0, -60.0, -30.0, 2.0, 1.0, 0.5])
    source = builder.AddSystem(ConstantVectorSource(torque))
    builder.Connect(source.get_output_port(), plant.get_actuation_input_port())
    simulator = Simulator(builder.Build())
    simulator.get_mutable_integrator().set_target_accuracy(1e-9)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    home = np.array(Robot.load("ur10e").home)
    plant.SetPositions(context, home)
    simulator.AdvanceTo(0.5)

    mj, data = _mujoco(files["mjcf"], with_coulomb=False)
    mj.opt.timestep = 1e-4
    data.qpos[:], data.ctrl[:] = home, torque
    for _ in range(5000):
        mujoco.mj_step(mj, data)
    moved = plant.GetPositions(context) - home
    assert np.abs(moved).max() > 0.1
    # Euler steps of .1 ms: errors of the order of a step times the speed
    np.testing.assert_allclose(data.qpos - home, moved, atol=2e-4)


def test_a_model_that_is_not_physical_names_the_remedy(model: Path) -> None:
    robot = Robot.load("ur10e")
    identified = IdentifiedModel.load(model, robot)
    inertial = identified.inertial_parameters.copy()
    inertial[2, 4] = -1.0
    path = model.with_name("unphysical.yaml")
    replace(identified, inertial_parameters=inertial).save(path)
    with pytest.raises(InputError, match=r"elbow_joint is not physical.*identify with --consist"):
        export_robot(path, "mjcf", path.with_suffix(".xml"))
    assert not path.with_suffix(".xml").exists()


def test_a_file_of_coupled_motors_states_what_it_leaves_out(
    model: Path, coupled_wrist: Robot, tmp_path: Path
) -> None:
    path, out = tmp_path / "model.yaml", tmp_path / "arm.urdf"
    IdentifiedModel.nominal(coupled_wrist).save(path)
    robot_yaml = str(coupled_wrist.source)
    exported = export_robot(path, "urdf", out, robot_yaml)
    of_rotors = coupled_wrist.chain.rotor_matrix
    np.testing.assert_allclose(exported.rotors, of_rotors.diagonal(), rtol=1e-12)
    # Motors 4 and 5 turn with joint 4, motors 5 and 6 with joint 5.
    assert exported.uncoupled == pytest.approx(np.abs(np.triu(of_rotors, 1)).max())
    assert exported.uncoupled > 0.0
    with pytest.raises(InputError, match="states each joint's own part and what it leaves out"):
        export_robot(path, "mjcf", tmp_path / "arm.xml", robot_yaml)
    plain = export_robot(model, "urdf", model.with_name("plain.urdf"))
    assert plain.uncoupled == 0.0


def test_an_unknown_format_and_an_unknown_robot_are_named(model: Path) -> None:
    with pytest.raises(InputError, match="give urdf or mjcf"):
        export_robot(model, "sdf", model.with_name("arm.sdf"))
    text = model.read_text().replace("robot: ur10e", "robot: my_arm")
    other = model.with_name("other.yaml")
    other.write_text(text)
    with pytest.raises(InputError, match=r'"my_arm", which is not a bundled one'):
        export_robot(other, "urdf", model.with_name("arm.urdf"))
