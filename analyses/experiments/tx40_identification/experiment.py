"""Experiment `tx40-identification`: a model of an arm whose wrist is coupled, at full speed.

A Staubli TX40 moves for nine seconds at up to its speed limits. Motor 6 turns with joints 5 and 6,
so that joint 5 moves against the friction of two motors: `coupling` of robot.yaml
(`wrenchsight.models.robot.coupling`) states it, and friction and rotors belong to the motors.

There is one recording. It is cut into stretches; each is predicted by a fit of the others, from
which EDGE seconds beside it are left out as well, so that the low-pass carries nothing over. All
figures are over the stretches together. `validation` is in fifths; thirds, which leave a fit less
to learn from, stand beside it.

From 7.5 s on the arm stands still, while joint 1's torque creeps from -2 to -0.2 N m and nothing
moves: at rest friction takes up anything within its stiction, and no law states how much. Predicted
from the first six seconds alone, joint 1's last three miss by 3 N m, and by 1 N m where it moves.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from wrenchsight.analyses.data_sets.places import data_set_folder
from wrenchsight.analyses.methods.identify.identification import identify
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.methods.identify.identification_figures import torque_figure
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

FOLDER = "staubli_tx40"
LOG = "excitation.csv"
FORMAT = "staubli-tx40"
GEARS = (32.0, 32.0, 45.0, -48.0, 45.0, 32.0)  # motor turns per turn of what it drives, with sign
WRIST = 5  # 0-based: joint 6 stands still in space where motor 6 does and joint 5 turns
CUTOFF = 10.0  # Hz; the motion is at full speed, twice as fast as what 5 Hz is meant for
EDGE = 0.25  # s: 2.5 periods of the cutoff
FIFTHS, THIRDS = 5, 3
LAW, PLAIN = "presliding", "coulomb-viscous-offset"


def tx40(data: Path | None, out: Path, coupled: bool = True) -> Robot:
    """The arm of the recordings, with its coupled wrist or without; writes its robot.yaml."""
    source = data_set_folder(FOLDER, data) / "robot.yaml"
    config = yaml.safe_load(source.read_text(encoding="utf-8"))
    config["urdf"] = str((source.parent / config["urdf"]).resolve())
    for drive, gear in zip(config["drives"], GEARS, strict=True):
        drive |= {"torque_per_ampere": abs(gear), "current_sign": int(np.sign(gear))}
    if coupled:
        coupling = np.eye(len(GEARS))
        coupling[WRIST, WRIST - 1] = -1.0
        config["coupling"] = coupling.tolist()
    path = out / ("robot.yaml" if coupled else "robot_uncoupled.yaml")
    path.write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
    return Robot.load(path)


def held_out(log: Recording, robot: Robot, law: str, stretches: int) -> TorqueFit:
    """Predicts each stretch of a recording by a fit of the others.

    Args:
        law: of friction.
        stretches: of equal length.
    """
    config = IdentificationConfig(cutoff=CUTOFF, friction=law, cross_validate=False)
    edges = np.linspace(log.t[0], log.t[-1], stretches + 1)
    parts = []
    for k in range(stretches):
        begin, end = edges[k], edges[k + 1]
        away = (log.t >= begin - EDGE) & (log.t <= end + EDGE)
        result = identify([replace(log, dropout=log.dropout | away)], robot, [log], config)
        whole = result.validation[0]
        inside = (whole.t >= begin) & ((whole.t < end) | (k == stretches - 1))
        parts.append([signal[inside] for signal in (whole.t, whole.measured, whole.predicted)])
    signals = map(np.concatenate, zip(*parts, strict=True))
    return TorqueFit("excitation", *signals)


def run(context: ExperimentContext) -> ExperimentResult:
    """Fits and predicts, with the coupling and without it."""
    robot = tx40(context.data, context.out)
    log = read_recording(data_set_folder(FOLDER, context.data) / LOG, FORMAT, robot)
    context.progress(0.1, "stretches held out, coupled wrist")
    fifths = held_out(log, robot, LAW, FIFTHS)
    context.progress(0.4, "longer stretches")
    thirds = held_out(log, robot, LAW, THIRDS)
    context.progress(0.6, "plain friction")
    plain = held_out(log, robot, PLAIN, FIFTHS)
    context.progress(0.75, "without the coupling")
    uncoupled_robot = tx40(context.data, context.out, coupled=False)
    # The torque on the joints is the same, whatever is taken for its motors.
    uncoupled_log = replace(
        log, current=uncoupled_robot.motor_current(robot.joint_torque(log.current))
    )
    uncoupled = held_out(uncoupled_log, uncoupled_robot, PLAIN, FIFTHS)
    context.progress(0.9, "the model of the whole log")
    config = IdentificationConfig(cutoff=CUTOFF, friction=LAW, cross_validate=False)
    fitted_on_all = identify([log], robot, config=config)
    fitted_on_all.model.save(context.out / "model.yaml")
    metrics: dict[str, Any] = {
        "validation": fifths.metrics() | {"stretches": FIFTHS},
        "validation_thirds": thirds.metrics() | {"stretches": THIRDS},
        "coupling": robot.coupling,
        "fit": {"rmse_nm": fitted_on_all.fit[0].rmse},
        "plain": {"validation": plain.metrics() | {"stretches": FIFTHS}},
        "uncoupled": {"plain": {"validation": uncoupled.metrics() | {"stretches": FIFTHS}}},
        "friction": fitted_on_all.metrics()["friction"],
        "base_parameters": fitted_on_all.metrics()["base_parameters"]["count"],
    }
    figure = torque_figure(fifths, robot.joint_names, "held out, TX40, presliding")
    caption = "Measured and predicted joint torque, each fifth by a fit of the others"
    return ExperimentResult(
        metrics=metrics,
        figures=[("torque", figure, caption)],
        comparison=_comparison(),
        notes=NOTES,
    )


def _comparison() -> list[ComparisonRow]:
    plain = "plain tools"
    return [
        ComparisonRow(
            "Torque RMSE over stretches held out, joints 1 to 6",
            "validation.rmse_nm",
            [1.83, 4.04, 1.08, 0.58, 1.00, 1.16],
            "plain tools: fitted on two thirds, judged on the last third, by least squares, 40 Hz",
            plain,
        ),
        ComparisonRow(
            "the same over thirds",
            "validation_thirds.rmse_nm",
            [1.83, 4.04, 1.08, 0.58, 1.00, 1.16],
            "plain tools: only the last third",
            plain,
        ),
        ComparisonRow(
            "the same with plain friction, every joint its own motor's, joint 5",
            "uncoupled.plain.validation.rmse_nm.4",
        ),
    ]


NOTES = (
    "Held-out RMSE, joints 1 to 6: <validation.rmse_nm:.2f> N m (fifths), "
    "<validation_thirds.rmse_nm:.2f> N m (thirds), of a torque of <validation.torque_rms_nm:.2f> "
    "N m RMS.",
    f"Joint {WRIST}: <validation.rmse_nm.{WRIST - 1}:.2f> N m with the coupling and `{LAW}`, "
    f"<plain.validation.rmse_nm.{WRIST - 1}:.2f> N m with plain friction, "
    f"<uncoupled.plain.validation.rmse_nm.{WRIST - 1}:.2f> N m without the coupling.",
    "One recording of nine seconds: what is held out is another stretch of the same motion.",
)


EXPERIMENT = Experiment(
    name="tx40-identification",
    title="Dynamic model of a real Staubli TX40, whose wrist is coupled",
    section="recordings of a Staubli TX40",
    run=run,
    needs=("staubli_tx40",),
    order=168,
    seconds=60,
)
