"""Supports docs/machining.md, "the correction removes 10 to 45 % of a joint's torque error".

Experiment `air-pass`: how far the correction learnt on an air pass repeats, on a real arm.

A UR10e runs the same motion without a load and with one of 2.805 kg. The observer's output on the
first pass is the model's error, and the learnt correction. Subtracted on the second (eq. 4 on the
observer's output), it leaves what did not repeat. Both are read with models of several friction
laws, fitted on other runs, and with no friction at all, which is eq. 4 itself. The point where the
load acts is found once from the first ten seconds, with the richest law and without the correction.
The part after them is judged.
"""

from dataclasses import replace
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.data_sets.places import data_set_folder
from wrenchsight.analyses.experiments.air_pass.repeated_pass import (
    LoadedPass,
    Pass,
    loaded_pass,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import (
    PAYLOAD_MASS,
    force_of_load,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_figures import bar_rows
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FOLDER,
    LOADED_LOG,
    VALIDATION_LOGS,
    identify_ur10e,
)
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot

# Key of the metrics: law of `identify --friction`; `none` is made of the first.
LAWS: Final = {
    "coulomb_viscous": "coulomb-viscous",
    "load_dependent": "load-dependent",
    "presliding": "presliding",
}
_RICHEST: Final = "presliding"  # which finds the point where the load acts, for all laws
NONE: Final = "none"
_PLAIN_TOOLS = "plain tools"
_FITS_SHARE: Final = 0.8  # of the run's progress, in which the laws are fitted


def run(context: ExperimentContext) -> ExperimentResult:
    """Fits every law, reads both passes with it, and judges them against the payload.

    Models, passes and metrics are kept by the keys of LAWS, and NONE: the first law's inertias and
    covariance with no friction at all.
    """
    robot = Robot.load("ur10e")
    fitted: dict[str, IdentifiedModel] = {}
    share = _FITS_SHARE / len(LAWS)
    for k, (key, law) in enumerate(LAWS.items()):
        report = context.part(k * share, (k + 1) * share, f"{key}: ")
        config = IdentificationConfig(friction=law, cross_validate=False)
        fitted[key] = identify_ur10e(context.data, robot, config, report).model
    first_model = next(iter(fitted.values()))
    no_friction = SemiParametricFriction(CoulombViscous.zero(robot.num_joints))
    models = {NONE: replace(first_model, friction=no_friction), **fitted}
    context.progress(_FITS_SHARE, "both passes")
    folder = data_set_folder(FOLDER, context.data)
    empty_passes, loaded_passes = (
        {key: Pass.of(folder / log, robot, model) for key, model in models.items()}
        for log in (VALIDATION_LOGS["14harm50sec"], LOADED_LOG)
    )
    found_by = loaded_passes[_RICHEST]
    p_EP, _force = force_of_load(
        robot,
        found_by.recording,
        found_by.J,
        found_by.tau_ext,
        models[_RICHEST].residual_covariance,
        PAYLOAD_MASS,
    )
    passes = {
        key: loaded_pass(
            robot,
            model.residual_covariance,
            empty=empty_passes[key],
            loaded=loaded_passes[key],
            p_EP=p_EP,
            mass=PAYLOAD_MASS,
        )
        for key, model in models.items()
    }
    metrics: dict[str, Any] = {key: _metrics(entry) for key, entry in passes.items()}
    metrics["point_m"] = p_EP
    metrics["alignment_s"] = passes[_RICHEST].alignment  # of the positions: that of every law
    context.progress(0.95, "figures")
    torque_rmse = {
        f"{law}{words}": metrics[key][state]["torque_rmse_nm"]
        for key, law in LAWS.items()
        for state, words in (("plain", ""), ("taught", ", corrected"))
    }
    return ExperimentResult(
        metrics=metrics,
        figures=[
            (
                "errors",
                bar_rows(
                    {"RMSE of tau_ext [N m]": torque_rmse}, [f"joint {j + 1}" for j in range(6)]
                ),
                "Error of the joint torques, as read and less the correction learnt on the pass "
                "without load.",
            ),
        ],
        comparison=_comparison(),
        notes=NOTES,
    )


def _metrics(loaded_pass: LoadedPass) -> dict[str, Any]:
    plain, corrected = loaded_pass.plain.metrics(), loaded_pass.corrected.metrics()
    plain_rmse = float(np.linalg.norm(plain["rmse_f_n"]))  # N, over all axes
    corrected_rmse = float(np.linalg.norm(corrected["rmse_f_n"]))
    return {
        "plain": plain,
        "taught": corrected,
        "repeated_share": loaded_pass.repeated_share,
        "parts": loaded_pass.shares(),
        "correlation": loaded_pass.correlation,
        "taken_off": {
            "force_share": 1.0 - corrected_rmse / plain_rmse,
            "torque_share": 1.0 - corrected["torque_rmse_nm"] / plain["torque_rmse_nm"],
        },
    }


def _comparison() -> list[ComparisonRow]:
    """The rows of the report: RMSE of the force, and the share of the error that repeats.

    "plain" is the reading as it is, "taught" the one less the correction of the empty pass. Beside
    ours stands what plain tools read: least squares and the article's equations in numpy and
    scipy, on the same recordings. Their numbers stand here as they were measured; no code of this
    repository makes them.
    """
    rmse_of_plain_tools = {  # N, axes X Y Z
        "coulomb_viscous": {"plain": [2.2, 2.8, 4.3], "taught": [1.8, 1.8, 2.2]},
        "presliding": {"plain": [1.8, 3.9, 3.2], "taught": [1.7, 5.2, 1.9]},
    }
    rows = [
        ComparisonRow(
            f"Force at the load, {LAWS[law]}, {state}: RMSE X Y Z",
            f"{law}.{state}.rmse_f_n",
            article=values,
            source=_PLAIN_TOOLS,
        )
        for law, states in rmse_of_plain_tools.items()
        for state, values in states.items()
    ]
    rows += [
        ComparisonRow(
            f"Share of the torque error that did repeat, {LAWS[law]}, joints 1 to 6",
            f"{law}.repeated_share",
            remark="of its mean square",
        )
        for law in LAWS
    ]
    return rows


NOTES = (
    *(
        f"{law}: force at the load off by <{key}.plain.rmse_f_n:.1f> N as read, "
        f"<{key}.taught.rmse_f_n:.1f> N after the air pass; torque "
        f"<{key}.plain.torque_rmse_nm:.1f> and <{key}.taught.torque_rmse_nm:.1f> N m; share of "
        f"the mean square that repeats <{key}.repeated_share:.2f>, correlation "
        f"of the passes <{key}.correlation:.2f>."
        for key, law in LAWS.items()
    ),
    "Share of the error that the pass removes, torque by joint and force: "
    + "; ".join(
        f"<{key}.taken_off.torque_share:100 .0f> and <{key}.taken_off.force_share:100 .0f> % "
        f"({LAWS[key]})"
        for key in list(LAWS)[:: len(LAWS) - 1]
    )
    + ".",
    "Both passes are of one day and one motion in free space. A pass above a surface differs from "
    "the work in the contact besides.",
)


EXPERIMENT = Experiment(
    name="air-pass",
    title="Air pass on a real UR10e: the torque error that repeats",
    section="recordings of a UR10e",
    run=run,
    needs=("ur10e",),
    order=162,
    seconds=45.0,
)
