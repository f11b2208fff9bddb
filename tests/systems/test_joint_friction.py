import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, VectorLogSink

from wrenchsight.models.friction.true_friction import DryFriction
from wrenchsight.systems.joint_friction import HOLDING_DAMPING, JointFriction, add_holding_actuators

INERTIA = 0.8  # kg m^2 of the link about its joint
REFLECTED = 0.5  # kg m^2 of the rotor on the joint side


def law(n=1, **changes):
    values = {
        "stiction": 6.0,
        "coulomb": 4.0,
        "stribeck_velocity": 0.05,
        "viscous": 2.0,
        "load_dependence": 0.0,
        "ripple_amplitude": 0.0,
        "ripple_periods": 30.0,
    } | changes
    return DryFriction(**{key: np.full(n, value) for key, value in values.items()})


class Joint:
    """One inertia on one joint, driven by a constant torque."""

    def __init__(self, friction, tau_J, v_0=0.0):
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=1e-3,
                discrete_contact_approximation="lagged",
                use_sampled_output_ports=False,
            ),
            builder,
        )
        body = plant.AddRigidBody(
            "link", SpatialInertia(1.0, [0, 0, 0], UnitInertia(1, 1, INERTIA))
        )
        joint = plant.AddJoint(
            RevoluteJoint("joint", plant.world_frame(), body.body_frame(), [0, 0, 1])
        )
        motor = plant.AddJointActuator("motor", joint, 1000.0)
        motor.set_default_rotor_inertia(REFLECTED / 100**2)
        motor.set_default_gear_ratio(100.0)
        instance = body.model_instance()
        add_holding_actuators(plant, [joint], [motor], friction)
        plant.Finalize()
        block = builder.AddSystem(JointFriction(friction))
        source = builder.AddSystem(ConstantVectorSource([tau_J, 0.0]))
        rest = builder.AddSystem(ConstantVectorSource([0.0] * 4))
        load = builder.AddSystem(ConstantVectorSource([tau_J]))
        holding = _pick(builder, plant.get_net_actuation_output_port(instance), 1)
        builder.Connect(source.get_output_port(), plant.get_actuation_input_port(instance))
        builder.Connect(rest.get_output_port(), plant.get_desired_state_input_port(instance))
        builder.Connect(load.get_output_port(), block.GetInputPort("tau_J"))
        builder.Connect(plant.get_state_output_port(), block.GetInputPort("state"))
        builder.Connect(holding, block.GetInputPort("tau_holding"))
        builder.Connect(
            block.GetOutputPort("explicit_torque"),
            plant.get_applied_generalized_force_input_port(),
        )
        self._state_log = builder.AddSystem(VectorLogSink(2, 1e-3))
        self._friction_log = builder.AddSystem(VectorLogSink(1, 1e-3))
        builder.Connect(plant.get_state_output_port(), self._state_log.get_input_port())
        builder.Connect(block.GetOutputPort("tau_f_true"), self._friction_log.get_input_port())
        self.block, self.plant = block, plant
        self.simulator = Simulator(builder.Build())
        plant.SetVelocities(plant.GetMyMutableContextFromRoot(self.context), [v_0])

    @property
    def context(self):
        return self.simulator.get_mutable_context()

    def run(self, duration):
        self.simulator.AdvanceTo(duration)
        q, v = self._state_log.FindLog(self.context).data()
        return q, v, self._friction_log.FindLog(self.context).data()[0]


def _pick(builder, port, index):
    split = builder.AddSystem(Demultiplexer(port.size()))
    builder.Connect(port, split.get_input_port())
    return split.get_output_port(index)


def test_ports():
    block = JointFriction(law(3))
    assert [block.get_input_port(i).get_name() for i in range(block.num_input_ports())] == [
        "state",
        "tau_J",
        "tau_holding",
    ]
    assert block.GetInputPort("state").size() == 6
    assert block.GetOutputPort("explicit_torque").size() == 3
    assert block.GetOutputPort("tau_f_true").size() == 3
    # The plant's net actuation depends on the explicit torque: that must not close a loop.
    assert not block.HasDirectFeedthrough(
        block.GetInputPort("tau_holding").get_index(),
        block.GetOutputPort("explicit_torque").get_index(),
    )


def test_formula():
    friction = law(2, load_dependence=0.1, ripple_amplitude=0.3)
    block = JointFriction(friction)
    context = block.CreateDefaultContext()
    q, v = np.array([0.1, -0.4]), np.array([0.03, -0.2])
    tau_J, held = np.array([20.0, -30.0]), np.array([-6.0, 6.0])
    block.GetInputPort("state").FixValue(context, np.concatenate([q, v]))
    block.GetInputPort("tau_J").FixValue(context, tau_J)
    block.GetInputPort("tau_holding").FixValue(context, held)
    bump = np.exp(-((v / 0.05) ** 2))
    ripple = 0.3 * np.sin(30 * q)
    expected = np.sign(v) * (4 + 2 * bump + (1 - bump) * 0.1 * np.abs(tau_J)) + 2.0 * v + ripple
    total = block.GetOutputPort("tau_f_true").Eval(context)
    # A sliding brake is at its limit, -stiction sgn(v): the sum is the Stribeck law.
    np.testing.assert_allclose(total, expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(total - ripple, friction.sliding_torque(v, tau_J), atol=1e-13)
    explicit = block.GetOutputPort("explicit_torque").Eval(context)
    np.testing.assert_allclose(explicit, -(expected + held - 2.0 * v), atol=1e-13)


def test_holds_at_rest_inside_the_stiction_band():
    joint = Joint(law(), tau_J=5.9)
    q, _v, tau_f = joint.run(1.0)
    # The brake is a damper of 1e5 N m s/rad: 59 urad in a second.
    np.testing.assert_allclose(q[-1], 5.9 / HOLDING_DAMPING, rtol=0.01)
    np.testing.assert_allclose(tau_f[5:], 5.9, atol=1e-3)


def test_breaks_away_above_stiction_and_slides_at_coulomb_plus_viscous():
    joint = Joint(law(), tau_J=6.1)
    _q, v, tau_f = joint.run(8.0)
    # Terminal velocity where coulomb + viscous v = tau_J.
    assert v[-1] == pytest.approx((6.1 - 4.0) / 2.0, rel=1e-3)
    assert tau_f[-1] == pytest.approx(6.1, rel=1e-3)


def test_slides_down_as_the_closed_form_says_and_stops_for_good():
    # Stiction equal to Coulomb: (I + I_r) dv/dt = -coulomb - viscous v, whose solution is closed.
    friction = law(stiction=4.0)
    _q, v, tau_f = Joint(friction, tau_J=0.0, v_0=1.0).run(0.6)
    t = np.arange(v.size) * 1e-3
    expected = (1 + 2) * np.exp(-2.0 / (INERTIA + REFLECTED) * t) - 2
    stop = np.argmax(expected < 0)
    # Backward Euler on dv/dt of up to 5 rad/s^2 and a curvature of 7 rad/s^3 at 1 ms.
    np.testing.assert_allclose(v[:stop], expected[:stop], atol=2e-3)
    np.testing.assert_allclose(tau_f[1 : stop - 2], 4 + 2 * expected[1 : stop - 2], atol=0.02)
    assert np.all(np.abs(v[stop + 8 :]) < 1e-12)  # no chatter, no creep: nothing pulls


def test_friction_only_takes_energy():
    _q, v, _tau_f = Joint(law(load_dependence=0.1), tau_J=0.0, v_0=0.5).run(0.5)
    energy = 0.5 * (INERTIA + REFLECTED) * v**2
    assert np.all(np.diff(energy) <= 1e-12)


def test_load_adds_its_share():
    friction = law(load_dependence=0.1)
    _q, v, _tau_f = Joint(friction, tau_J=10.0).run(8.0)
    assert v[-1] == pytest.approx((10.0 - 4.0 - 0.1 * 10.0) / 2.0, rel=1e-3)


def test_parameter_through_the_context():
    block = JointFriction(law())
    context = block.CreateDefaultContext()
    block.GetInputPort("state").FixValue(context, [0.0, 1.0])
    block.GetInputPort("tau_J").FixValue(context, [10.0])
    before = block.GetOutputPort("explicit_torque").Eval(context)[0]
    context.get_mutable_numeric_parameter(0)[4] = 0.2  # load dependence
    after = block.GetOutputPort("explicit_torque").Eval(context)[0]
    assert after - before == pytest.approx(-2.0)


def test_positive_motion_gives_positive_friction():
    for sign in (1.0, -1.0):
        _, _, tau_f = Joint(law(), tau_J=sign * 20.0).run(0.05)
        assert np.all(sign * tau_f > 0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stiction": 3.0}, "stiction must not be below"),
        ({"stribeck_velocity": 0.0}, "stribeck_velocity must be positive"),
        ({"viscous": -1.0}, "viscous must not be negative"),
        ({"coulomb": float("nan")}, "coulomb"),
    ],
)
def test_bad_parameters(changes, words):
    with pytest.raises(ValueError, match=words):
        law(**changes)
