"""Summary of a log's wrenches, gathered chunk by chunk: metrics, warnings and a figure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.estimate.contact_episodes import stated_origin
from wrenchsight.analyses.output.figures import BAND_ALPHA, COLOUR, legend_below, new_figure, shade
from wrenchsight.analyses.output.stream_summary import Envelope, EvenSample
from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimatorConfig
from wrenchsight.models.estimation.invalid import UNCERTAIN_FORCE
from wrenchsight.models.estimation.invalid_shares import InvalidShares
from wrenchsight.models.estimation.wrench import WrenchEstimate
from wrenchsight.models.identification.identified_model import Validity
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.sample_check import FAULT_BEYOND, FAULT_DISAGREES, FAULT_FROZEN
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST, WRENCH_AXES
from wrenchsight.models.signals.bands import SIGMA_95

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_MEDIAN_SAMPLES = 1 << 17
_FIGURE_BINS = 2000  # about one a pixel
_MARGIN_SHARE = 0.05  # of a panel's range, above and below it
_DRAWN_PERCENTILES = (2, 98)  # of a log without a valid reading: its outliers are not drawn
_MAX_CONDITION_NUMBER = 1e12  # condition number: beyond, rounding alone decides its digits
_OUTSIDE_WARNING = 0.01  # share of samples outside the model's ranges
_FAULTS = {
    FAULT_BEYOND: "a position, speed, current or torque is beyond its joint's limits; check the "
    "log's units and the limits in robot.yaml",
    FAULT_DISAGREES: "position and velocity of a joint disagree; check its encoder",
    FAULT_FROZEN: "a joint moves while its current or torque stays the same to the last digit; "
    "check the connection to its drive",
}
_UNCERTAIN_WARNING = 0.5  # share of samples whose force is too uncertain


class _WrenchSums:
    """Sums over samples of a wrench and its standard deviation, force first."""

    def __init__(self) -> None:
        self.count = 0
        self._sum = np.zeros(6)
        self._squares = np.zeros(6)
        self._sd = np.zeros(6)
        self._largest = np.zeros(6)

    def add(self, wrench: Array, sd: Array) -> None:
        if not len(wrench):
            return
        self.count += len(wrench)
        self._sum += wrench.sum(axis=0)
        self._squares += (wrench**2).sum(axis=0)
        self._sd += sd.sum(axis=0)
        self._largest = np.maximum(self._largest, np.abs(wrench).max(axis=0))

    def metrics(self) -> dict[str, Any]:
        """Per axis; null where there is no sample."""
        result: dict[str, Any] = {}
        for k, axis in enumerate(WRENCH_AXES):
            unit = "n" if axis.startswith("f") else "nm"
            values = {
                "mean": self._sum[k] / self.count if self.count else None,
                "rms": np.sqrt(self._squares[k] / self.count) if self.count else None,
                "max_abs": self._largest[k] if self.count else None,
                "mean_sd": self._sd[k] / self.count if self.count else None,
            }
            result[axis] = {f"{name}_{unit}": value for name, value in values.items()}
        return result


class _ConditionNumbers:
    """Median and largest condition number of J, and the number of singular postures."""

    def __init__(self) -> None:
        self._sample = EvenSample(_MEDIAN_SAMPLES)
        self._largest = 0.0
        self._num_singular = 0

    def add(self, condition_number: Array) -> None:
        """Takes N samples; singular ones do not count in the largest."""
        self._sample.add(condition_number)
        regular = condition_number < _MAX_CONDITION_NUMBER
        self._num_singular += int((~regular).sum())
        largest = float(condition_number.max(initial=0.0, where=regular))
        self._largest = max(self._largest, largest)

    def metrics(self, percent: float) -> dict[str, float]:
        """As metrics.json has them; `percent` of all samples is one sample."""
        return {
            "median": float(np.median(self._sample.values())),
            "max": self._largest,  # where J is not singular
            "singular_pct": percent * self._num_singular,
        }


class _OutsideModel:
    """Samples outside the ranges in which a model holds; a range that it does not state has none.

    Args:
        num_joints: n.
        validity: the ranges.

    Attributes:
        num_extrapolated: samples in which a joint is faster or more loaded than in the model's
            logs. Friction is a law of speed and load; positions enter by exact kinematics.
    """

    def __init__(self, num_joints: int, validity: Validity) -> None:
        self._validity = validity
        # Samples outside, joint by joint, by signal; samples with a joint's q or v outside.
        self._num_outside = {key: np.zeros(num_joints) for key in ("q", "v", "tau")}
        self._num_outside_motion = 0
        self.num_extrapolated = 0

    def add(self, q: Array, v: Array, torque: Array) -> None:
        """Takes N samples.

        Args:
            q, v: (N, n) rad and rad/s, or (N, 0) of a log of torques without them, whose model
                states no range of them.
            torque: (N, n) N m.
        """
        ranges = self._validity
        outside: dict[str, Flags] = {key: np.zeros(torque.shape, bool) for key in self._num_outside}
        if ranges.q_min and ranges.q_max:
            outside["q"] = (q < np.array(ranges.q_min)) | (q > np.array(ranges.q_max))
        if ranges.v_max:
            outside["v"] = np.abs(v) > np.array(ranges.v_max)
        if ranges.tau_max:
            outside["tau"] = np.abs(torque) > np.array(ranges.tau_max)
        for key, samples in outside.items():
            self._num_outside[key] += samples.sum(axis=0)
        self._num_outside_motion += int((outside["q"] | outside["v"]).any(axis=1).sum())
        self.num_extrapolated += int((outside["v"] | outside["tau"]).any(axis=1).sum())

    def worst_joint(self, key: str) -> int | None:
        """The joint that is outside most often with its "v" or "tau"; None: none ever is."""
        counts = self._num_outside[key]
        return int(np.argmax(counts)) if counts.any() else None

    def metrics(self, percent: float) -> dict[str, Any]:
        """As metrics.json has them; `percent` of all samples is one sample."""
        return {
            # q or v of any joint; then q, v and tau joint by joint.
            "motion_pct": percent * self._num_outside_motion,
            **{f"{name}_pct": percent * count for name, count in self._num_outside.items()},
        }


class _Stretches(NamedTuple):
    """What the figure draws of each of B successive stretches of a log; force first.

    Attributes:
        t: (B,) s, middle.
        lowest, highest: (B, 6) N and N m, of the wrench.
        lower_band, upper_band: (B, 6) N and N m, ends of the band.
        is_invalid: (B,) whether most readings are not valid.
        has_contact: (B,) whether something touches the arm at any sample.
    """

    t: Array
    lowest: Array
    highest: Array
    lower_band: Array
    upper_band: Array
    is_invalid: Flags
    has_contact: Flags


class _DrawnBand:
    """Readings and their bands over time, in as many stretches as a figure can show.

    Attributes:
        origin: s, of the figure's time on the log's clock.
    """

    def __init__(self) -> None:
        self.origin: float | None = None
        # Minima of wrench and lower band, maxima of wrench and upper band, means of time, "not
        # valid" and "in contact".
        self._envelope = Envelope(_FIGURE_BINS)
        # Ends of the valid readings' bands, by axis.
        self._lowest_valid = np.full(6, np.inf)
        self._highest_valid = np.full(6, -np.inf)

    def add(self, t: Array, wrench: Array, sd: Array, valid: Flags, contact: Flags) -> None:
        """Takes N samples, one or more; wrench and sd are (N, 6), force first."""
        if self.origin is None:  # the clock of a log that counts from 1970 fits no axis
            self.origin = stated_origin(float(t[0]))
        lower, upper = wrench - SIGMA_95 * sd, wrench + SIGMA_95 * sd
        self._envelope.add(
            low=np.concatenate([wrench, lower], axis=1),
            high=np.concatenate([wrench, upper], axis=1),
            mean=np.stack([t - self.origin, ~valid, contact], axis=1),
        )
        lowest = lower[valid].min(axis=0, initial=np.inf)
        highest = upper[valid].max(axis=0, initial=-np.inf)
        self._lowest_valid = np.minimum(self._lowest_valid, lowest)
        self._highest_valid = np.maximum(self._highest_valid, highest)

    def stretches(self) -> _Stretches:
        """The stretches of all samples so far."""
        low, high, mean = self._envelope.values()
        t, invalid_share, contact_share = mean.T
        return _Stretches(
            t=t,
            lowest=low[:, :6],
            highest=high[:, :6],
            lower_band=low[:, 6:],
            upper_band=high[:, 6:],
            is_invalid=invalid_share > 0.5,
            has_contact=contact_share > 0.0,
        )

    def limits(self, k: int, stretches: _Stretches) -> tuple[float, float]:
        """Range of the axis k that shows the valid samples; others may read anything."""
        bottom, top = self._lowest_valid[k], self._highest_valid[k]
        if not np.isfinite(bottom):
            bottom = np.percentile(stretches.lowest[:, k], _DRAWN_PERCENTILES[0])
            top = np.percentile(stretches.highest[:, k], _DRAWN_PERCENTILES[1])
        margin = _MARGIN_SHARE * (top - bottom) or 1.0
        return float(bottom - margin), float(top + margin)


class EstimateSummary:
    """Gathers metrics and figure of a log's wrenches.

    Args:
        joint_names: n.
        validity: ranges in which the model holds; without them no sample leaves them.

    Attributes:
        invalid: shares of the samples that are not valid.
    """

    def __init__(self, joint_names: Sequence[str], validity: Validity) -> None:
        self._joint_names = joint_names
        self.invalid = InvalidShares()
        self._num_faults = dict.fromkeys(_FAULTS, 0)
        self._begin = 0.0  # s, on the log's clock, as the end
        self._end = 0.0
        self._condition_numbers = _ConditionNumbers()
        self._wrench_sums = _WrenchSums()
        self._valid_wrench_sums = _WrenchSums()
        self._outside_model = _OutsideModel(len(joint_names), validity)
        self._drawn_band = _DrawnBand()

    @property
    def count(self) -> int:
        """Of the samples."""
        return self.invalid.count

    @property
    def valid_share(self) -> float:
        """Of the samples, 0 to 1."""
        return self.invalid.num_valid / max(self.count, 1)

    def add(
        self,
        chunk: Recording,
        batch: EstimateBatch | WrenchEstimate,
        torque: Array,
        contact: Flags,
    ) -> None:
        """Takes the next chunk of N samples; `add_faults` takes their faults, if they are checked.

        Args:
            batch: their readings, with all reasons why one is not valid.
            torque: (N, n) N m, of the joints.
            contact: (N,) whether something touches the arm.
        """
        if not chunk.num_samples:
            return
        if not self.count:  # the first chunk
            self._begin = float(chunk.t[0])
        self._end = float(chunk.t[-1])
        self.invalid.add(batch.invalid)
        self._condition_numbers.add(batch.condition_number)
        wrench, sd = batch.wrench[:, FORCE_FIRST], batch.standard_deviation[:, FORCE_FIRST]
        valid = batch.valid
        self._wrench_sums.add(wrench, sd)
        self._valid_wrench_sums.add(wrench[valid], sd[valid])
        self._outside_model.add(chunk.q, chunk.v, torque)
        self._drawn_band.add(chunk.t, wrench, sd, valid, contact)

    def metrics(self, config: WrenchEstimatorConfig, rule: str) -> dict[str, Any]:
        """All figures of one sample or more, as written to metrics.json, percent of all samples.

        Args:
            config: as the log was read.
            rule: by which the prior was found.
        """
        percent = 100.0 / self.count  # of a sample
        return {
            "num_samples": self.count,
            "duration_s": self._end - self._begin,
            "time_step_s": config.observer.time_step,
            "valid_pct": 100.0 * self.valid_share,
            "invalid": self.invalid.metrics(),
            "faults": {
                "beyond_limits_pct": percent * self._num_faults[FAULT_BEYOND],
                "encoder_pct": percent * self._num_faults[FAULT_DISAGREES],
                "frozen_current_pct": percent * self._num_faults[FAULT_FROZEN],
            },
            "prior": {
                "force_sd_n": config.reconstruction.prior_force_sd,
                "moment_sd_nm": config.reconstruction.prior_moment_sd,
                "rule": rule,
            },
            "condition_number": self._condition_numbers.metrics(percent),
            "wrench": self._wrench_sums.metrics(),
            "valid": {"wrench": self._valid_wrench_sums.metrics()},
            "outside_model": self._outside_model.metrics(percent),
        }

    def add_faults(self, fault: NDArray[np.int64]) -> None:
        """Counts the samples (N,) with a fault, kind by kind."""
        for code in self._num_faults:
            self._num_faults[code] += int(((fault & code) != 0).sum())

    def warnings(self, judges_range: bool = True) -> list[str]:
        """Reasons to doubt the result, one sentence each.

        Args:
            judges_range: False of a log that the model was fitted on: it exceeds the range of its
                own low-passed signals by noise and edges alone.
        """
        warnings = []
        for code, fault in _FAULTS.items():
            if self._num_faults[code]:
                share = 100 * self._num_faults[code] / self.count
                warnings.append(f"{share:.3g} % of the samples are not used: {fault}")
        extrapolated = self._outside_model.num_extrapolated / self.count
        if judges_range and extrapolated > _OUTSIDE_WARNING:
            # At least one of them has such a joint: some sample is outside.
            worst_joints = [
                (quantity, self._outside_model.worst_joint(key))
                for key, quantity in (("v", "speed"), ("tau", "torque"))
            ]
            quantities = " and ".join(
                f"{quantity} of {self._joint_names[joint]}"
                for quantity, joint in worst_joints
                if joint is not None
            )
            warnings.append(
                f"{100 * extrapolated:.1f} % of the samples are faster or more loaded than the "
                f"model's logs (mostly {quantities}): friction is extrapolated there; identify the "
                "model from logs with such motion"
            )
        return warnings

    @property
    def mostly_uncertain(self) -> bool:
        """Whether the force of most samples is too uncertain."""
        return self.invalid.share(UNCERTAIN_FORCE) > _UNCERTAIN_WARNING

    def figure(self, reads_moments: bool = True, smoothed: bool = False) -> "Figure":
        """Reading and band over the log's own time, with the range of the valid samples.

        Args:
            reads_moments: whether the method reads moments; without, only forces are drawn.
            smoothed: whether each sample was read with those after it.
        """
        drawn = self._drawn_band.stretches()
        t, lowest, highest = drawn.t, drawn.lowest, drawn.highest
        figure, axes = new_figure(3, 2 if reads_moments else 1, share_x=True)
        origin = self._drawn_band.origin
        since = f" since {origin:.0f} s" if origin else ""
        for k, axis in enumerate(WRENCH_AXES if reads_moments else WRENCH_AXES[:3]):
            panel: Any = axes[k % 3, k // 3]
            unit = "N" if axis.startswith("f") else "N m"
            panel.fill_between(
                t,
                drawn.lower_band[:, k],
                drawn.upper_band[:, k],
                color=COLOUR["estimate"],
                alpha=BAND_ALPHA,
                lw=0,
                label="95 % band",
            )
            # The extremes of each stretch, in turn: one line that shows every peak of a long log.
            panel.plot(
                t.repeat(2),
                np.stack([lowest[:, k], highest[:, k]], axis=1).ravel(),
                color=COLOUR["estimate"],
                lw=0.9,
                label="estimate",
            )
            panel.set_ylabel(f"{axis[0]}$_{axis[1]}$ [{unit}]")
            bottom, top = self._drawn_band.limits(k, drawn)
            panel.set_ylim(bottom, top)
            shade(panel, t, drawn.is_invalid, "invalid", "not valid")
            for begin in shade(panel, t, drawn.has_contact, "contact", "contact"):
                panel.axvline(begin, color=COLOUR["onset"], lw=0.8, zorder=1)
            # The panel shows all valid samples (`limits`): what it hides is not valid.
            extremes = (lowest[:, k].min(), highest[:, k].max())
            hidden = [value for value in extremes if not bottom <= value <= top]
            if hidden:
                reach = " and ".join(f"{value:.3g}" for value in hidden)
                text = f"not valid, beyond the panel: to {reach} {unit}"
                panel.text(0.01, 0.97, text, transform=panel.transAxes, va="top", fontsize=7)
            if k % 3 == 2:
                panel.set_xlabel(f"time{since} [s]")
        legend_below(figure, axes[0, 0], ncols=4)
        title = "Wrench of the environment on the robot, at E in axes of W"
        figure.suptitle(title + (", smoothed" if smoothed else ""))
        return figure
