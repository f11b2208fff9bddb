"""An arm in other units is told by its size and its mass."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.rotational_inertia import (
    INERTIA_PLACES,
    BodyInertia,
    inertia_values,
    point_inertia,
)
from wrenchsight.models.robot.unit_doubts import reach_of, unit_doubts

Q = np.random.default_rng(1).uniform(-3.0, 3.0, (200, 6))


def scaled(robot, length=1.0, mass=1.0):
    """The robot with other numbers in its chain, as another unit in the file makes them."""
    chain = robot.chain
    parameters = chain.inertial_parameters * mass
    other = Robot(robot.config, robot.source, robot._urdf)
    other.__dict__["chain"] = replace(
        chain,
        p_PJ=length * chain.p_PJ,
        p_LE=length * chain.p_LE,
        inertial_parameters=parameters,
    )
    return other


@pytest.mark.parametrize("name", ["ur10e", "ur5e", "sts_sre4_600"])
def test_an_arm_in_its_own_units_is_not_doubted(name):
    assert unit_doubts(Robot.load(name), Q) == ()


@pytest.mark.parametrize(
    ("length", "mass", "words"),
    [
        (1000.0, 1.0, "in millimetres it would be 1.[0-9]+ m; multiply all lengths .* by 0.001"),
        (100.0, 1.0, "in centimetres it would be 1.[0-9]+ m"),
        (1.0, 1000.0, "in grams it would be [0-9]+ kg; multiply masses and inertias .* by 0.001"),
    ],
)
def test_the_unit_that_explains_an_impossible_number_is_said(ur10e, length, mass, words):
    with pytest.raises(InputError, match=words):
        unit_doubts(scaled(ur10e, length, mass), Q)


def test_what_is_only_unlikely_is_a_note(ur10e):
    (inches,) = unit_doubts(scaled(ur10e, 1.0 / 0.0254 / 2.0), Q)[:1]
    assert "in inches" in inches
    (tonnes,) = unit_doubts(scaled(ur10e, 1.0, 1e-3), Q)
    assert "in tonnes" in tonnes


def test_an_inertia_of_a_body_larger_than_the_arm_is_a_note(ur10e):
    """One link in kg cm^2; the others keep theirs."""
    other = scaled(ur10e)
    parameters = ur10e.chain.inertial_parameters.copy()
    parameters[5, 4:] = 1e4 * parameters[2, 4:] * parameters[5, 0] / parameters[2, 0]
    other.__dict__["chain"] = ur10e.chain.with_inertial_parameters(parameters)
    (doubt,) = unit_doubts(other, Q)
    assert f"what {ur10e.joint_names[5]} moves" in doubt
    assert "in kg cm^2 it would be 0." in doubt


def test_the_reach_is_that_of_the_stretched_arm(ur10e):
    # a2, a3 and d4 to d6 of the UR10e lie within its stated reach of 1.3 m and its wrist.
    q = np.vstack([Q, np.zeros(6)])
    assert 1.2 < reach_of(ur10e, q) < 1.5


def test_inertias_of_all_links_in_another_unit_are_refused(ur10e):
    """In the file they are those in kg m^2 times 1e6, and masses are in kg."""
    other = scaled(ur10e)
    parameters = ur10e.chain.inertial_parameters.copy()
    for link in parameters:
        body = BodyInertia.of(link)
        link[INERTIA_PLACES] = inertia_values(
            1e6 * body.inertia + point_inertia(body.mass, body.com)
        )
    other.__dict__["chain"] = ur10e.chain.with_inertial_parameters(parameters)
    with pytest.raises(InputError, match=r"in kg mm\^2 it would be 0.*inertias .* by 1e-06"):
        unit_doubts(other, Q)


@pytest.mark.parametrize("moment", [1.0, 0.01])
def test_the_same_inertia_of_all_links_is_a_placeholder(ur10e, moment):
    other = scaled(ur10e)
    parameters = ur10e.chain.inertial_parameters.copy()
    for link in parameters[:5]:  # the last one may carry parts that are fixed to it
        body = BodyInertia.of(link)
        inertia = moment * np.eye(3) + point_inertia(body.mass, body.com)
        link[INERTIA_PLACES] = inertia_values(inertia)
    other.__dict__["chain"] = ur10e.chain.with_inertial_parameters(parameters)
    (doubt,) = unit_doubts(other, Q)
    assert f"({moment:g} kg m^2), a placeholder" in doubt


def test_a_centre_of_mass_in_millimetres_is_refused(ur10e):
    other = scaled(ur10e)
    parameters = ur10e.chain.inertial_parameters.copy()
    parameters[1, 1:4] *= 1000.0
    other.__dict__["chain"] = ur10e.chain.with_inertial_parameters(parameters)
    name = ur10e.joint_names[1]
    with pytest.raises(
        InputError, match=f"what {name} moves is up to .* in millimetres .* by 0.001"
    ):
        unit_doubts(other, Q)
