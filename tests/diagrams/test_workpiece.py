import math

import numpy as np
import pytest

from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.diagrams.workpiece import pose_of_workpiece, process_contact, surface_of
from wrenchsight.models.planning.motion.surface_path import SurfacePath


@pytest.mark.parametrize(
    ("name", "stiffness", "exponent", "friction"),
    [("Polishing", 2e5, 1.0, 0.2), ("Grinding", math.pi * 1e7, 2.0, 0.25)],
)
def test_the_process_knows_how_a_workpiece_gives_way_and_where(name, stiffness, exponent, friction):
    scenario = load_scenario(name)
    machining, workpiece = scenario.machining, scenario.workpiece
    contact = process_contact(workpiece, (machining.start, machining.end))
    assert (contact.exponent, contact.friction) == (exponent, friction)
    assert contact.stiffness == pytest.approx(stiffness)
    X_WP = pose_of_workpiece(workpiece)
    path = SurfacePath.on_surface(
        surface_of(workpiece),
        tuple(machining.start),
        tuple(machining.end),
        5,
        X_WP.rotation().matrix(),
        X_WP.translation(),
        "test",
    )
    np.testing.assert_allclose(contact.ends, path.p_WS[[0, -1]], atol=1e-9)
    np.testing.assert_array_equal(contact.R_WP, X_WP.rotation().matrix())
    np.testing.assert_array_equal(contact.p_WP, X_WP.translation())
