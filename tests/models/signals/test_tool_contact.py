import numpy as np

from wrenchsight.models.signals.tool_contact import (
    add_contact,
    environment_torque,
    no_contact,
)

RADIUS = 0.012


def test_contacts_sum_up_at_E(sts):
    robot, rng = sts, np.random.default_rng(1)
    terms = robot.chain.terms(robot.home, np.zeros(6))
    contact, expected, pushes = no_contact(), np.zeros(6), 0.0
    centre = terms.p_WE - RADIUS * terms.R_WE[:, 2]
    for _ in range(3):
        force, moment, offset = rng.normal(size=(3, 3))
        p_WC = centre + RADIUS * offset / np.linalg.norm(offset)
        add_contact(terms.p_WE, terms.R_WE, RADIUS, force, moment, p_WC, contact)
        expected[:3] += moment + np.cross(p_WC - terms.p_WE, force)
        expected[3:] += force
        n = (centre - p_WC) / RADIUS
        pushes += max(0.0, n @ force)
    np.testing.assert_allclose(contact.wrench, expected, atol=1e-14)
    np.testing.assert_allclose(contact.pressed.normal, n, atol=1e-12)
    assert abs(contact.pressed.force[0] - pushes) < 1e-12


def test_a_contact_in_the_balls_centre_has_no_direction_and_no_nan():
    contact = no_contact()
    p = np.array([0.3, 0.0, 0.2])
    add_contact(p, np.eye(3), 0.0, np.ones(3), np.zeros(3), p, contact)
    np.testing.assert_array_equal(contact.wrench, [0, 0, 0, 1, 1, 1])
    assert not contact.pressed.force.any() and not contact.pressed.normal.any()


def test_the_torque_is_that_of_contact_and_of_all_else_through_the_jacobian():
    rng = np.random.default_rng(2)
    applied, J, tau = rng.normal(size=6), rng.normal(size=(6, 7)), 3.0
    tau_ext = np.empty(7)
    environment_torque(applied, J, np.full(7, tau), tau_ext)
    np.testing.assert_allclose(tau_ext, J.T @ applied + tau, atol=1e-13)
