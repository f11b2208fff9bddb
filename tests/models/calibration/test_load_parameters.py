"""A load's parameters against pinocchio, from frame to frame, and bodies that may exist."""

import numpy as np
import pinocchio as pin
import pytest

from wrenchsight.models.calibration.load_parameters import (
    body_parameters,
    flange_map,
    load_columns,
    moved_parameters,
    parameters_of,
    realisable_inertia,
)
from wrenchsight.models.identification.physical_consistency import pseudo_inertia
from wrenchsight.models.robot.rotational_inertia import inertia_about_origin

MASS, COM = 2.8, np.array([0.03, -0.12, 0.18])
INERTIA = np.array([[0.021, 0.002, -0.003], [0.002, 0.03, 0.001], [-0.003, 0.001, 0.018]])


def pin_inertia():
    return pin.Inertia(MASS, COM, INERTIA)


def test_ten_parameters_are_pinocchios():
    # Pinocchio's order: m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the frame's origin.
    np.testing.assert_allclose(
        body_parameters(MASS, COM, INERTIA), pin_inertia().toDynamicParameters(), rtol=1e-12
    )


def test_pseudo_inertia_is_inverted():
    parameters = np.arange(1.0, 11.0)
    np.testing.assert_allclose(parameters_of(pseudo_inertia(parameters)), parameters)


def test_a_change_of_frame_is_pinocchios():
    placement = pin.SE3.Random()
    moved = placement.act(pin_inertia()).toDynamicParameters()
    T = moved_parameters(placement.rotation, placement.translation)
    np.testing.assert_allclose(T @ body_parameters(MASS, COM, INERTIA), moved, atol=1e-12)


@pytest.mark.parametrize("name", ["ur10e", "sts", "tilted_arm", "panda"])
def test_a_loads_torque_is_what_pinocchio_adds(request, name):
    """Bodies welded to the flange of the same URDF: the difference of two inverse dynamics."""
    robot = request.getfixturevalue(name)
    model = pin.buildModelFromXML(robot.urdf_text)
    model.gravity.linear = np.array(robot.gravity)
    loaded = model.copy()
    frame = loaded.frames[loaded.getFrameId(robot.config.flange)]
    loaded.inertias[frame.parentJoint] += frame.placement.act(pin_inertia())
    rng = np.random.default_rng(0)
    n = robot.num_joints
    q, v, vdot = rng.uniform(-1.5, 1.5, (3, 20, n))
    expected = [
        pin.rnea(loaded, loaded.createData(), *row) - pin.rnea(model, model.createData(), *row)
        for row in zip(q, v, vdot, strict=True)
    ]
    torque = load_columns(robot, q, v, vdot) @ body_parameters(MASS, COM, INERTIA)
    # 1e-8 of some 40 N m: a joint axis in a URDF has about ten digits.
    np.testing.assert_allclose(torque, expected, atol=1e-7)


def test_flange_map_keeps_the_mass(ur10e):
    moved = flange_map(ur10e) @ body_parameters(MASS, COM, INERTIA)
    assert moved[0] == pytest.approx(MASS)
    principal = np.linalg.eigvalsh(inertia_about_origin(moved))
    assert (principal > np.linalg.eigvalsh(INERTIA)).all()  # farther from that origin


def test_realisable_inertia_leaves_bodies_alone_and_mends_others():
    np.testing.assert_allclose(realisable_inertia(INERTIA, MASS), INERTIA, atol=1e-12)
    odd = np.diag([-0.01, 0.05, 0.03])
    mended = realisable_inertia(odd, MASS)
    body = body_parameters(MASS, np.zeros(3), mended)
    assert np.linalg.eigvalsh(pseudo_inertia(body))[0] > 0.0
    x, y, z = np.diag(mended)
    assert x + y >= z
    assert x + z >= y
    assert y + z >= x
