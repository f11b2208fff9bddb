"""Experiment `lara8-contact`: a NEURA LARA 8's load from motor torque, against its wrist sensor.

Held against J^T of the sensor's wrench, joint by joint and row by row, like the figure of the
data's source: joint 3 over `joint3_sweep`, 6.483 N m by motor current and 2.671 N m by a neural
network trained on that robot. Nothing is trained here: `lara8_reading`
says where each number comes from. The sensor's own delay is taken off it, and its zero, both as the
data set states them; `source` repeats the source's way, without.

"moving" is each joint over the rows in which it moves, "rest" over those in which it stands, from
the observer's settling on; of the wrench, whether any joint moves.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np

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
    rmse_by_joint,
    settled_from,
)
from wrenchsight.analyses.methods.sensors.comparison import SensorComparison
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
from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.signals.bands import SIGMA_95

SWEEP: Final = "joint3_sweep"
_JOINT: Final = 2  # joint 3, counted from 0
_THESIS: Final = "thesis of the data's source"
_LOADED = 20.0  # N m, from which a joint's friction tells its share of the load


def run(context: ExperimentContext) -> ExperimentResult:
    """Reads every recording by both variants, and judges them against the sensor."""
    context.progress(0.0, "reading the recordings")
    logs = read_logs(context.data)
    metrics: dict[str, Any] = {}
    readings: dict[tuple[str, str], Lara8Reading] = {}
    comparisons: dict[tuple[str, str], SensorComparison] = {}
    for k, log in enumerate(logs):
        context.progress(0.1 + 0.5 * k / len(logs), log.name)
        for variant in VARIANTS:
            readings[log.name, variant] = reading = read_log(log, variant)
            comparisons[log.name, variant] = reading.against_sensor()
        metrics[log.name] = {
            state: {
                variant: _judged(readings[log.name, variant], comparisons[log.name, variant], state)
                for variant in VARIANTS
            }
            | {"target_less_motor": {"rmse_nm": _by_hand(log, state)}}
            for state in ("moving", "rest")
        }
    context.progress(0.6, "what the errors are made of")
    metrics["parts"] = {log.name: _parts(log, readings[log.name, "urdf"]) for log in logs}
    metrics["load_share"] = _load_shares(logs)
    metrics["stiction"] = {log.name: _stiction(readings[log.name, "urdf"]) for log in logs}
    sweep = next((log for log in logs if log.name == SWEEP), None)
    if sweep is not None:
        metrics["source"] = _source(context.data, readings)
        metrics["summary"] = {
            f"joint3_{variant}_rmse_nm": metrics[SWEEP]["moving"][variant]["rmse_nm"][_JOINT]
            for variant in VARIANTS
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
        notes=NOTES,
        configuration={"sensor": {log.name: log.config for log in logs}},
    )


def _rows(log: Lara8Log, state: str) -> Flags:
    """(N, n) rows of each joint in a state."""
    if state == "moving":
        return log.moving
    rest = ~log.moving
    rest[: settled_from(log.recording)] = False
    return rest


def _judged(reading: Lara8Reading, comparison: SensorComparison, state: str) -> dict[str, Any]:
    log = reading.log
    truth = log.joint_torque(log.sensor_wrench())
    error = reading.batch.tau_ext - truth
    rows, band = _rows(log, state), SIGMA_95 * reading.batch.torque_sd
    inside = [
        100.0 * float(np.mean(np.abs(error[entry, j]) <= band[entry, j]))
        if (entry := rows[:, j] & np.isfinite(error[:, j])).sum() >= MIN_ROWS
        else None
        for j in range(NUM_JOINTS)
    ]
    phase = "moving" if state == "moving" else "rest"
    where = comparison.phases[f"free_{phase}"] | comparison.phases[f"contact_{phase}"]
    judged = [comparison.judged_over(axis, where) for axis in comparison.axes]
    figures = [{} if one is None else one.metrics() for one in judged]  # forces, then moments
    return {
        "rmse_nm": reading.torque_rmse(truth, rows),
        "bias_nm": by_joint(np.mean, error, rows),
        "torque_inside_95_pct": inside,
        **{
            key: [one.get(key) for one in figures[:3]]
            for key in ("rmse_n", "bias_n", "stated_sd_n")
        },
        "moment_rmse_nm": [one.get("rmse_n") for one in figures[3:]],
        "inside_95_pct": [one.get("inside_95_pct") for one in figures],
        "averages": int(where.sum()),
    }


def _by_hand(log: Lara8Log, state: str) -> list[float | None]:
    """The source's current method: the controller's target torque less the motor's."""
    tau = log.recording.extra["tau_target"] - log.recording.current
    return rmse_by_joint(tau - log.joint_torque(log.sensor_wrench()), _rows(log, state))


def _source(data: Path, readings: dict[tuple[str, str], Lara8Reading]) -> dict[str, Any]:
    """Joint 3 of the sweep as its source has it: every row, the sensor as it was recorded."""
    raw = read_recording(data / FOLDER / f"{SWEEP}.csv", FORMAT)
    log = readings[SWEEP, "urdf"].log
    R_WE, _ = log.robot.chain.pose(raw.q)
    J = log.robot.chain.jacobian(raw.q)
    force, moment = (
        np.einsum("kij,kj->ki", R_WE, raw.extra["sensor"][:, part])
        for part in (slice(0, 3), slice(3, 6))
    )
    truth = np.einsum("ki,ki->k", J[:, :, _JOINT], np.concatenate([moment, force], axis=1))
    moving = np.abs(raw.v[:, _JOINT]) > REST_SPEED

    def errors(tau: Array) -> dict[str, float]:
        error = tau - truth
        return {
            "all_rows_rmse_nm": float(np.sqrt(np.mean(error**2))),
            "moving_rmse_nm": float(np.sqrt(np.mean(error[moving] ** 2))),
        }

    by_current = raw.extra["tau_target"] - raw.current
    result = {"current": errors(by_current[:, _JOINT])}
    for variant in VARIANTS:
        reading = readings[SWEEP, variant]
        tau = np.interp(raw.t, reading.log.recording.t, reading.batch.tau_ext[:, _JOINT])
        result[variant] = errors(tau)
    return result


# What the errors are made of ----------------------------------------------------------------------


def _parts(log: Lara8Log, reading: Lara8Reading) -> dict[str, list[float | None]]:
    """RMSE of the joints in motion, N m, as it is and with one piece of knowledge left out."""
    moving = log.moving
    truth = log.joint_torque(log.sensor_wrench())
    plain = log.joint_torque(log.recording.extra["wrench"])
    none = np.zeros(NUM_JOINTS)
    zero_left = log.joint_torque(log.sensor_wrench(log.mounting_without_tare))

    def with_friction(**change: Any) -> list[float | None]:
        law = controller_friction(log.name, **change)
        return read_log(log, "urdf", law).torque_rmse(truth, moving)

    no_rotor = read_log(log, "urdf", without_rotors=True).torque_rmse(truth, moving)
    return {
        "as_it_is": reading.torque_rmse(truth, moving),
        "controllers_rigid_body": read_log(log, "controller_model").torque_rmse(truth, moving),
        "friction_without_load": with_friction(load_share=none),
        "friction_of_another_day": with_friction(of_that_day=False),
        "rotors_left_out": no_rotor,
        "delay_of_the_sensor_left": reading.torque_rmse(plain, moving),
        "zero_of_the_sensor_left": reading.torque_rmse(zero_left, moving),
        "friction_fitted_to_this_sensor": _floor(reading, truth),
    }


def _floor(reading: Lara8Reading, truth: Array) -> list[float | None]:
    """What no friction law of speed, load and direction could take off; it is given the sensor."""
    log, result = reading.log, list[float | None]()
    error = reading.batch.tau_ext - truth
    load = np.abs(reading.transmitted)
    for j in range(NUM_JOINTS):
        rows = log.moving[:, j] & np.isfinite(error[:, j])
        if rows.sum() < MIN_ROWS:
            result.append(None)
            continue
        v, side = log.recording.v[rows, j], np.sign(log.recording.v[rows, j])
        A = np.stack([np.ones_like(v), side, side * load[rows, j], v], axis=1)
        left = error[rows, j] - A @ np.linalg.lstsq(A, error[rows, j], rcond=None)[0]
        result.append(float(np.sqrt(np.mean(left**2))))
    return result


def _load_shares(logs: list[Lara8Log]) -> dict[str, Any]:
    """N m of friction beyond the controller's law per N m of load, by file and joint, by sensor.

    Evidence for `LOAD_SHARE`, which is another arm's; not used.
    """
    result: dict[str, Any] = {}
    for log in logs:
        law = controller_friction(log.name, load_share=np.zeros(NUM_JOINTS))
        reading = read_log(log, "urdf", law)
        truth = log.joint_torque(log.sensor_wrench())
        error = reading.batch.tau_ext - truth
        load = reading.transmitted
        shares: list[float | None] = []
        for j in range(NUM_JOINTS):
            rows = log.moving[:, j] & (np.abs(load[:, j]) > _LOADED) & np.isfinite(error[:, j])
            rows[: round(5.0 / K_0 / log.recording.time_step)] = False
            if rows.sum() < MIN_ROWS:
                shares.append(None)
                continue
            pull = np.sign(log.recording.v[rows, j]) * np.abs(load[rows, j])
            # Too little friction taken off reads as a torque against the motion.
            shares.append(float(-np.sum(pull * error[rows, j]) / np.sum(pull**2)))
        result[log.name] = shares
    return result


def _stiction(reading: Lara8Reading) -> dict[str, Any]:
    """Stiction of joints at rest: RMS of the reading less the sensor's, and their sliding level."""
    log = reading.log
    rows = _rows(log, "rest")
    truth = log.joint_torque(log.sensor_wrench())
    level = controller_friction(log.name)
    loads = np.abs(reading.transmitted)
    slow = level.coulomb + level.stribeck + level.load * loads
    return {
        "rest_rmse_nm": reading.torque_rmse(truth, rows),
        "level_nm": slow.mean(axis=0),
    }


# Report -------------------------------------------------------------------------------------------


def _torque_figure(readings: dict[tuple[str, str], Lara8Reading], names: list[str]) -> Figure:
    figure, axes = new_figure(len(names), 1, height=2.0 * len(names) + 0.6)
    for panel, name in zip(axes[:, 0], names, strict=True):
        ours = readings[name, "urdf"]
        log = ours.log
        truth = log.joint_torque(log.sensor_wrench())
        moves = log.moving.sum(axis=0) >= MIN_ROWS
        j = int(np.argmax(np.where(moves, np.nanmean(np.abs(truth), axis=0), -1.0)))
        t, tau, sd = log.recording.t, ours.batch.tau_ext[:, j], ours.batch.torque_sd[:, j]
        by_current = (log.recording.extra["tau_target"] - log.recording.current)[:, j]
        panel.plot(t, by_current, color=COLOUR["article"], lw=0.5, label="target less motor torque")
        fill_band(panel, t, tau, SIGMA_95 * sd)
        panel.plot(t, tau, color=COLOUR["estimate"], lw=1.2, label="ours, the URDF's masses")
        other = readings[name, "controller_model"].batch.tau_ext[:, j]
        panel.plot(t, other, color=SERIES[2], lw=0.9, label="ours, the controller's")
        panel.plot(t, truth[:, j], color=COLOUR["truth"], lw=1.0, label="sensor")
        panel.set_ylabel(f"joint {j + 1} [N m]")
        panel.set_title(name)
    axes[-1, 0].set_xlabel("time [s]")
    legend_on_top(figure, axes[0, 0], ncols=3)
    return figure


def _comparison(metrics: dict[str, Any]) -> list[ComparisonRow]:
    if "source" not in metrics:
        return []
    network = "a neural network trained on that robot"
    return [
        ComparisonRow(
            "Joint 3 over its sweep, by the controller's target torque less the motor's: RMSE",
            "source.current.all_rows_rmse_nm",
            6.483,
            "its way, repeated",
            _THESIS,
        ),
        ComparisonRow(
            "Joint 3 over its sweep, nothing trained, masses of the URDF: RMSE in motion",
            "summary.joint3_urdf_rmse_nm",
            2.671,
            f"{network} gave 2.671",
            _THESIS,
        ),
        ComparisonRow(
            "Joint 3 over its sweep, nothing trained, the controller's masses: RMSE in motion",
            "summary.joint3_controller_model_rmse_nm",
            2.671,
            network,
            _THESIS,
        ),
    ]


NOTES = (
    "Joint 3 over its sweep, in motion: <summary.joint3_urdf_rmse_nm:.2f> N m with the URDF's "
    "masses, <summary.joint3_controller_model_rmse_nm:.2f> N m with the controller's. As the "
    "source counts, all rows: <source.urdf.all_rows_rmse_nm:.2f> and "
    "<source.controller_model.all_rows_rmse_nm:.2f> N m; the source states 6.483 N m by current "
    "(here <source.current.all_rows_rmse_nm:.3f>) and 2.671 N m by a network.",
    "The same joint without friction's share of the load: "
    f"<parts.{SWEEP}.friction_without_load.{_JOINT}:.1f> N m; with friction fitted to this sensor "
    f"<parts.{SWEEP}.friction_fitted_to_this_sensor.{_JOINT}:.1f> N m.",
    f"Nothing was fitted on this arm. Friction's share of the load, {LOAD_SHARE[_JOINT]:g} N m per "
    "N m, and the observer's gain are a UR10e's; the rest is stated with the data.",
)


EXPERIMENT = Experiment(
    name="lara8-contact",
    title="Load of a NEURA LARA 8 from its motor torque, against its wrist sensor",
    section="recordings of a NEURA LARA 8",
    run=run,
    needs=(FOLDER,),
    order=170,
    seconds=20.0,
    readme=("summary.joint3_urdf_rmse_nm",),
)
