"""Result of a simulated scenario: signals, errors of the estimate, figure and files."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchsight.analyses.methods.reference_sensor.force_errors import envelope
from wrenchsight.analyses.output.figures import (
    BAND_ALPHA,
    COLOUR,
    SERIES,
    legend_below,
    new_figure,
    shade,
)
from wrenchsight.diagrams.scenario import (
    Scenario,
)
from wrenchsight.models.estimation.invalid import InvalidCodes
from wrenchsight.models.estimation.invalid_shares import InvalidShares
from wrenchsight.models.machining.machining_phases import FAULT_SENTENCES, Fault, Phase
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST, WRENCH_AXES
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95
from wrenchsight.models.signals.root_mean_square import rms
from wrenchsight.systems.impedance_controller import ImpedanceConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TRUE_LINE: dict[str, Any] = {"color": COLOUR["truth"], "label": "true"}
# Dashed and on top: a good sensor lies on the truth.
_SENSOR_LINE: dict[str, Any] = {
    "color": SERIES[4],
    "lw": 0.9,
    "ls": (0, (3, 3)),
    "label": "sensor",
}


@dataclass(frozen=True, eq=False)
class SimulationResult:
    """The signals of a simulated scenario, with the errors of the estimate.

    Every 6-vector is F_E_W, environment on robot at E in axes of W, rotation first: N m, N. Row k
    of all signals belongs to time t[k]; a force there acts from t[k] to the next sample.

    Attributes:
        scenario: as it was run.
        robot: as it was run.
        t: (T,) s.
        q, v: (T, n) rad, rad/s, of the true robot.
        current: (T, n) A, as the drives report it.
        reference: (T, 3n) q_d, v_d, vdot_d.
        tau_command: (T, n) N m.
        tau_ext_true, tau_ext: (T, n) N m, true and estimated.
        wrench_true, wrench: (T, 6) true and estimated.
        covariance: (T, 6, 6) stated for `wrench`.
        condition_number: (T,) of J.
        invalid: (T,) why a reading is not valid, codes of `models.estimation.invalid`; 0: it is.
        ft_wrench: (T, 6) of the force/torque sensor, where there is one.
        pose_error: (T, 6) rad and m, under impedance control.
        phase: (T,) of models.machining.machining_phases, of a machining pass.
        fault: the cause of the tool's retreat.
        tool_vibration: (T,) m/s, estimated from the torques, of a pass after an air pass.
        force_setpoint: (T,) N, under force control.
        real_time_factor: simulated over elapsed time.
        notices: one sentence each.
        files: that were written.
    """

    scenario: Scenario
    robot: Robot
    t: Array
    q: Array
    v: Array
    current: Array
    reference: Array
    tau_command: Array
    tau_ext_true: Array
    tau_ext: Array
    wrench_true: Array
    wrench: Array
    covariance: Array
    condition_number: Array
    invalid: InvalidCodes
    ft_wrench: Array | None
    pose_error: Array | None
    force_setpoint: Array | None
    real_time_factor: float
    phase: Array | None = None
    fault: Fault = Fault.NONE
    tool_vibration: Array | None = None
    notices: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()

    @property
    def valid(self) -> Flags:
        """(T,) which readings may be used."""
        return np.asarray(self.invalid == 0)

    @property
    def invalid_shares(self) -> InvalidShares:
        """Shares of the readings that are not valid."""
        shares = InvalidShares()
        shares.add(self.invalid)
        return shares

    @property
    def standard_deviation(self) -> Array:
        """(T, 6) stated for `wrench`, N m and N, rotation first."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)))

    def metrics(self) -> dict[str, Any]:
        """Errors of estimate, sensor, motion and force, as written to metrics.json.

        `rmse_*`, `max_error_*` and `correlation_*` compare the estimate with the truth, axis by
        axis; the same below `sensor`. `coverage_share` is how often the true force lies in the
        stated 95 % band. Below `valid` the readings that are not valid are left out; it is there
        where some are valid and others not. Nothing in it depends on the machine's speed.

        `machining` is there of a machining pass, `force_control_*` under another force control; the
        normal force is judged while the tool works.
        """
        n = self.robot.num_joints
        metrics: dict[str, Any] = {
            "num_samples": len(self.t),
            "duration_s": float(self.t[-1]),
            "valid_share": float(self.valid.mean()),
            "invalid": self.invalid_shares.metrics(),
            **_errors(self.wrench, self.wrench_true),
        }
        if 0 < np.count_nonzero(self.valid) < len(self.valid):
            metrics["valid"] = _errors(self.wrench[self.valid], self.wrench_true[self.valid])
        inside = np.abs(self.wrench - self.wrench_true) <= SIGMA_95 * self.standard_deviation
        metrics["coverage_share"] = float(inside[:, 3:].mean())  # of the force's three axes
        metrics["tau_ext_rmse_nm"] = rms(self.tau_ext - self.tau_ext_true).tolist()
        metrics["tracking_rmse_rad"] = rms(self.q - self.reference[:, :n]).tolist()
        if self.ft_wrench is not None:
            metrics["sensor"] = _errors(self.ft_wrench, self.wrench_true)
        if self.pose_error is not None:
            # Of the length of the error: three times the mean square of a component.
            turn, offset = self.pose_error[:, :3], self.pose_error[:, 3:]  # rad, m
            metrics["pose_rmse_m"] = float(np.sqrt(np.mean(offset**2) * 3))
            metrics["pose_rmse_rad"] = float(np.sqrt(np.mean(turn**2) * 3))
        if self.force_setpoint is not None and self.phase is not None:
            works = self.phase == Phase.WORK
            error = (self.pressing_force() - self.force_setpoint)[works]
            metrics["machining"] = {
                "fault": "none" if self.fault == Fault.NONE else FAULT_SENTENCES[self.fault],
                "work_s": float(len(error) * self.scenario.time_step),
                "normal_force_rmse_n": float(np.sqrt(np.mean(error**2))) if len(error) else None,
                "max_normal_force_n": float(self.pressing_force().max()),
            }
            if self.tool_vibration is not None and works.any():
                vibration = np.median(self.tool_vibration[works])
                metrics["machining"]["tool_vibration_m_per_s"] = float(vibration)
        elif self.force_setpoint is not None:
            error = self.pressing_force() - self.force_setpoint
            metrics["force_control_rmse_n"] = rms(error).tolist()
            metrics["force_control_max_error_n"] = float(np.abs(error).max())
        return metrics

    def pressing_force(self) -> Array:
        """(T,) N: the true push of the environment along the controlled direction.

        Raises:
            ValueError: the scenario controls no force.
        """
        controller = self.scenario.controller
        if not isinstance(controller, ImpedanceConfig) or controller.force is None:
            raise ValueError("the scenario controls no force")
        direction = np.array(controller.force.direction, dtype=np.float64)
        direction /= np.linalg.norm(direction)
        force = self.wrench_true[:, 3:]
        if controller.force.axes == "E":
            R_WE, _ = self.robot.chain.pose(self.q)
            force = np.einsum("tki,tk->ti", R_WE, force)
        return np.asarray(force @ direction)

    def recording(self) -> Recording:
        """The log as a real arm's: t, q, v and current. Extra, force first: truth and sensor."""
        extra = {"wrench_true": self.wrench_true[:, FORCE_FIRST]}
        if self.ft_wrench is not None:
            extra["ft_wrench"] = self.ft_wrench[:, FORCE_FIRST]
        return Recording(
            t=self.t, q=self.q, v=self.v, current=self.current, source="simulation", extra=extra
        )

    def figure(self) -> "Figure":
        """True and estimated wrench with the stated 95 % band, where it is valid, and the sensor's.

        Every peak is drawn, however long the run. Moments are left out where the method reads none.
        """
        reads_moments = self.scenario.estimator.reconstruction.reads_moments
        shown = WRENCH_AXES if reads_moments else WRENCH_AXES[:3]
        figure, axes = new_figure(3, len(shown) // 3, share_x=True)
        # Of each stretch of a long run whether any of its readings is not valid.
        stretch_times, _, is_invalid = envelope(self.t, (~self.valid).astype(np.float64))
        for k, axis in enumerate(shown):
            panel: Any = axes[k % 3, k // 3]
            column = FORCE_FIRST[k]  # of the wrench, in which the moment is first
            estimate, band = self.wrench[:, column], SIGMA_95 * self.standard_deviation[:, column]
            # Of each stretch of a long run: its time, and the band's least and largest value.
            times, low, _ = envelope(self.t, estimate - band)  # time, least, largest
            _, _, high = envelope(self.t, estimate + band)
            colour = COLOUR["estimate"]
            panel.fill_between(
                times, low, high, color=colour, alpha=BAND_ALPHA, lw=0, label="95 % band"
            )
            panel.plot(*_peaks(self.t, self.wrench_true[:, column]), **_TRUE_LINE)
            panel.plot(*_peaks(self.t, estimate), color=colour, lw=1.0, label="estimated")
            if self.ft_wrench is not None:
                panel.plot(*_peaks(self.t, self.ft_wrench[:, column]), **_SENSOR_LINE)
            shade(panel, stretch_times, is_invalid > 0.0, "invalid", "not valid")
            panel.set_ylabel(f"{axis[0]}$_{axis[1]}$ [{'N' if k < 3 else 'N m'}]")
            if k % 3 == 2:
                panel.set_xlabel("time [s]")
        legend_below(figure, axes[0, 0])
        figure.suptitle("Wrench of the environment on the robot, at E in axes of W")
        return figure


def _errors(reading: Array, truth: Array) -> dict[str, float]:
    """RMSE, largest error and correlation per axis; the last is NaN where nothing varies."""
    metrics: dict[str, float] = {}
    for axis, column in zip(WRENCH_AXES, FORCE_FIRST, strict=True):
        unit = "n" if axis.startswith("f") else "nm"
        a, b = reading[:, column], truth[:, column]
        metrics[f"rmse_{axis}_{unit}"] = float(np.sqrt(np.mean((a - b) ** 2)))
        metrics[f"max_error_{axis}_{unit}"] = float(np.abs(a - b).max())
        varies = min(np.ptp(a), np.ptp(b)) > 1e-9
        metrics[f"correlation_{axis}"] = float(np.corrcoef(a, b)[0, 1]) if varies else float("nan")
    return metrics


def _peaks(t: Array, x: Array) -> tuple[Array, Array]:
    """A line through the extremes of each stretch of a long signal: no peak is lost."""
    at, low, high = envelope(t, x)
    if low is high:
        return at, x
    return at.repeat(2), np.stack([low, high], axis=1).ravel()
