"""Supports docs/data.md, "The error of joint 3 over its sweep is then 2.396 N m".

Experiment `lara8-contact`: a NEURA LARA 8's load from motor torque, against its wrist sensor.

The torque is compared with J^T of the sensor's wrench, joint by joint and row by row. So is the
figure of the data's source: joint 3 over `joint3_sweep`, 6.483 N m by motor current and 2.671 N m
by a neural network trained on that robot. Nothing is trained here: `lara8_reading` states the
source of each number. The sensor's delay and zero are removed, both as the data set states them;
`source` repeats the comparison of the source, without.

"moving" is each joint over the rows in which it moves, "rest" over those in which it stands, from
the observer's settling on. For the wrench it is whether any joint moves.

Without the maker's description (DESCRIPTION) the controller's variant alone is read, with masses
that were fitted to that controller's torque.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.data_sets.places import data_set_folder, recording_file
from wrenchsight.analyses.experiments.setups.lara8_recordings.lara8_reading import (
    FOLDER,
    FORMAT,
    K_0,
    LOAD_SHARE,
    MIN_ROWS,
    NUM_JOINTS,
    REST_SPEED,
    VARIANTS,
    Lara8Log,
    Lara8Reading,
    by_joint,
    controller_friction,
    read_log,
    read_logs,
    settled_from,
)
from wrenchsight.analyses.methods.reference_sensor.comparison import SensorComparison
from wrenchsight.analyses.output.figures import (
    COLOUR,
    SERIES,
    Figure,
    fill_band,
    legend_on_top,
    new_figure,
)
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.estimation.invalid_shares import invalid_pct
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.signals.bands import SIGMA_95
from wrenchsight.models.signals.root_mean_square import rms

SWEEP: Final = "joint3_sweep"
_SWEPT_JOINT: Final = 2  # joint 3, counted from 0
_THESIS: Final = "thesis of the data's source"
_BY_URDF: Final = "summary.joint3_urdf_rmse_nm"
_LOADED_TORQUE = 20.0  # N m, from which a joint's friction shows its share of the load


def run(context: ExperimentContext) -> ExperimentResult:
    """Reads every recording by each variant, and judges them against the sensor.

    Metrics are by recording, state ("moving" or "rest") and variant; the figures of a joint count
    its own rows in that state (`_judged`). "target_less_motor" is the source's own method, and
    "invalid" holds the shares of readings that are not valid. "parts", "load_share" and "stiction"
    look into the errors of the variant "urdf", "source" repeats the source's figures of SWEEP, and
    "summary" has joint 3 of it; what needs an absent recording or description is left out.
    """
    context.progress(0.0, "reading the recordings")
    logs = read_logs(context.data)
    metrics: dict[str, Any] = {}
    readings: dict[tuple[str, str], Lara8Reading] = {}  # by recording and variant
    for k, log in enumerate(logs):
        context.progress(0.1 + 0.5 * k / len(logs), log.name)
        log_readings = {variant: read_log(log, variant) for variant in log.variants}
        readings |= {(log.name, variant): reading for variant, reading in log_readings.items()}
        compared = {variant: reading.against_sensor() for variant, reading in log_readings.items()}
        metrics[log.name] = {
            state: {
                variant: _judged(reading, compared[variant], state)
                for variant, reading in log_readings.items()
            }
            | {"target_less_motor": {"rmse_nm": _by_hand(log, state)}}
            for state in ("moving", "rest")
        }
        metrics[log.name]["invalid"] = {
            variant: _invalid(reading) for variant, reading in log_readings.items()
        }
    context.progress(0.6, "parts of the errors")
    variants = logs[0].variants  # the same of all logs
    if "urdf" in variants:
        metrics["parts"] = {log.name: _parts(log, readings[log.name, "urdf"]) for log in logs}
        metrics["load_share"] = {log.name: _load_share(log) for log in logs}
        metrics["stiction"] = {log.name: _stiction(readings[log.name, "urdf"]) for log in logs}
    sweep = next((log for log in logs if log.name == SWEEP), None)
    if sweep is not None:
        metrics["source"] = _source(context.data, readings)
        metrics["summary"] = {
            f"joint3_{variant}_rmse_nm": metrics[SWEEP]["moving"][variant]["rmse_nm"][_SWEPT_JOINT]
            for variant in variants
        }
    context.progress(0.9, "figures")
    return ExperimentResult(
        metrics=metrics,
        figures=[
            (
                "torque",
                _torque_figure(readings, [log.name for log in logs]),
                "Torque from outside, from motor torque alone, against J^T of the sensor's wrench "
                "(its delay taken off), of the most loaded joint of those that move.",
            )
        ],
        comparison=_comparison(metrics),
        notes=NOTES if "urdf" in variants else NOTES_WITHOUT_DESCRIPTION,
        configuration={"sensor": {log.name: log.config for log in logs}},
    )


def _rows(log: Lara8Log, state: str) -> Flags:
    """(N, n) rows of each joint in a state."""
    if state == "moving":
        return log.moving
    at_rest = ~log.moving
    at_rest[: settled_from(log.recording)] = False
    return at_rest


def _judged(reading: Lara8Reading, comparison: SensorComparison, state: str) -> dict[str, Any]:
    error, rows = reading.error, _rows(reading.log, state)
    phase = "moving" if state == "moving" else "rest"
    where = comparison.phases[f"free_{phase}"] | comparison.phases[f"contact_{phase}"]
    judged = [comparison.judged_over(axis, where) for axis in comparison.axes]
    figures = [{} if axis is None else axis.metrics() for axis in judged]  # forces, then moments
    return {
        "rmse_nm": by_joint(rms, rows, error),
        "bias_nm": by_joint(np.mean, rows, error),
        "torque_inside_95_pct": by_joint(
            lambda e, sd: 100.0 * np.mean(np.abs(e) <= SIGMA_95 * sd),
            rows,
            error,
            reading.batch.torque_sd,
        ),
        **{
            key: [axis.get(key) for axis in figures[:3]]
            for key in ("rmse_n", "bias_n", "stated_sd_n")
        },
        "moment_rmse_nm": [axis.get("rmse_n") for axis in figures[3:]],
        "inside_95_pct": [axis.get("inside_95_pct") for axis in figures],
        "averages": int(where.sum()),
    }


def _invalid(reading: Lara8Reading) -> dict[str, dict[str, float]]:
    """Percent of the readings that are not valid, by reason: while a joint moves, and at rest."""
    settled = np.arange(len(reading.log.moving)) >= settled_from(reading.log.recording)
    moving = reading.log.moving.any(axis=1)
    return {
        state: invalid_pct(reading.batch.invalid[rows])
        for state, rows in (("moving", moving & settled), ("rest", ~moving & settled))
    }


def _by_hand(log: Lara8Log, state: str) -> list[float | None]:
    """The source's current method: the controller's target torque less the motor's."""
    tau = log.recording.extra["tau_target"] - log.recording.current
    return by_joint(rms, _rows(log, state), tau - log.truth)


def _source(data: Path | None, readings: dict[tuple[str, str], Lara8Reading]) -> dict[str, Any]:
    """Joint 3 of the sweep as its source has it: every row, the sensor as it was recorded.

    Args:
        data: the folder of recordings that is given.
        readings: by recording and variant.

    Returns:
        RMSE by method, over all rows and over those in which the joint moves: "current" is the
        controller's target torque less the motor's, the others are our variants, interpolated at
        the source's rows.
    """
    raw = read_recording(recording_file(data_set_folder(FOLDER, data), SWEEP), FORMAT)
    log = readings[SWEEP, "controller_model"].log  # which is always read; the log is the same
    R_WE, _ = log.robot.chain.pose(raw.q)
    J = log.robot.chain.jacobian(raw.q)
    # The sensor's columns, taken as the source takes them: force first, in axes of E. J wants the
    # moment first, in axes of W.
    moment_and_force = raw.extra["sensor"].reshape(-1, 2, 3)[:, ::-1]
    wrench = np.einsum("kij,kpj->kpi", R_WE, moment_and_force).reshape(-1, 6)
    truth = np.einsum("ki,ki->k", J[:, :, _SWEPT_JOINT], wrench)
    moving = np.abs(raw.v[:, _SWEPT_JOINT]) > REST_SPEED

    def errors(tau: Array) -> dict[str, float]:
        error = tau - truth
        return {
            "all_rows_rmse_nm": float(np.sqrt(np.mean(error**2))),
            "moving_rmse_nm": float(np.sqrt(np.mean(error[moving] ** 2))),
        }

    # The controller's torque of the free motion, friction included, less the motor's: what the
    # environment adds. This log's currents are torques, N m.
    by_current = raw.extra["tau_target"] - raw.current
    result = {"current": errors(by_current[:, _SWEPT_JOINT])}
    for variant in log.variants:
        reading = readings[SWEEP, variant]
        tau = np.interp(raw.t, reading.log.recording.t, reading.batch.tau_ext[:, _SWEPT_JOINT])
        result[variant] = errors(tau)
    return result


def _parts(log: Lara8Log, reading: Lara8Reading) -> dict[str, list[float | None]]:
    """RMSE of the joints in motion, N m: with all that is used, and with one part left out.

    Args:
        reading: of the log by the variant "urdf", with all that is used.

    Returns:
        One number a joint; None: it hardly moves.
    """

    def moving_rmse(one_reading: Lara8Reading, truth: Array = log.truth) -> list[float | None]:
        return by_joint(rms, log.moving, one_reading.batch.tau_ext - truth)

    def with_friction(**change: Any) -> list[float | None]:
        """With one argument of `controller_friction` changed: its load's share, or its day."""
        return moving_rmse(read_log(log, "urdf", controller_friction(log.name, **change)))

    def rms_beside_any_law(error: Array, v: Array, load: Array) -> Any:
        """RMS of a joint's error less what an offset, dry, loaded and viscous friction fit.

        `by_joint` gives it the joint's rows in motion, (M,) each.
        """
        A = np.stack([np.ones_like(v), np.sign(v), np.sign(v) * load, v], axis=1)
        return rms(error - A @ np.linalg.lstsq(A, error, rcond=None)[0])

    zero_left = log.joint_torque(log.sensor_wrench(replace(log.mounting, tare=np.zeros(6))))
    return {
        "as_it_is": moving_rmse(reading),
        "controllers_rigid_body": moving_rmse(read_log(log, "controller_model")),
        "friction_without_load": with_friction(load_share=np.zeros(NUM_JOINTS)),
        "friction_of_another_day": with_friction(of_that_day=False),
        "rotors_left_out": moving_rmse(read_log(log, "urdf", without_rotors=True)),
        "delay_of_the_sensor_left": moving_rmse(
            reading, log.joint_torque(log.recording.extra["wrench"])
        ),
        "zero_of_the_sensor_left": moving_rmse(reading, zero_left),
        # The error that no friction law of speed, load and direction removes, though fitted here.
        "friction_fitted_to_this_sensor": by_joint(
            rms_beside_any_law,
            log.moving,
            reading.error,
            log.recording.v,
            np.abs(reading.transmitted),
        ),
    }


def _load_share(log: Lara8Log) -> list[float | None]:
    """N m of friction beyond the controller's law per N m of load, by joint, by sensor.

    Evidence for `LOAD_SHARE`, which is another arm's; not used.
    """
    law = controller_friction(log.name, load_share=np.zeros(NUM_JOINTS))
    reading = read_log(log, "urdf", law)
    rows = log.moving & (np.abs(reading.transmitted) > _LOADED_TORQUE)
    rows[: round(5.0 / K_0 / log.recording.time_step)] = False

    def share(error: Array, v: Array, load: Array) -> Any:
        pull = np.sign(v) * np.abs(load)
        # Too little friction taken off reads as a torque against the motion.
        return -np.sum(pull * error) / np.sum(pull**2)

    return by_joint(share, rows, reading.error, log.recording.v, reading.transmitted)


def _stiction(reading: Lara8Reading) -> dict[str, Any]:
    """Stiction of joints at rest: RMS of the reading less the sensor's, and their sliding level."""
    level = controller_friction(reading.log.name)
    slow = level.coulomb + level.stribeck + level.load * np.abs(reading.transmitted)
    rest_rmse = by_joint(rms, _rows(reading.log, "rest"), reading.error)
    return {"rest_rmse_nm": rest_rmse, "level_nm": slow.mean(axis=0)}


def _torque_figure(readings: dict[tuple[str, str], Lara8Reading], names: list[str]) -> Figure:
    figure, axes = new_figure(len(names), 1, height=2.0 * len(names) + 0.6)
    for panel, name in zip(axes[:, 0], names, strict=True):
        variants = [variant for variant in VARIANTS if (name, variant) in readings]
        ours = readings[name, variants[-1]]
        log = ours.log
        truth = log.truth
        moves = log.moving.sum(axis=0) >= MIN_ROWS
        j = int(np.argmax(np.where(moves, np.nanmean(np.abs(truth), axis=0), -1.0)))
        t, tau, sd = log.recording.t, ours.batch.tau_ext[:, j], ours.batch.torque_sd[:, j]
        by_current = (log.recording.extra["tau_target"] - log.recording.current)[:, j]
        panel.plot(t, by_current, color=COLOUR["article"], lw=0.5, label="target less motor torque")
        fill_band(panel, t, tau, SIGMA_95 * sd)
        label = f"ours, the {'URDF' if len(variants) > 1 else 'controller'}'s masses"
        panel.plot(t, tau, color=COLOUR["estimate"], lw=1.2, label=label)
        for variant in variants[:-1]:
            other = readings[name, variant].batch.tau_ext[:, j]
            panel.plot(t, other, color=SERIES[2], lw=0.9, label="ours, the controller's")
        panel.plot(t, truth[:, j], color=COLOUR["truth"], lw=1.0, label="sensor")
        panel.set_ylabel(f"joint {j + 1} [N m]")
        panel.set_title(name)
    axes[-1, 0].set_xlabel("time [s]")
    legend_on_top(figure, axes[0, 0], ncols=3)
    return figure


def _comparison(metrics: dict[str, Any]) -> list[ComparisonRow]:
    """The rows of the report: torque errors of the thesis in N m beside ours, with its data."""
    if "source" not in metrics:
        return []
    network = "a neural network trained on that robot"
    rows = [
        ComparisonRow(
            "Joint 3 over its sweep, by the controller's target torque less the motor's: RMSE",
            "source.current.all_rows_rmse_nm",
            article=6.483,
            remark="the source's own method, repeated here",
            source=_THESIS,
        ),
        ComparisonRow(
            "Joint 3 over its sweep, nothing trained, masses of the URDF: RMSE in motion",
            _BY_URDF,
            article=2.671,
            remark=f"{network} gave 2.671",
            source=_THESIS,
        ),
        ComparisonRow(
            "Joint 3 over its sweep, nothing trained, the controller's masses: RMSE in motion",
            "summary.joint3_controller_model_rmse_nm",
            article=2.671,
            remark=network,
            source=_THESIS,
        ),
    ]
    return [row for row in rows if row.key != _BY_URDF or "urdf" in metrics["source"]]


NOTES = (
    "Joint 3 over its sweep, in motion: <summary.joint3_urdf_rmse_nm:.2f> N m with the URDF's "
    "masses, <summary.joint3_controller_model_rmse_nm:.2f> N m with the controller's. As the "
    "source counts, all rows: <source.urdf.all_rows_rmse_nm:.2f> and "
    "<source.controller_model.all_rows_rmse_nm:.2f> N m; the source states 6.483 N m by current "
    "(here <source.current.all_rows_rmse_nm:.3f>) and 2.671 N m by a network.",
    "The same joint without friction's share of the load: "
    f"<parts.{SWEEP}.friction_without_load.{_SWEPT_JOINT}:.1f> N m; with friction fitted to this "
    "sensor "
    f"<parts.{SWEEP}.friction_fitted_to_this_sensor.{_SWEPT_JOINT}:.1f> N m.",
    f"Nothing was fitted on this arm. Friction's share of the load, {LOAD_SHARE[_SWEPT_JOINT]:g} "
    "N m per "
    "N m, and the observer's gain are a UR10e's; the rest is stated with the data.",
)

NOTES_WITHOUT_DESCRIPTION = (
    "Joint 3 over its sweep, in motion: <summary.joint3_controller_model_rmse_nm:.2f> N m with the "
    "controller's masses. As the source counts, all rows: "
    "<source.controller_model.all_rows_rmse_nm:.2f> N m; the source states 6.483 N m by current "
    "(here <source.current.all_rows_rmse_nm:.3f>) and 2.671 N m by a network.",
    "The maker's description of the arm is not here (`wrenchsight data fetch neura_lara8_urdf`): "
    "masses are fitted to the controller's rigid-body torque, the URDF's are not tried.",
    NOTES[-1],
)


EXPERIMENT = Experiment(
    name="lara8-contact",
    title="Load of a NEURA LARA 8 from its motor torque, against its wrist sensor",
    section="recordings of a NEURA LARA 8",
    run=run,
    needs=("neura_lara8",),
    uses=("neura_lara8_urdf",),
    order=170,
    seconds=4,
)
