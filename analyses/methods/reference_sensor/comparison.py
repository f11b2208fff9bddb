"""Comparison of a reading with a force sensor, by phase: at rest or in motion, contact or free.

The sensor's force and the joints' speed separate the phases. Figures are over averages of 0.1 s
(`sensor_log.WINDOW_BLOCKS` blocks). The sd of an average is the mean of its parts' sds, since their
errors last longer. A band holds where the average's error is within 1.96 sds.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from wrenchsight.analyses.methods.reference_sensor.judged_force import ForceJudgement, ForceReading
from wrenchsight.analyses.methods.reference_sensor.mounting import Mounting, find_mounting
from wrenchsight.analyses.methods.reference_sensor.reference_config import ReferenceConfig
from wrenchsight.analyses.methods.reference_sensor.sensor_log import WINDOW_BLOCKS, SensorLog
from wrenchsight.analyses.output.figures import COLOUR, fill_band, legend_on_top, new_figure
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.rigid_body.spatial_vectors import WRENCH_AXES
from wrenchsight.models.signals.bands import SIGMA_95

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PHASES: Final = ("all", "free_rest", "free_moving", "contact_rest", "contact_moving")
ALONG: Final = "along"  # the name of a single force
_FIGURE_POINTS = 2000  # of a figure


@dataclass(frozen=True, eq=False)
class SensorComparison:
    """A reading and the sensor's wrench on the robot, M averages.

    Attributes:
        t: (M,) s.
        axes: names of the k quantities: fx, fy, ... in axes of W, or `along` the sensor's axis.
        reading, sd: (M, k) N, N m.
        valid: (M,).
        sensor: (M, k); NaN where the sensor's delay leads out of the log.
        phases: (M,) flags by name.
        mounting: mounting of the sensor.
        notices: what the log leaves open, one sentence each.
    """

    t: Array
    axes: tuple[str, ...]
    reading: Array
    sd: Array
    valid: Flags
    sensor: Array
    phases: dict[str, Flags]
    mounting: Mounting
    notices: tuple[str, ...]

    def judged(self, axis: str, phase: str) -> ForceJudgement | None:
        """One quantity in one phase; None where no average of it has a reading."""
        return self.judged_over(axis, self.phases[phase])

    def judged_over(self, axis: str, rows: Flags) -> ForceJudgement | None:
        """One quantity over some of the averages (M,); None where none has a reading."""
        k = self.axes.index(axis)
        reading = ForceReading(self.reading[rows, k], self.sd[rows, k], self.valid[rows])
        return ForceJudgement.of(reading, self.sensor[rows, k])

    def metrics(self) -> dict[str, Any]:
        """The mounting, and by phase the errors of each quantity; null where nothing was judged."""
        mounting = self.mounting
        metrics: dict[str, Any] = {
            "mounting": {
                "frame": mounting.frame,
                "axes": mounting.R,
                "sign": mounting.sign,
                "tare": mounting.tare,
                "delay_s": mounting.delay,
            }
        }
        for phase, rows in self.phases.items():
            metrics[phase] = {"share_pct": 100.0 * float(rows.mean())}
            for axis in self.axes:
                judgement = self.judged(axis, phase)
                unit = "nm" if axis.startswith("m") else "n"
                metrics[phase][axis] = None if judgement is None else judgement.metrics(unit)
        return metrics

    def figure(self, reading: str = "from motor currents") -> "Figure":
        """Sensor and reading with its band over time, a panel for each quantity.

        Of a wrench, forces are in the left column and moments in the right one.

        Args:
            reading: label of the reading.
        """
        columns = 2 if len(self.axes) == len(WRENCH_AXES) else 1
        figure, panels = new_figure(len(self.axes) // columns, columns, share_x=True)
        drawn = slice(None, None, max(1, len(self.t) // _FIGURE_POINTS))
        t = self.t[drawn]
        for k, axis in enumerate(self.axes):
            panel: Any = panels[k % len(panels), k // len(panels)]
            mean, half_width = self.reading[drawn, k], SIGMA_95 * self.sd[drawn, k]
            fill_band(panel, t, mean, half_width)
            panel.plot(t, self.sensor[drawn, k], color=COLOUR["truth"], lw=1.0, label="sensor")
            panel.plot(t, mean, color=COLOUR["estimate"], lw=1.0, label=reading)
            panel.set_ylabel(f"{axis} [{'N m' if axis.startswith('m') else 'N'}]")
            _show_lines(panel, np.concatenate([mean, self.sensor[drawn, k]]))
        for column in range(columns):
            panels[-1, column].set_xlabel("time [s]")
        legend_on_top(figure, panels[0, 0], ncols=3)
        return figure


def compare_with_sensor(
    log: SensorLog, config: ReferenceConfig, mounted: Mounting | None = None
) -> SensorComparison:
    """Compares a reading with the sensor, mounted as stated or as found from the log.

    All signals are averaged over successive stretches (`_averages`), M of them. An average is valid
    where all its samples are; it is judged where the sensor's force is known, in phases: with or
    without contact by the sensor, at rest or moving.

    Args:
        log: N samples of the reading and of the sensor's k columns: 1 (a force along an axis), 3
            (a force) or 6 (a wrench, force first).
        config: configuration of the sensor.
        mounted: its mounting, where another log has given it; None: it is found.

    Raises:
        InputError: as `find_mounting`.
    """
    k = log.sensor.shape[1]
    mounting, notices = find_mounting(log, config) if mounted is None else (mounted, ())
    sensor = mounting.on_robot(log.t, log.sensor, log.R_WE)
    reading = mounting.compared(log.reading, log.R_WE, k)  # (N, k): what the sensor measures of it
    sd: Array = log.sd[:, :k]
    axes: tuple[str, ...] = WRENCH_AXES[:k]
    if k == 1:
        # The largest sd along an axis: the components' errors may not be independent.
        sd = np.sum(np.abs(mounting.direction(log.R_WE)) * log.sd[:, :3], axis=1)[:, None]
        axes = (ALONG,)
    force = _averages(sensor[:, : min(k, 3)])  # (M, 1) or (M, 3): of a wrench the first three
    valid = _averages(log.valid.astype(float)) == 1.0
    contact = np.linalg.norm(force, axis=1) > config.contact_force
    moving = _averages(log.speed) > config.rest_speed
    is_sensed = np.isfinite(force).all(axis=1)
    phases = {
        "all": is_sensed,
        "free_rest": is_sensed & ~contact & ~moving,
        "free_moving": is_sensed & ~contact & moving,
        "contact_rest": is_sensed & contact & ~moving,
        "contact_moving": is_sensed & contact & moving,
    }
    return SensorComparison(
        t=_averages(log.t),
        axes=axes,
        reading=_averages(reading),
        sd=_averages(sd),
        valid=valid,
        sensor=_averages(sensor),
        phases=phases,
        mounting=mounting,
        notices=notices,
    )


def _averages(signal: Array) -> Array:
    """Means over successive windows, without an incomplete last one unless it is the only one."""
    window = min(WINDOW_BLOCKS, len(signal))
    count = len(signal) // window
    return np.asarray(
        signal[: count * window].reshape(count, window, *signal.shape[1:]).mean(axis=1)
    )


def _show_lines(panel: Any, values: Array) -> None:
    """Limits of the panel that show the lines; the band may leave it."""
    values = values[np.isfinite(values)]
    low, high = float(values.min()), float(values.max())
    margin = 0.25 * (high - low) + 1.0
    panel.set_ylim(low - margin, high + margin)
