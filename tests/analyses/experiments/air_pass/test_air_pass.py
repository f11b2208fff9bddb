"""The experiment on the real passes: what was measured with plain tools before."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.air_pass.experiment import NONE
from wrenchsight.analyses.experiments.setups.ur10e_recordings import ur10e_logs

pytestmark = pytest.mark.slow  # three laws are fitted
FILES = ur10e_logs.FILES


def test_a_plain_law_learns_much_a_rich_one_little(metrics):
    """As plain tools had it: joint 2's error 4.7 to 2.5 N m with Coulomb-viscous friction; with
    presliding the force gets worse in Y."""
    plain, rich = metrics["coulomb_viscous"], metrics["presliding"]
    assert plain["plain"]["torque_rmse_nm"][1] == pytest.approx(4.7, abs=0.2)
    assert plain["taught"]["torque_rmse_nm"][1] == pytest.approx(2.5, abs=0.2)
    assert np.all(plain["repeated_share"] > rich["repeated_share"])
    assert rich["taught"]["rmse_f_n"][1] > rich["plain"]["rmse_f_n"][1]


def test_eq_4_needs_no_friction_law(metrics):
    """Torque less torque leaves what the first pass leaves of the poorest law, to a few percent by
    which slip at other instants counts."""
    none, plain = metrics[NONE], metrics["coulomb_viscous"]
    assert none["plain"]["torque_rmse_nm"][1] > 2.0 * plain["plain"]["torque_rmse_nm"][1]
    assert np.allclose(
        none["taught"]["torque_rmse_nm"], plain["taught"]["torque_rmse_nm"], rtol=0.15
    )
