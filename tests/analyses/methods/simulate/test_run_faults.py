"""Runs that are of no use, and the cause that is named."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.analyses.methods.simulate.run_faults import (
    divergence_remedy,
    require_controllable,
    require_following,
    saturation_notices,
)
from wrenchsight.analyses.methods.simulate.simulation import simulate
from wrenchsight.diagrams.scenario import JointSineMotion, Scenario
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.planning.motion.paths import JointTrajectory


def resting(robot):
    rows, zero = np.stack([robot.home, robot.home]), np.zeros((2, robot.num_joints))
    return JointTrajectory(np.array([0.0, 1.0]), rows, zero, zero)


@pytest.mark.parametrize("factor", [-1.0, 100.0])
def test_a_model_that_moves_no_arm_is_refused_with_what_cures_it(sts, factor):
    model = IdentifiedModel.nominal(sts)
    require_controllable(sts, model, resting(sts), "model.yaml")
    wrong = replace(
        model,
        inertial_parameters=factor * model.inertial_parameters,
        reflected_inertia=factor * model.reflected_inertia,
    )
    # Bodies of any mass are possible ones: to ask for possible ones cures that of others alone.
    cure = r"no body's: .*motion -.*--consistent" if factor < 0.0 else "logs of several motions"
    with pytest.raises(InputError, match=f"model.yaml: .*{cure}") as error:
        require_controllable(sts, wrong, resting(sts), "model.yaml")
    assert "\n" not in str(error.value)
    assert ("--consistent" in str(error.value)) == (factor < 0.0)
    scenario = Scenario(duration=0.2, motion=JointSineMotion())
    with pytest.raises(InputError, match="a controller that uses it diverges"):
        simulate(scenario, sts, wrong)


def test_the_joint_whose_inertia_the_logs_leave_open_is_named(sts):
    rotors = sts.reflected_inertia.copy()
    rotors[4] += 100.0
    wrong = replace(IdentifiedModel.nominal(sts), reflected_inertia=rotors)
    with pytest.raises(InputError, match=f"the inertia about {sts.joint_names[4]} open") as error:
        require_controllable(sts, wrong, resting(sts), "model.yaml")
    assert "--consistent" not in str(error.value)
    assert "rotor_inertia" not in str(error.value)  # it is stated
    drives = [replace(drive, rotor_inertia=0.0) for drive in sts.config.drives]
    with pytest.raises(InputError, match=f"state rotor_inertia of {sts.joint_names[4]} in"):
        require_controllable(sts.with_drives(drives), wrong, resting(sts), "model.yaml")


def test_a_joint_that_stiction_holds_is_named(sts):
    t = np.linspace(0.0, 5.0, 200)
    planned = sts.home + 0.05 * np.sin(t)[:, None] * np.ones(6)
    require_following(sts, planned, planned)
    q = planned.copy()
    q[:, 4] = q[0, 4] + 1e-5 * np.sin(t)
    with pytest.raises(InputError, match=f"{sts.joint_names[4]} stood still.*friction") as error:
        require_following(sts, planned, q)
    assert "rotor_inertia" not in str(error.value)  # it is stated
    drives = [replace(drive, rotor_inertia=0.0) for drive in sts.config.drives]
    with pytest.raises(InputError, match=f"rotor_inertia of {sts.joint_names[4]} "):
        require_following(sts.with_drives(drives), planned, q)
    planned[:, 4] = q[:, 4]  # a joint that is to stand still
    require_following(sts, planned, q)


def test_what_helps_against_a_divergence_depends_on_the_model(sts):
    model = IdentifiedModel.nominal(sts)
    assert "gains" in divergence_remedy(sts, model)
    inertial = model.inertial_parameters.copy()
    inertial[2, 0] = -1.0
    remedy = divergence_remedy(sts, replace(model, inertial_parameters=inertial))
    assert sts.joint_names[2] in remedy
    assert "--consistent" in remedy


def test_a_joint_at_its_limit_is_named_with_what_gravity_takes(sts):
    tau = np.zeros((1000, 6))
    tau[:50, 1] = -sts.effort_limit[1]
    signals = {"tau_command": tau, "q": np.tile(sts.home, (1000, 1))}
    (sentence,) = saturation_notices(sts, signals, refuses=True)
    assert f"{sts.joint_names[1]} is at its effort limit" in sentence
    assert "5 % of the samples" in sentence
    tau[:500, 1] = sts.effort_limit[1]
    assert len(saturation_notices(sts, signals, refuses=False)) == 1
    with pytest.raises(InputError, match="cannot follow the motion; state effort_limit"):
        saturation_notices(sts, signals, refuses=True)


def test_a_run_of_an_arm_too_weak_for_its_weight_ends_in_one_line(sts):
    weak = sts.with_drives([replace(drive, effort_limit=3.0) for drive in sts.config.drives])
    with pytest.raises(InputError, match=r"effort limit of 3 N m.*gravity alone takes") as error:
        simulate(Scenario(duration=0.5), weak)
    assert "\n" not in str(error.value)
