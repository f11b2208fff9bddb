"""The experiment on the real passes: what was measured with plain tools before."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.experiments.air_pass.experiment import EXPERIMENT, LAWS, NONE, run
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FITTED,
    FOLDER,
    LOADED,
    VALIDATED,
)
from wrenchsight.analyses.output.outputs import plain_metrics
from wrenchsight.analyses.study.experiment import ExperimentContext, ExperimentResult

pytestmark = pytest.mark.slow  # three laws are fitted


@pytest.fixture(scope="module")
def result(
    data_holding: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> ExperimentResult:
    """The whole experiment."""
    data = data_holding(*(f"{FOLDER}/{name}" for name in (*FITTED, *VALIDATED.values(), LOADED)))
    return run(ExperimentContext(out=tmp_path_factory.mktemp("out"), data=data))


def test_a_plain_law_learns_much_a_rich_one_little(result: ExperimentResult) -> None:
    """As plain tools had it: joint 2's error 4.7 to 2.5 N m with Coulomb-viscous friction; with
    presliding the force gets worse in Y."""
    plain, rich = result.metrics["coulomb_viscous"], result.metrics["presliding"]
    assert plain["plain"]["torque_rmse_nm"][1] == pytest.approx(4.7, abs=0.2)
    assert plain["taught"]["torque_rmse_nm"][1] == pytest.approx(2.5, abs=0.2)
    assert np.all(plain["repeated_share"] > rich["repeated_share"])
    assert rich["taught"]["rmse_f_n"][1] > rich["plain"]["rmse_f_n"][1]


def test_eq_4_needs_no_friction_law(result: ExperimentResult) -> None:
    """Torque less torque leaves what the first pass leaves of the poorest law, to a few percent by
    which slip at other instants counts."""
    none, plain = result.metrics[NONE], result.metrics["coulomb_viscous"]
    assert none["plain"]["torque_rmse_nm"][1] > 2.0 * plain["plain"]["torque_rmse_nm"][1]
    assert np.allclose(
        none["taught"]["torque_rmse_nm"], plain["taught"]["torque_rmse_nm"], rtol=0.15
    )


def test_report(result: ExperimentResult) -> None:
    plain_metrics(result.metrics)  # can be written
    assert len(result.figures) == 2
    for law in LAWS:
        assert {"plain", "taught", "repeated_share"} <= result.metrics[law].keys()
    assert EXPERIMENT.readme[0] in [row.key for row in result.comparison]
    assert EXPERIMENT.needs == (FOLDER,)
