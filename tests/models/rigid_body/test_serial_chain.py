"""The kernels against Drake, against pinocchio, and against what both do not offer."""

import copy
import dataclasses
import pickle
import re
from importlib.metadata import distribution
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numba import njit
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BallRpyJoint,
    FixedOffsetFrame,
    Frame,
    JacobianWrtVariable,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
    UnitInertia,
    WeldJoint,
)

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.chain_kernels import (
    SCRATCH_COLUMNS,
    JointDynamics,
    dynamics_terms,
    observer_terms,
)
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

# Rounding of some hundred operations on numbers of the result's size is below 1e-12 of it.
TOLERANCE = 1e-10

WHEEL = "share/example-robot-data/robots"
FILES = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "base_link", "tool0"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "base_link", "tool0"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp"),
}
BUNDLED = ("sts_sre4_600", "ur10e")


def wheel_urdf(name: str) -> str:
    """A robot of the example-robot-data wheel, without pictures and with its fingers locked."""
    files = distribution("example-robot-data").files or []
    path = next(file for file in files if str(file).endswith(f"{WHEEL}/{FILES[name][0]}"))
    text = Path(str(path.locate())).read_text()
    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.DOTALL)
    return re.sub(r'type="prismatic"', 'type="fixed"', text)


@dataclasses.dataclass
class Case:
    """One robot three times: as a chain, in Drake and in pinocchio."""

    chain: SerialChain
    plant: MultibodyPlant
    model_instance: ModelInstanceIndex
    frame_E: Frame
    pinocchio_model: pinocchio.Model
    pinocchio_frame: str

    def samples(self, count: int, seed: int = 0) -> tuple[Array, Array, Array]:
        """q, v and vdot, (count, n) each."""
        rng = np.random.default_rng(seed)
        return tuple(rng.uniform(-2.5, 2.5, (3, count, self.chain.num_joints)))  # type: ignore[return-value]


def plant_of(urdf: str, base: str | None = None) -> tuple[MultibodyPlant, ModelInstanceIndex]:
    plant = MultibodyPlant(1e-3)
    (model_instance,) = Parser(plant).AddModelsFromString(urdf, "urdf")
    if base is not None:
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(base, model_instance))
    return plant, model_instance


def add_rotors(plant: MultibodyPlant, rng: np.random.Generator) -> None:
    """Gives every joint of a plant that is not finalized an actuator with a rotor.

    It comes after those that the file's transmissions have brought, so Drake takes this one's.
    """
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if joint.num_velocities() == 1:
            actuator = plant.AddJointActuator(f"{joint.name()}_drive", joint)
            actuator.set_default_rotor_inertia(rng.uniform(1e-5, 1e-4))
            actuator.set_default_gear_ratio(rng.uniform(50.0, 120.0))


def case_of(
    urdf: str, plant: MultibodyPlant, model_instance: ModelInstanceIndex, frame: str
) -> Case:
    frame_E = plant.GetFrameByName(frame, model_instance)
    chain = SerialChain.from_plant(plant, model_instance, frame_E)
    model = pinocchio.buildModelFromXML(urdf)
    model.armature = np.array(chain.reflected_inertia)
    assert list(model.names)[1:] == list(chain.joint_names)
    return Case(chain, plant, model_instance, frame_E, model, frame)


@pytest.fixture(scope="module", params=[*BUNDLED, *FILES])
def case(request: pytest.FixtureRequest) -> Case:
    name = request.param
    if name in BUNDLED:
        robot = Robot.load(name)
        plant = MultibodyPlant(1e-3)
        parts = robot.add_to_plant(plant)
        plant.Finalize()
        case = case_of(robot.urdf_text, plant, parts.model_instance, parts.frame_E.name())
        assert np.array_equal(case.chain.table, robot.chain.table)
        return case
    urdf = wheel_urdf(name)
    _, base, tip = FILES[name]
    welded = re.search(r'link name="world"', urdf) is not None
    plant, model_instance = plant_of(urdf, None if welded else base)
    add_rotors(plant, np.random.default_rng(1))
    plant.Finalize()
    return case_of(urdf, plant, model_instance, tip)


def assert_close(actual: Array, expected: Array, name: str) -> None:
    assert actual.shape == expected.shape, name
    scale = max(1.0, np.abs(expected).max())
    error = np.abs(actual - expected).max()
    assert error <= TOLERANCE * scale, f"{name}: {error}"


def assert_equals_drake(case: Case, q: Array, v: Array, vdot: Array) -> None:
    """One sample against MultibodyPlant."""
    chain, plant = case.chain, case.plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, case.model_instance, q)
    plant.SetVelocities(context, case.model_instance, v)
    terms = chain.terms(q, v)
    X_WE = case.frame_E.CalcPoseInWorld(context)
    V_WE = case.frame_E.CalcSpatialVelocityInWorld(context).get_coeffs()
    M = plant.CalcMassMatrix(context)
    G = -plant.CalcGravityGeneralizedForces(context)
    Cv = plant.CalcBiasTerm(context)
    world = plant.world_frame()
    J = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, case.frame_E, np.zeros(3), world, world
    )
    assert_close(terms.R_WE, X_WE.rotation().matrix(), "R_WE")
    assert_close(terms.p_WE, X_WE.translation(), "p_WE")
    assert_close(terms.V_WE, V_WE, "V_WE")
    assert_close(terms.J, J, "J")
    assert_close(terms.M, M, "M")
    assert_close(terms.momentum, M @ v, "momentum")
    assert_close(terms.G, G, "G")
    assert_close(terms.Cv, Cv, "Cv")
    assert_close(chain.inverse_dynamics(q, v, vdot), M @ vdot + Cv + G, "inverse dynamics")
    energy = np.array(plant.CalcKineticEnergy(context))  # the rotors' included
    assert_close(0.5 * terms.momentum @ v, energy, "kinetic energy")


def assert_equals_pinocchio(case: Case, q: Array, v: Array, vdot: Array) -> None:
    """One sample against pinocchio, which must not be asked with computeAllTerms (data.g)."""
    chain, model = case.chain, case.pinocchio_model
    # Continuous joints would have two coordinates there; none of the robots here has any.
    assert model.nq == model.nv == chain.num_joints
    data = model.createData()
    terms = chain.terms(q, v)
    M = pinocchio.crba(model, data, q)
    M = np.triu(M) + np.triu(M, 1).T
    C = pinocchio.computeCoriolisMatrix(model, data, q, v).copy()
    G = pinocchio.computeGeneralizedGravity(model, data, q).copy()
    pinocchio.computeJointJacobians(model, data, q)
    pinocchio.framesForwardKinematics(model, data, q)
    frame = model.getFrameId(case.pinocchio_frame)
    J = pinocchio.getFrameJacobian(model, data, frame, pinocchio.LOCAL_WORLD_ALIGNED)
    J = J.reshape(6, -1)  # pinocchio makes a vector of a single column or row
    assert_close(terms.p_WE, data.oMf[frame].translation, "p_WE")
    assert_close(terms.R_WE, data.oMf[frame].rotation, "R_WE")
    assert_close(terms.J, np.vstack([J[3:], J[:3]]), "J")
    assert_close(terms.V_WE, terms.J @ v, "V_WE")
    assert_close(terms.M, M, "M")
    assert_close(terms.momentum, M @ v, "momentum")
    assert_close(terms.CTv, C.T @ v, "CTv")
    assert_close(terms.Cv, C @ v, "Cv")
    assert_close(terms.G, G, "G")
    tau = pinocchio.rnea(model, data, q, v, vdot).copy()
    assert_close(chain.inverse_dynamics(q, v, vdot), tau, "inverse dynamics")
    Y = pinocchio.computeJointTorqueRegressor(model, data, q, v, vdot)
    assert_close(chain.regressor(q, v, vdot), Y.reshape(model.nv, -1), "regressor")
    phi = np.array([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])
    assert_close(chain.inertial_parameters, phi, "inertial parameters")
    # Its kinetic energy forgets the armature of revolute joints off the axes (4.1): without it.
    bodies = pinocchio.Model(model)
    bodies.armature = np.zeros(model.nv)
    energy = np.array(pinocchio.computeKineticEnergy(bodies, bodies.createData(), q, v))
    rotors = 0.5 * chain.reflected_inertia @ v**2
    assert_close(0.5 * terms.momentum @ v, energy + rotors, "kinetic energy")


def test_every_term_equals_drake(case: Case) -> None:
    for q, v, vdot in zip(*case.samples(5), strict=True):
        assert_equals_drake(case, q, v, vdot)


def test_every_term_equals_pinocchio(case: Case) -> None:
    for q, v, vdot in zip(*case.samples(5, seed=1), strict=True):
        assert_equals_pinocchio(case, q, v, vdot)


def test_rotor_inertia_is_there_to_be_tested(case: Case) -> None:
    assert np.all(case.chain.reflected_inertia > 0.0)


def test_coriolis_transpose_is_the_gradient_of_drakes_kinetic_energy(case: Case) -> None:
    context = case.plant.CreateDefaultContext()

    def energy(q: Array, v: Array) -> float:
        case.plant.SetPositions(context, case.model_instance, q)
        return float(0.5 * v @ case.plant.CalcMassMatrix(context) @ v)

    step = 1e-4
    for q, v, _ in zip(*case.samples(3, seed=2), strict=True):
        gradient = np.array(
            [
                # The fourth-order difference is off by step^4 (1e-16) and rounding (1e-12).
                (
                    8.0 * (energy(q + h, v) - energy(q - h, v))
                    - (energy(q + 2.0 * h, v) - energy(q - 2.0 * h, v))
                )
                / (12.0 * step)
                for h in step * np.eye(len(q))
            ]
        )
        CTv = case.chain.terms(q, v).CTv
        assert np.abs(CTv - gradient).max() < 1e-8 * max(1.0, np.abs(gradient).max())


def test_power_balance(case: Case) -> None:
    """Mdot = C + C^T, so that d/dt (M v) at constant v is C v + C^T v."""
    step = 1e-5
    for q, v, _ in zip(*case.samples(3, seed=3), strict=True):
        chain = case.chain
        ahead, behind = (chain.terms(q + side * step * v, v).momentum for side in (1.0, -1.0))
        Mdot_v = (ahead - behind) / (2.0 * step)
        terms = chain.terms(q, v)
        expected = terms.Cv + terms.CTv
        # Second-order difference: step^2 times third derivatives (about v^3).
        assert np.abs(Mdot_v - expected).max() < 1e-7 * max(1.0, np.abs(expected).max())


def test_a_sample_and_a_row_of_many_agree_bit_for_bit(case: Case) -> None:
    chain = case.chain
    q, v, vdot = case.samples(300, seed=4)  # enough for threads, and a last block not full
    methods = {
        "pose": (q,),
        "jacobian": (q,),
        "condition_number": (q,),
        "gravity_torque": (q,),
        "momentum_terms": (q, v),
        "inverse_dynamics": (q, v, vdot),
        "regressor": (q, v, vdot),
    }
    for name, signals in methods.items():
        method = getattr(chain, name)
        many = method(*signals)
        first_two = [signal[:2] for signal in signals]
        few = method(*first_two)
        for k in (0, 1, 127, 128, 299):
            sample = [signal[k] for signal in signals]
            one = method(*sample)
            for whole, single in zip(*map(_as_tuple, (many, one)), strict=True):
                assert np.array_equal(whole[k], single), name
        for whole, part in zip(*map(_as_tuple, (many, few)), strict=True):
            assert np.array_equal(whole[:2], part), name
        in_three_blocks = [signal.reshape(3, 100, -1) for signal in signals]
        folded = method(*in_three_blocks)
        for whole, part in zip(*map(_as_tuple, (many, folded)), strict=True):
            assert part.shape[:2] == (3, 100)
            assert np.array_equal(whole, part.reshape(whole.shape)), name


def _as_tuple(value: Array | tuple[Array, ...]) -> tuple[Array, ...]:
    return value if isinstance(value, tuple) else (value,)


def test_terms_agree_with_the_separate_methods_bit_for_bit(case: Case) -> None:
    chain = case.chain
    q, v, _ = case.samples(70, seed=5)
    momentum, CTv, G = chain.momentum_terms(q, v)
    R_WE, p_WE = chain.pose(q)
    for k in (0, 69):
        terms = chain.terms(q[k], v[k])
        assert np.array_equal(terms.momentum, momentum[k])
        assert np.array_equal(terms.CTv, CTv[k])
        assert np.array_equal(terms.G, G[k])
        assert np.array_equal(terms.J, chain.jacobian(q)[k])
        assert np.array_equal(terms.R_WE, R_WE[k])
        assert np.array_equal(terms.p_WE, p_WE[k])
        assert np.array_equal(terms.q, q[k])
        assert np.array_equal(terms.v, v[k])
        # Gravity alone takes a shorter way.
        assert_close(chain.gravity_torque(q[k]), G[k], "G")
        n = len(q[k])
        dynamics = JointDynamics(np.empty((n, n)), np.empty(n), np.empty(n), q[k], v[k])
        dynamics_terms(chain.table, dynamics, np.empty((n, SCRATCH_COLUMNS)))
        for name in ("M", "Cv", "G"):
            assert np.array_equal(getattr(dynamics, name), getattr(terms, name))


@njit
def _observer_loop(table: Array, q: Array, v: Array, out: Array) -> None:
    n = q.shape[1]
    momentum, CTv, G, p_WE = np.empty(n), np.empty(n), np.empty(n), np.empty(3)
    J, R_WE, scratch = np.empty((6, n)), np.empty((3, 3)), np.empty((n, SCRATCH_COLUMNS))
    for k in range(q.shape[0]):
        observer_terms(table, q[k], v[k], momentum, CTv, G, J, R_WE, p_WE, scratch)
        out[k] = momentum + 2.0 * CTv + 3.0 * G + 4.0 * J.sum() + 5.0 * p_WE.sum() + R_WE[0, 1]


def test_observer_terms_from_another_kernel(ur10e: Robot) -> None:
    chain = ur10e.chain
    q, v = np.random.default_rng(0).uniform(-2.0, 2.0, (2, 5, 6))
    out = np.empty((5, 6))
    _observer_loop(chain.table, q, v, out)
    for k in range(5):
        t = chain.terms(q[k], v[k])
        expected = t.momentum + 2.0 * t.CTv + 3.0 * t.G
        expected += 4.0 * t.J.sum() + 5.0 * t.p_WE.sum() + t.R_WE[0, 1]
        assert np.abs(out[k] - expected).max() < 1e-12


def test_regressor_is_linear_even_in_impossible_parameters(case: Case) -> None:
    rng = np.random.default_rng(6)
    n = case.chain.num_joints
    phi = rng.normal(size=(n, 10))
    phi[0, 0] = 0.0  # moments without mass: no kernel may divide by it
    reflected = rng.uniform(0.0, 1.0, n)
    chain = case.chain.with_inertial_parameters(phi, reflected)
    q, v, vdot = case.samples(100, seed=6)
    Y = chain.regressor(q, v, vdot)
    tau = Y @ phi.ravel() + reflected * vdot
    assert_close(chain.inverse_dynamics(q, v, vdot), tau, "inverse dynamics")
    # d/dt (M v) - C^T v + G = tau, all of them linear too.
    for k in range(len(q)):
        terms = chain.terms(q[k], v[k])
        assert_close(terms.M @ vdot[k] + terms.Cv + terms.G, tau[k], "M vdot + C v + G")
        assert_close(terms.momentum, terms.M @ v[k], "momentum")
        assert_close(terms.G, chain.gravity_torque(q[k]), "G")


def test_other_inertias_leave_the_rest_alone(ur10e: Robot) -> None:
    chain = ur10e.chain
    other = chain.with_inertial_parameters(2.0 * chain.inertial_parameters)
    q = np.random.default_rng(7).uniform(-2.0, 2.0, 6)
    assert_close(other.gravity_torque(q), 2.0 * chain.gravity_torque(q), "G")
    assert np.array_equal(other.reflected_inertia, chain.reflected_inertia)
    assert np.array_equal(other.jacobian(q), chain.jacobian(q))
    third = chain.with_inertial_parameters(chain.inertial_parameters, np.zeros(6))
    rotors = np.diag(chain.terms(q, q).M - third.terms(q, q).M)
    assert_close(rotors, np.array(chain.reflected_inertia), "rotors")


def test_another_tool_frame(sts: Robot) -> None:
    chain = sts.chain
    offset = np.array([0.03, -0.02, 0.11])
    R_EF = RollPitchYaw(0.3, -0.4, 0.5).ToRotationMatrix().matrix()
    moved = dataclasses.replace(
        chain, R_LE=chain.R_LE @ R_EF, p_LE=chain.p_LE + chain.R_LE @ offset
    )
    q, v = np.random.default_rng(8).uniform(-2.0, 2.0, (2, 6))
    before, after = chain.terms(q, v), moved.terms(q, v)
    arm = before.R_WE @ offset
    assert_close(after.R_WE, before.R_WE @ R_EF, "R_WE")
    assert_close(after.p_WE, before.p_WE + arm, "p_WE")
    assert_close(after.V_WE[:3], before.V_WE[:3], "w")
    assert_close(after.V_WE[3:], before.V_WE[3:] + np.cross(before.V_WE[:3], arm), "V_WE")
    assert np.array_equal(after.momentum, before.momentum)


# Random chains


@dataclasses.dataclass(frozen=True)
class Link:
    """A link of a random chain: its joint, and what is fixed to it."""

    prismatic: bool
    axis_aligned: bool
    fixed_before: int  # fixed joints between the last moving link and this joint
    lumps: int  # bodies welded to the link, one to the other
    massless: bool


LINK = st.builds(
    Link,
    prismatic=st.booleans(),
    axis_aligned=st.booleans(),
    fixed_before=st.integers(0, 2),
    lumps=st.integers(0, 2),
    massless=st.booleans(),
)
# Numbers of joints that other tests have as well: each is compiled for.
LINKS = st.sampled_from((1, 2, 3, 6, 7)).flatmap(lambda n: st.lists(LINK, min_size=n, max_size=n))


def random_chain_urdf(links: list[Link], rng: np.random.Generator) -> str:
    """Welded to the world at a random pose; E is fixed to the last link, a lump beyond E."""
    parts = ['<robot name="random"><link name="world"/>']

    def vector(size: float = 1.0) -> str:
        return " ".join(repr(float(x)) for x in rng.uniform(-size, size, 3))

    def origin() -> str:
        return f'<origin xyz="{vector(0.6)}" rpy="{vector(3.0)}"/>'

    def link(name: str, massless: bool = False) -> None:
        inertial = ""
        if not massless:
            # The second moment of a mass distribution is positive; the inertia follows from it.
            A = rng.normal(size=(3, 3)) * 0.1
            mass = rng.uniform(0.1, 10.0)
            sigma = mass * (A @ A.T + 1e-4 * np.eye(3))
            I = np.trace(sigma) * np.eye(3) - sigma  # noqa: E741
            entries = " ".join(
                f'i{"xyz"[i]}{"xyz"[j]}="{float(I[i, j])!r}"' for i in range(3) for j in range(i, 3)
            )
            inertial = (
                f'<inertial><mass value="{mass!r}"/>{origin()}<inertia {entries}/></inertial>'
            )
        parts.append(f'<link name="{name}">{inertial}</link>')

    def joint(name: str, kind: str, parent: str, child: str, extra: str = "") -> None:
        parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f"{origin()}{extra}</joint>"
        )

    last = "base"
    link(last)
    joint("mount", "fixed", "world", last)
    for i, item in enumerate(links):
        for k in range(item.fixed_before):
            link(f"fixed_{i}_{k}", massless=k == 1)
            joint(f"weld_{i}_{k}", "fixed", last, f"fixed_{i}_{k}")
            last = f"fixed_{i}_{k}"
        axis = "0 0 1" if item.axis_aligned else vector()
        limits = '<limit effort="100" velocity="3" lower="-3" upper="3"/>'
        # The last link must have mass for Drake's M to be regular; others may do without.
        link(f"link_{i}", massless=item.massless and i < len(links) - 1)
        kind = "prismatic" if item.prismatic else "revolute"
        joint(f"joint_{i}", kind, last, f"link_{i}", f'<axis xyz="{axis}"/>{limits}')
        last = f"link_{i}"
        for k in range(item.lumps):
            link(f"lump_{i}_{k}")
            parent = last if k == 0 else f"lump_{i}_{k - 1}"
            joint(f"lump_joint_{i}_{k}", "fixed", parent, f"lump_{i}_{k}")
    link("tip", massless=True)
    joint("tip_joint", "fixed", last, "tip")
    link("beyond")
    joint("beyond_joint", "fixed", "tip", "beyond")
    return "".join([*parts, "</robot>"])


@settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
@given(links=LINKS, seed=st.integers(0, 2**32 - 1))
def test_random_chains_equal_drake_and_pinocchio(links: list[Link], seed: int) -> None:
    rng = np.random.default_rng(seed)
    urdf = random_chain_urdf(links, rng)
    plant, model_instance = plant_of(urdf)
    add_rotors(plant, rng)
    plant.Finalize()
    case = case_of(urdf, plant, model_instance, "tip")
    assert case.chain.num_joints == len(links)
    assert case.chain.prismatic.tolist() == [link.prismatic for link in links]
    q, v, vdot = rng.uniform(-2.0, 2.0, (3, len(links)))
    assert_equals_drake(case, q, v, vdot)
    assert_equals_pinocchio(case, q, v, vdot)


# Reading a plant

PENDULUM = """
<robot name="pendulum"><link name="world"/>
  <link name="rod"><inertial><mass value="2"/><origin xyz="0.5 0 0"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="hinge" type="revolute"><parent link="world"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit effort="10" velocity="3" lower="-3" upper="3"/></joint>
</robot>"""


def test_pendulum_in_closed_form() -> None:
    plant, model_instance = plant_of(PENDULUM)
    plant.Finalize()
    chain = SerialChain.from_plant(plant, model_instance, plant.GetFrameByName("rod"))
    q, v = 0.3, 1.7
    about_hinge = 0.02 + 2.0 * 0.5**2
    terms = chain.terms([q], [v])
    assert terms.M[0, 0] == pytest.approx(about_hinge, abs=1e-14)
    # A positive turn about y lowers the rod: gravity drives it on, the holding torque is negative.
    assert chain.gravity_torque([q])[0] == pytest.approx(-2.0 * 9.81 * 0.5 * np.cos(q), abs=1e-13)
    assert terms.momentum[0] == pytest.approx(about_hinge * v, abs=1e-13)
    assert terms.Cv[0] == pytest.approx(0.0, abs=1e-13)
    assert terms.CTv[0] == pytest.approx(0.0, abs=1e-13)


def test_the_last_actuator_of_a_joint_gives_its_rotor_inertia_as_in_drake() -> None:
    plant, model_instance = plant_of(PENDULUM)
    drive = plant.AddJointActuator("drive", plant.GetJointByName("hinge"))
    drive.set_default_rotor_inertia(1e-4)
    drive.set_default_gear_ratio(100.0)
    friction = plant.AddJointActuator("friction", plant.GetJointByName("hinge"))
    friction.set_default_rotor_inertia(2e-4)
    friction.set_default_gear_ratio(100.0)
    plant.Finalize()
    chain = SerialChain.from_plant(plant, model_instance, plant.GetFrameByName("rod"))
    assert chain.reflected_inertia.tolist() == pytest.approx([2.0])
    M = plant.CalcMassMatrix(plant.CreateDefaultContext())
    assert_close(chain.terms(np.zeros(1), np.zeros(1)).M, M, "M")


def test_gravity_is_the_plants() -> None:
    plant, model_instance = plant_of(PENDULUM)
    plant.mutable_gravity_field().set_gravity_vector([1.0, 2.0, -3.0])
    plant.Finalize()
    frame_E = plant.GetFrameByName("rod")
    chain = SerialChain.from_plant(plant, model_instance, frame_E)
    assert chain.gravity.tolist() == [1.0, 2.0, -3.0]
    weightless, model_instance = plant_of(PENDULUM)
    weightless.set_gravity_enabled(model_instance, False)
    weightless.Finalize()
    frame_E = weightless.GetFrameByName("rod")
    chain = SerialChain.from_plant(weightless, model_instance, frame_E)
    assert chain.gravity_torque([0.3]).tolist() == [0.0]


def _inertia(rng: np.random.Generator) -> SpatialInertia:
    mass, com = rng.uniform(0.5, 3.0), rng.uniform(-0.2, 0.2, 3)
    moments = rng.uniform(0.9, 1.1, 3) * 0.02
    central = RotationalInertia(*moments, 0.001, -0.001, 0.0005)
    return SpatialInertia.MakeFromCentralInertia(mass, com, central)


def _pose(rng: np.random.Generator) -> RigidTransform:
    return RigidTransform(RollPitchYaw(rng.uniform(-1.5, 1.5, 3)), rng.uniform(-0.5, 0.5, 3))


def test_joint_frames_off_the_links_frames_and_a_tool_of_another_model() -> None:
    """What no URDF says: joints at a pose in their child body, and a tool in its own instance."""
    rng = np.random.default_rng(9)
    plant = MultibodyPlant(1e-3)
    arm, tool = plant.AddModelInstance("arm"), plant.AddModelInstance("tool")
    bodies = [plant.AddRigidBody(f"b{i}", arm, _inertia(rng)) for i in range(3)]
    hand = plant.AddRigidBody("hand", tool, _inertia(rng))
    world = plant.world_body()
    plant.AddJoint(
        RevoluteJoint(
            "j0",
            plant.AddFrame(_fixed_offset("f0", world.body_frame(), _pose(rng))),
            plant.AddFrame(_fixed_offset("m0", bodies[0].body_frame(), _pose(rng))),
            np.array([0.6, 0.0, 0.8]),
        )
    )
    plant.AddJoint(
        PrismaticJoint(
            "j1",
            plant.AddFrame(_fixed_offset("f1", bodies[0].body_frame(), _pose(rng))),
            plant.AddFrame(_fixed_offset("m1", bodies[1].body_frame(), _pose(rng))),
            np.array([0.0, 0.6, 0.8]),
        )
    )
    plant.AddJoint(
        RevoluteJoint(
            "j2",
            plant.AddFrame(_fixed_offset("f2", bodies[1].body_frame(), _pose(rng))),
            plant.AddFrame(_fixed_offset("m2", bodies[2].body_frame(), _pose(rng))),
            np.array([1.0, 0.0, 0.0]),
        )
    )
    plant.AddJoint(
        WeldJoint(
            "grip",
            plant.AddFrame(_fixed_offset("f3", bodies[2].body_frame(), _pose(rng))),
            plant.AddFrame(_fixed_offset("m3", hand.body_frame(), _pose(rng))),
            _pose(rng),
        )
    )
    frame_E = plant.AddFrame(_fixed_offset("E", hand.body_frame(), _pose(rng)))
    # A workpiece that moves is nothing of the arm's.
    crate = plant.AddModelInstance("crate")
    plant.AddRigidBody("crate", crate, _inertia(rng))
    plant.Finalize()
    chain = SerialChain.from_plant(plant, arm, frame_E)
    assert chain.joint_names == ("j0", "j1", "j2")

    q, v, vdot = rng.uniform(-1.0, 1.0, (3, 3))
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, arm, q)
    plant.SetVelocities(context, arm, v)
    indices = [plant.GetJointByName(name).velocity_start() for name in chain.joint_names]
    terms = chain.terms(q, v)
    X_WE = frame_E.CalcPoseInWorld(context)
    assert_close(terms.p_WE, X_WE.translation(), "p_WE")
    assert_close(terms.R_WE, X_WE.rotation().matrix(), "R_WE")
    V_WE = frame_E.CalcSpatialVelocityInWorld(context).get_coeffs()
    assert_close(terms.V_WE, V_WE, "V_WE")
    assert_close(terms.M, plant.CalcMassMatrix(context)[np.ix_(indices, indices)], "M")
    assert_close(terms.Cv, plant.CalcBiasTerm(context)[indices], "Cv")
    assert_close(terms.G, -plant.CalcGravityGeneralizedForces(context)[indices], "G")
    Y = chain.regressor(q, v, vdot)
    tau = terms.M @ vdot + terms.Cv + terms.G
    assert_close(Y @ chain.inertial_parameters.ravel(), tau, "regressor")


def _fixed_offset(name: str, parent: Frame, X_PF: RigidTransform) -> Frame:
    return FixedOffsetFrame(name, parent, X_PF)


def test_a_plant_not_finalized() -> None:
    plant, model_instance = plant_of(PENDULUM)
    with pytest.raises(InputError, match=r"^pendulum: its plant is not finalized"):
        SerialChain.from_plant(plant, model_instance, plant.GetFrameByName("rod"))


def test_a_base_that_floats() -> None:
    plant, model_instance = plant_of(wheel_urdf("panda"))
    plant.Finalize()
    with pytest.raises(InputError, match=r"quaternion_floating.*weld the base"):
        SerialChain.from_plant(plant, model_instance, plant.GetFrameByName("panda_hand"))


def test_a_frame_that_does_not_move() -> None:
    plant, model_instance = plant_of(PENDULUM)
    plant.Finalize()
    with pytest.raises(InputError, match="no moving joint between the world and frame"):
        SerialChain.from_plant(plant, model_instance, plant.world_frame())


def test_a_moving_joint_off_the_chain() -> None:
    finger = """
      <link name="{0}"><inertial><mass value="0.1"/>
        <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="{0}_joint" type="prismatic"><parent link="{1}"/><child link="{0}"/>
        <axis xyz="0 1 0"/><limit effort="10" velocity="3" lower="-3" upper="3"/></joint></robot>"""
    urdf = PENDULUM.replace("</robot>", finger.format("finger", "rod"))
    plant, model_instance = plant_of(urdf)
    plant.Finalize()
    with pytest.raises(InputError, match=r"joint 'finger_joint': it moves.*'rod'; lock it"):
        SerialChain.from_plant(plant, model_instance, plant.GetFrameByName("rod"))
    # Read at the finger, it is the chain's last joint.
    chain = SerialChain.from_plant(plant, model_instance, plant.GetFrameByName("finger"))
    assert chain.joint_names == ("hinge", "finger_joint")
    # A second arm that stands on the same base is off the chain too.
    plant, model_instance = plant_of(PENDULUM.replace("</robot>", finger.format("door", "world")))
    plant.Finalize()
    with pytest.raises(InputError, match=r"joint 'door_joint': it moves"):
        SerialChain.from_plant(plant, model_instance, plant.GetFrameByName("rod"))


def test_a_gripper_of_another_model_that_moves() -> None:
    plant, model_instance = plant_of(PENDULUM)
    gripper = plant.AddModelInstance("gripper")
    finger = plant.AddRigidBody("finger", gripper, _inertia(np.random.default_rng(0)))
    rod = plant.GetFrameByName("rod")
    plant.AddJoint(PrismaticJoint("slide", rod, finger.body_frame(), np.array([0.0, 1.0, 0.0])))
    plant.Finalize()
    with pytest.raises(InputError, match=r"joint 'slide': it moves"):
        SerialChain.from_plant(plant, model_instance, plant.GetFrameByName("rod"))


def test_a_joint_of_several_degrees_of_freedom() -> None:
    plant = MultibodyPlant(1e-3)
    arm = plant.AddModelInstance("arm")
    body = plant.AddRigidBody("b", arm, SpatialInertia(1.0, np.zeros(3), UnitInertia(1, 1, 1)))
    plant.AddJoint(BallRpyJoint("ball", plant.world_frame(), body.body_frame()))
    plant.Finalize()
    with pytest.raises(InputError, match=r"^arm: joint 'ball': type ball_rpy between.*revolute"):
        SerialChain.from_plant(plant, arm, body.body_frame())


# The object


def test_wrong_shapes_are_refused(sts: Robot) -> None:
    chain = sts.chain
    for q in (np.zeros(5), np.zeros((3, 7)), np.zeros(()), np.zeros((6, 1))):
        with pytest.raises(ValueError, match=r"expected equal shapes \(\.\.\., 6\)"):
            chain.jacobian(q)
    with pytest.raises(ValueError, match="expected equal shapes"):
        chain.momentum_terms(np.zeros((3, 6)), np.zeros(6))
    with pytest.raises(ValueError, match="expected"):
        chain.terms(np.zeros((1, 6)), np.zeros((1, 6)))
    with pytest.raises(ValueError, match="inertial_parameters"):
        chain.with_inertial_parameters(np.zeros((5, 10)))
    with pytest.raises(ValueError, match="R_LE"):
        dataclasses.replace(chain, R_LE=np.zeros(3))


def test_no_samples_give_no_rows(sts: Robot) -> None:
    chain = sts.chain
    nothing = np.zeros((0, 6))
    assert chain.jacobian(nothing).shape == (0, 6, 6)
    assert chain.regressor(nothing, nothing, nothing).shape == (0, 6, 60)


def test_strided_and_integer_input(sts: Robot) -> None:
    chain = sts.chain
    table = np.random.default_rng(10).uniform(-1.0, 1.0, (20, 13))
    q, v = table[::2, 1:7], table[::2, 7:]
    strided, copied = chain.momentum_terms(q, v), chain.momentum_terms(q.copy(), v.copy())
    assert np.array_equal(strided, copied)
    assert np.array_equal(
        chain.jacobian([0, 1, 0, 1, 0, 1]), chain.jacobian(np.eye(2)[[0, 1] * 3, 1])
    )


def test_arrays_cannot_drift_from_the_table(sts: Robot) -> None:
    chain = sts.chain
    with pytest.raises(ValueError, match="read-only"):
        chain.inertial_parameters[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        chain.gravity = np.zeros(3)  # type: ignore[misc]


def test_terms_do_not_share_memory(sts: Robot) -> None:
    chain = sts.chain
    q = np.zeros(6)
    first = chain.terms(q, q)
    G = first.G.copy()
    q += 1.0
    chain.terms(q, q)
    assert np.array_equal(first.G, G)
    assert np.array_equal(first.q, np.zeros(6))
    again = copy.deepcopy(first)  # whose attributes have been asked for
    again.q[:] = 1.0
    chain.write_terms(again)
    assert np.array_equal(again.G, chain.gravity_torque(again.q))
    assert np.array_equal(first.G, G)


def test_survives_pickling(ur10e: Robot) -> None:
    chain = ur10e.chain
    again = pickle.loads(pickle.dumps(chain))
    q = np.full((100, 6), 0.4)
    assert np.array_equal(again.regressor(q, q, q), chain.regressor(q, q, q))


def test_motors_that_move_several_joints_carry_their_rotors_along(sts, coupled_wrist):
    """Kinetic energy of the rotors, 1/2 sum I (D v)^2, and its derivatives."""
    chain, plain = coupled_wrist.chain, sts.chain
    rng = np.random.default_rng(0)
    q, v, vdot = rng.normal(size=(3, 80, 6))  # enough for the kernels of many samples
    D = np.linalg.inv(coupled_wrist.coupling)
    rotors = D.T @ np.diag(sts.reflected_inertia) @ D
    added = rotors - np.diag(sts.reflected_inertia)
    assert np.abs(added).max() > 1e-2
    terms, before = chain.terms(q[0], v[0]), plain.terms(q[0], v[0])
    # 1e-9 of some 100 kg m^2 and N m: sums in another order.
    np.testing.assert_allclose(terms.M, before.M + added, atol=1e-9)
    np.testing.assert_allclose(terms.momentum, before.momentum + added @ v[0], atol=1e-9)
    np.testing.assert_allclose(terms.CTv, before.CTv, atol=1e-9)
    np.testing.assert_allclose(terms.Cv, before.Cv, atol=1e-9)
    np.testing.assert_allclose(
        chain.inverse_dynamics(q, v, vdot),
        plain.inverse_dynamics(q, v, vdot) + vdot @ added,
        atol=1e-9,
    )
    np.testing.assert_allclose(
        chain.momentum_terms(q, v)[0], plain.momentum_terms(q, v)[0] + v @ added, atol=1e-9
    )
    np.testing.assert_allclose(chain.rotor_matrix, rotors, atol=1e-12)
