import numpy as np
import pytest

from wrenchsight.models.numerics.arrays import record
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.low_pass import LowPass, low_pass_update
from wrenchsight.models.signals.tool_wrench import (
    ToolMotion,
    ToolSensor,
    contact_wrench,
    measure_contact_wrench,
    tool_acceleration,
)


@pytest.mark.parametrize("name", ["sts_sre4_600", "ur10e"])
def test_acceleration_against_differences_of_the_velocity(name):
    chain = Robot.load(name).chain
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, v, vdot = rng.normal(size=(3, 6))
        out = np.empty(6)
        tool_acceleration(chain.jacobian(q), v, vdot, out)
        h = 1e-5
        after, before = (
            chain.jacobian(q + d * v + 0.5 * d * d * vdot) @ (v + d * vdot) for d in (h, -h)
        )
        # Central differences of a smooth motion with derivatives of order 10.
        np.testing.assert_allclose(out, (after - before) / (2 * h), atol=1e-7)


def test_acceleration_with_a_prismatic_joint():
    # Turn about z with angle a, slide along the turned x: E at r (cos a, sin a, 0).
    def J(a, r):
        c, s = np.cos(a), np.sin(a)
        return np.array([[0, 0], [0, 0], [1, 0], [-r * s, c], [r * c, s], [0, 0]], dtype=float)

    a, r, w, u = 0.7, 0.4, 1.5, -0.8
    out = np.empty(6)
    tool_acceleration(J(a, r), np.array([w, u]), np.array([0.3, 0.9]), out)
    radial, across = 0.9 - r * w**2, r * 0.3 + 2 * w * u
    c, s = np.cos(a), np.sin(a)
    expected = [0, 0, 0.3, radial * c - across * s, radial * s + across * c, 0]
    np.testing.assert_allclose(out, expected, atol=1e-14)


def tool_of(mass, p_EC, I_C, p_EJ):
    """Held at J, whose axes are E's, under the earth's gravity."""
    gravity = [0.0, 0.0, -9.81]
    return record(mass=mass, p_EC=p_EC, I_C=I_C, gravity=gravity, R_EJ=np.eye(3), p_EJ=p_EJ)


def test_a_tool_at_rest_weighs_what_the_mount_carries():
    tool = tool_of(2.0, [0.1, 0.0, 0.0], 0.01 * np.eye(3), p_EJ=np.zeros(3))
    # J is at E, with its axes: the mount pushes up with the weight, at a lever of -0.1 m.
    reaction = np.array([0, -0.1 * 2 * 9.81, 0, 0, 0, 2 * 9.81])
    out = np.empty(6)
    contact_wrench(tool, np.eye(3), np.zeros(3), np.zeros(6), reaction, out)
    np.testing.assert_allclose(out, 0, atol=1e-12)
    # Less from the mount: something else must push up.
    reaction[5] -= 5.0
    contact_wrench(tool, np.eye(3), np.zeros(3), np.zeros(6), reaction, out)
    assert out[5] == pytest.approx(5.0)


def test_a_measurement_is_the_wrench_with_noise_through_the_filter():
    rng, n = np.random.default_rng(7), 6
    tool = tool_of(1.3, rng.normal(size=3), np.eye(3), p_EJ=np.ones(3))
    J, (v, vdot, V_WE, reaction, sd, noise) = rng.normal(size=(6, n)), rng.normal(size=(6, n))
    R_WE = np.eye(3)[[1, 2, 0]]
    low_pass = LowPass.butterworth(50.0, 2, 1e-3)
    state, wrench = rng.normal(size=12), np.empty(6)
    expected_state = state.copy()
    A_WE, sample = np.empty(6), np.empty(6)
    tool_acceleration(J, v, vdot, A_WE)
    contact_wrench(tool, R_WE, V_WE[:3], A_WE, reaction, sample)
    sample += sd * noise
    A, B, C = low_pass.A, low_pass.B, low_pass.C
    low_pass_update(A, B, C, sample, expected_state)
    measure_contact_wrench(
        ToolSensor(tool, A, B, C, sd),
        ToolMotion(J, R_WE, V_WE, v, vdot),
        reaction,
        noise,
        wrench,
        state,
    )
    np.testing.assert_allclose(wrench, sample, atol=1e-13)
    np.testing.assert_allclose(state, expected_state, atol=1e-13)
