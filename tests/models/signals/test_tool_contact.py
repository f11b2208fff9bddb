import numpy as np

from wrenchsight.models.signals.tool_contact import (
    NORMAL,
    NORMAL_FORCE,
    WRENCH,
    add_contact,
    sum_with_contact,
)

RADIUS = 0.012


def test_contacts_sum_up_at_E(sts):
    robot, rng = sts, np.random.default_rng(1)
    terms = robot.chain.terms(robot.home, np.zeros(6))
    contact, expected, pushes = np.zeros(10), np.zeros(6), 0.0
    centre = terms.p_WE - RADIUS * terms.R_WE[:, 2]
    for _ in range(3):
        force, moment, offset = rng.normal(size=(3, 3))
        p_WC = centre + RADIUS * offset / np.linalg.norm(offset)
        add_contact(terms.p_WE, terms.R_WE, RADIUS, force, moment, p_WC, contact)
        expected[:3] += moment + np.cross(p_WC - terms.p_WE, force)
        expected[3:] += force
        n = (centre - p_WC) / RADIUS
        pushes += max(0.0, n @ force)
    np.testing.assert_allclose(contact[WRENCH], expected, atol=1e-14)
    np.testing.assert_allclose(contact[NORMAL], n, atol=1e-12)
    assert abs(contact[NORMAL_FORCE] - pushes) < 1e-12


def test_a_contact_in_the_balls_centre_has_no_direction_and_no_nan():
    contact = np.zeros(10)
    p = np.array([0.3, 0.0, 0.2])
    add_contact(p, np.eye(3), 0.0, np.ones(3), np.zeros(3), p, contact)
    np.testing.assert_array_equal(contact, [0, 0, 0, 1, 1, 1, 0, 0, 0, 0])


def test_applied_and_contact_forces_are_summed():
    rng = np.random.default_rng(2)
    applied, contact, J, tau = rng.normal(size=6), rng.normal(size=10), rng.normal(size=(6, 7)), 3.0
    out = np.empty(17)
    sum_with_contact(applied, contact, J, np.full(7, tau), out)
    np.testing.assert_allclose(out[:6], applied + contact[:6], atol=1e-14)
    np.testing.assert_array_equal(out[13:], contact[6:])
    np.testing.assert_allclose(out[6:13], J.T @ applied + tau, atol=1e-13)
