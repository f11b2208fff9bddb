"""What force acts at the tool? A log and a model in, the wrench with its uncertainty out.

The log is streamed: its memory does not grow with its length. Without a given prior there are two
passes. The first runs the observer over the whole log and keeps some thousand samples, evenly
spread, of external torque and Jacobian; the prior is what explains those best
(`models.estimation.wrench.evidence_prior`). The second one writes the wrenches.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from analyses.output.outputs import OutputFolder
from analyses.output.result_folder import result_folder
from analyses.output.stream_summary import Envelope, EvenSample
from models.estimation.estimator import EstimateBatch, WrenchEstimator, WrenchEstimatorConfig
from models.estimation.momentum_observer import MomentumObserverConfig
from models.estimation.wrench import (
    FORCE_SD_RANGE,
    METHODS,
    WrenchReconstructionConfig,
    evidence_prior,
)
from models.estimation.wrench_table import WrenchTableWriter
from models.files.input_error import InputError
from models.identification.identified_model import IdentifiedModel
from models.recordings.recording import Recording
from models.recordings.recording_reader import RecordingReader
from models.recordings.resampling import plausible_step, resample_chunks
from models.robot.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
ProgressCallback = Callable[[float, str], None]

ENGINES = ("batch", "diagram")
AXES = ("fx", "fy", "fz", "mx", "my", "mz")  # as people read them
_FORCE_FIRST = [3, 4, 5, 0, 1, 2]
_CHUNK = 1 << 16  # samples that are worked on at a time
_PRIOR_SAMPLES = 1 << 12
_MEDIAN_SAMPLES = 1 << 17
_FIGURE_BINS = 2000  # about one a pixel
_BAND = 1.96  # standard deviations: 95 %
_SINGULAR = 1e12  # condition number: beyond, rounding alone decides its digits
_SETTLING = 3.0  # time constants of the observer, which starts at zero: 5 % are missing then
_OUTSIDE_WARNING = 0.01  # share of samples outside the model's ranges
_UNSURE_WARNING = 0.5  # share of invalid samples


@dataclass
class EstimateConfig:
    """How a log becomes wrenches."""

    engine: str = "batch"  # "batch": the kernels; "diagram": the same chain as a Drake diagram
    method: str = "bayesian"  # one of models.estimation.wrench.METHODS
    K_0: list[float] = field(default_factory=lambda: [20.0])  # 1/s; one for all joints, or each
    prior_force_sd: float | None = None  # N; None: the log's evidence
    prior_moment_sd: float | None = None  # N m about E; None: the log's evidence
    max_force_sd: float | None = None  # N, of a valid reading; None: see models.estimation.wrench
    damping: float = 0.2  # of the method "damped"
    truncation: float = 0.05  # of the method "truncated"
    time_step: float = 0.0  # s, of the grid that the log is resampled on; 0: its median step
    max_gap: float = 0.0  # s, longest gap that is bridged; 0: 0.1 s or three steps
    check: bool = True  # hold the log against the robot's limits and gravity


@dataclass(frozen=True, eq=False)
class EstimateResult:
    """What an estimate found, and where it wrote it.

    Attributes:
        num_samples: on the uniform grid.
        valid_share: of the samples that may be trusted.
        notices: what reading the log involved, one sentence each.
        warnings: what makes the result doubtful, one sentence each.
        config: as used, with the time step and the prior filled in.
        table: wrench.csv.
    """

    num_samples: int
    valid_share: float
    notices: tuple[str, ...]
    warnings: tuple[str, ...]
    config: EstimateConfig
    table: Path
    _metrics: dict[str, Any]

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json."""
        return self._metrics


class _Engine(Protocol):
    """Runs successive chunks of a log through the estimator's chain."""

    def run(self, q: Array, v: Array, current: Array) -> EstimateBatch: ...


def estimate_log(
    log: Path,
    robot_name: str | Path,
    model_path: Path | None,
    out: Path,
    log_format: str | Path | None = None,
    config: EstimateConfig | None = None,
    progress: ProgressCallback = lambda fraction, what: None,
) -> EstimateResult:
    """The command `estimate`: streams a log and writes what acted at the tool into `out`.

    Writes wrench.csv (see `models.estimation.wrench_table`), metrics.json, config.yaml and
    figures/wrench.png.

    Args:
        log: as `Recording.read`.
        robot_name: a bundled robot or a robot.yaml.
        model_path: a model.yaml; None: what the robot's own files state, without friction.
        log_format: description of the log's columns.

    Raises:
        InputError: as `Robot.load`, `IdentifiedModel.load`, `RecordingReader` and `result_folder`;
            a setting that makes no sense.
    """
    with result_folder(out, "estimate") as folder:
        robot = Robot.load(robot_name)
        config = _checked(config or EstimateConfig(), robot)
        if model_path is None:
            model = IdentifiedModel.nominal(robot)
        else:
            model = IdentifiedModel.load(Path(model_path), robot)

        def read() -> RecordingReader:
            reader = RecordingReader(log, log_format, robot, config.check)
            reader.require_joint_signals()
            return reader

        command = {
            "command": "estimate",
            "log": str(log),
            "robot": str(robot_name),
            "model": None if model_path is None else str(model_path),
            "log_format": None if log_format is None else str(log_format),
        }
        result = estimate(read, robot, model, folder, config, command, progress)
    return replace(result, table=out / result.table.name)


def estimate(
    read: Callable[[], RecordingReader],
    robot: Robot,
    model: IdentifiedModel,
    out: OutputFolder,
    config: EstimateConfig,
    command: dict[str, Any],
    progress: ProgressCallback = lambda fraction, what: None,
) -> EstimateResult:
    """As `estimate_log`, of what is loaded.

    Args:
        read: opens the log for one pass.
        command: what config.yaml holds besides the settings.

    Raises:
        InputError: something is wrong in the log.
    """
    warnings: list[str] = []
    if not model.provenance.logs:
        warnings.append(
            "the model is not identified from logs: its friction and its noise are assumed"
        )
    num_passes = 1 if _has_prior(config) else 2
    rule = "given"
    if num_passes == 2:
        part = _Part(progress, 0.0, 0.4, "finding the prior")
        config, rule = _with_evidence(read(), robot, model, config, part, warnings)
    reader = read()
    part = _Part(progress, 0.4 * (num_passes - 1), 1.0, "estimating")
    summary = _Summary(model)
    engine: _Engine | None = None
    with WrenchTableWriter(out / "wrench.csv") as table:
        for chunk in _uniform(reader, config, part):
            if engine is None:
                config = replace(config, time_step=config.time_step or plausible_step(chunk))
                engine = _engine(robot, model, config)
            batch = engine.run(chunk.q, chunk.v, chunk.current)
            sd, valid = batch.standard_deviation, summary.judge(chunk, batch, config)
            table.write(chunk.t, batch.wrench, sd, batch.condition_number, valid)
            summary.add(chunk, batch, sd, valid, _torque(chunk, robot))
    metrics = summary.metrics(config, rule)
    warnings += summary.warnings()
    out.write_figure("wrench", summary.figure())
    out.write_yaml("config.yaml", command | {"estimate": config})
    out.write_json("metrics.json", metrics)
    progress(1.0, "done")
    return EstimateResult(
        num_samples=summary.count,
        valid_share=summary.num_valid / summary.count,
        notices=reader.notices,
        warnings=tuple(warnings),
        config=config,
        table=out / "wrench.csv",
        _metrics=metrics,
    )


def _checked(config: EstimateConfig, robot: Robot) -> EstimateConfig:
    def refuse(option: str, problem: str, remedy: str) -> InputError:
        return InputError("estimate", option, problem, remedy)

    if config.engine not in ENGINES:
        raise refuse("engine", f'unknown engine "{config.engine}"', f"give {' or '.join(ENGINES)}")
    methods = METHODS if isinstance(METHODS, tuple) else get_args(METHODS)
    if config.method not in methods:
        raise refuse("method", f'unknown method "{config.method}"', f"give {', '.join(methods)}")
    if len(config.K_0) not in (1, robot.num_joints):
        raise refuse(
            "K_0", f"has {len(config.K_0)} values", f"give one, or one a joint ({robot.num_joints})"
        )
    if not all(np.isfinite(K_0) and K_0 > 0 for K_0 in config.K_0):
        raise refuse("K_0", "is not positive", "give the observer's gain in 1/s, such as 20")
    for name in ("prior_force_sd", "prior_moment_sd", "max_force_sd"):
        value = getattr(config, name)
        if value is not None and not (np.isfinite(value) and value > 0):
            raise refuse(name, f"is {value}, expected a positive number", "give N or N m")
    for name in ("damping", "truncation", "time_step", "max_gap"):
        value = getattr(config, name)
        if not (np.isfinite(value) and value >= 0):
            raise refuse(name, f"is {value}, expected zero or more", "leave it out for the default")
    return config


def _has_prior(config: EstimateConfig) -> bool:
    return config.prior_force_sd is not None and config.prior_moment_sd is not None


def _estimator_config(config: EstimateConfig) -> WrenchEstimatorConfig:
    return WrenchEstimatorConfig(
        observer=MomentumObserverConfig(K_0=list(config.K_0), time_step=config.time_step),
        reconstruction=WrenchReconstructionConfig(
            method=config.method,
            prior_force_sd=config.prior_force_sd,
            prior_moment_sd=config.prior_moment_sd,
            max_force_sd=config.max_force_sd,
            damping=config.damping,
            truncation=config.truncation,
        ),
    )


class _BatchEngine:
    """The kernels, chunk after chunk."""

    def __init__(self, robot: Robot, model: IdentifiedModel, config: EstimateConfig) -> None:
        self._estimator = WrenchEstimator(robot, model, _estimator_config(config))
        self._state = self._estimator.initial_state()

    def run(self, q: Array, v: Array, current: Array) -> EstimateBatch:
        return self._estimator.run(self._state, q, v, current)


class _DiagramEngine:
    """The same chain as a Drake diagram that replays the log, stretch after stretch."""

    def __init__(self, robot: Robot, model: IdentifiedModel, config: EstimateConfig) -> None:
        from pydrake.systems.analysis import Simulator

        from diagrams.replay import make_replay

        self._replay = make_replay(robot, model, _estimator_config(config))
        self._simulator = Simulator(self._replay.diagram)

    def run(self, q: Array, v: Array, current: Array) -> EstimateBatch:
        context = self._simulator.get_mutable_context()
        self._replay.load(context, q, v, current)
        self._simulator.AdvanceTo(self._replay.stop_time(context))
        return self._replay.take(context)


def _engine(robot: Robot, model: IdentifiedModel, config: EstimateConfig) -> _Engine:
    kinds: dict[str, type[_BatchEngine | _DiagramEngine]] = {
        "batch": _BatchEngine,
        "diagram": _DiagramEngine,
    }
    return kinds[config.engine](robot, model, config)


def _torque(chunk: Recording, robot: Robot) -> Array:
    """(N, n) motor torque on the joint side, N m."""
    return np.asarray(chunk.current * (robot.current_sign * robot.torque_per_ampere))


def _uniform(reader: RecordingReader, config: EstimateConfig, part: "_Part") -> Iterator[Recording]:
    """The log on its uniform grid, some ten thousand samples at a time."""
    for chunk in resample_chunks(reader.chunks(), config.time_step or None, config.max_gap or None):
        for begin in range(0, chunk.num_samples, _CHUNK):
            yield chunk[begin : begin + _CHUNK]
        part(reader.progress)


def _with_evidence(
    reader: RecordingReader,
    robot: Robot,
    model: IdentifiedModel,
    config: EstimateConfig,
    part: "_Part",
    warnings: list[str],
) -> tuple[EstimateConfig, str]:
    """The settings with the prior that explains the log best, and the rule's name."""
    J, tau_ext = EvenSample(_PRIOR_SAMPLES), EvenSample(_PRIOR_SAMPLES)
    engine: _BatchEngine | None = None
    for chunk in _uniform(reader, config, part):
        if engine is None:
            timed = replace(config, time_step=config.time_step or plausible_step(chunk))
            engine = _BatchEngine(robot, model, timed)
        batch = engine.run(chunk.q, chunk.v, chunk.current)
        measured = ~chunk.dropout
        J.add(batch.J[measured])
        tau_ext.add(batch.tau_ext[measured])
    force_sd, moment_sd = evidence_prior(J.values(), tau_ext.values(), model.residual_covariance)
    if force_sd < 1.01 * FORCE_SD_RANGE[0] and config.prior_force_sd is None:
        warnings.append(
            "the log shows no force beyond the model's error: the readings are close to zero"
        )
    given = [
        name
        for name, value in (("force", config.prior_force_sd), ("moment", config.prior_moment_sd))
        if value is not None
    ]
    rule = "evidence of the log" + (f", {given[0]} given" if given else "")
    return replace(
        config,
        prior_force_sd=config.prior_force_sd or force_sd,
        prior_moment_sd=config.prior_moment_sd or moment_sd,
    ), rule


class _Part:
    """Progress of one pass within the whole."""

    def __init__(self, report: ProgressCallback, begin: float, end: float, what: str) -> None:
        self._report, self._begin, self._end, self._what = report, begin, end, what

    def __call__(self, fraction: float) -> None:
        self._report(self._begin + fraction * (self._end - self._begin), self._what)


class _Moments:
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
        for k, axis in enumerate(AXES):
            unit = "n" if axis.startswith("f") else "nm"
            values = {
                "mean": self._sum[k] / self.count if self.count else None,
                "rms": np.sqrt(self._squares[k] / self.count) if self.count else None,
                "max_abs": self._largest[k] if self.count else None,
                "mean_sd": self._sd[k] / self.count if self.count else None,
            }
            result[axis] = {f"{name}_{unit}": value for name, value in values.items()}
        return result


class _Summary:
    """What metrics and figure need, gathered chunk by chunk."""

    def __init__(self, model: IdentifiedModel) -> None:
        self._model = model
        self.count = 0
        self.num_valid = 0
        self._num_invalid = {"settling": 0, "dropout": 0, "unsure": 0}
        self._first = 0.0
        self._last = 0.0
        self._num_singular = 0
        self._largest_condition = 0.0
        self._condition = EvenSample(_MEDIAN_SAMPLES)
        self._all = _Moments()
        self._of_valid = _Moments()
        n = len(model.joint_names)
        self._outside = {"q": np.zeros(n), "v": np.zeros(n), "tau": np.zeros(n)}
        self._outside_motion = 0
        self._envelope = Envelope(_FIGURE_BINS)
        self._valid_range = np.stack([np.full(6, np.inf), np.full(6, -np.inf)])

    def judge(self, chunk: Recording, batch: EstimateBatch, config: EstimateConfig) -> Flags:
        """(N,) which samples of the next chunk may be trusted; counts why others may not."""
        index = self.count + np.arange(chunk.num_samples)
        settling = index * config.time_step < _SETTLING / min(config.K_0)  # flagged by the observer
        dropout = chunk.dropout & ~settling
        unsure = ~batch.valid & ~dropout & ~settling
        for name, reason in (("settling", settling), ("dropout", dropout), ("unsure", unsure)):
            self._num_invalid[name] += int(reason.sum())
        return np.asarray(batch.valid & ~chunk.dropout)

    def add(
        self, chunk: Recording, batch: EstimateBatch, sd: Array, valid: Flags, torque: Array
    ) -> None:
        if not chunk.num_samples:
            return
        if not self.count:
            self._first = float(chunk.t[0])
        self._last = float(chunk.t[-1])
        self.count += chunk.num_samples
        self.num_valid += int(valid.sum())
        condition = batch.condition_number
        self._condition.add(condition)
        regular = condition < _SINGULAR
        self._num_singular += int((~regular).sum())
        largest = float(condition.max(initial=0.0, where=regular))
        self._largest_condition = max(self._largest_condition, largest)
        wrench, sd = batch.wrench[:, _FORCE_FIRST], sd[:, _FORCE_FIRST]
        self._all.add(wrench, sd)
        self._of_valid.add(wrench[valid], sd[valid])
        self._add_outside(chunk, torque)
        lower, upper = wrench - _BAND * sd, wrench + _BAND * sd
        self._envelope.add(
            np.concatenate([wrench, lower], axis=1),
            np.concatenate([wrench, upper], axis=1),
            np.stack([chunk.t - self._first, ~valid], axis=1),
        )
        if valid.any():
            self._valid_range[0] = np.minimum(self._valid_range[0], lower[valid].min(axis=0))
            self._valid_range[1] = np.maximum(self._valid_range[1], upper[valid].max(axis=0))

    def _add_outside(self, chunk: Recording, torque: Array) -> None:
        ranges = self._model.validity
        outside = np.zeros(chunk.num_samples, bool)
        if ranges.q_min and ranges.q_max:
            q = (chunk.q < np.array(ranges.q_min)) | (chunk.q > np.array(ranges.q_max))
            self._outside["q"] += q.sum(axis=0)
            outside |= q.any(axis=1)
        if ranges.v_max:
            v = np.abs(chunk.v) > np.array(ranges.v_max)
            self._outside["v"] += v.sum(axis=0)
            outside |= v.any(axis=1)
        if ranges.tau_max:
            self._outside["tau"] += (np.abs(torque) > np.array(ranges.tau_max)).sum(axis=0)
        self._outside_motion += int(outside.sum())

    def metrics(self, config: EstimateConfig, rule: str) -> dict[str, Any]:
        share = 100.0 / self.count
        return {
            "num_samples": self.count,
            "duration_s": self._last - self._first,
            "time_step_s": config.time_step,
            "valid_pct": share * self.num_valid,
            "invalid": {
                "observer_settling_pct": share * self._num_invalid["settling"],
                "bridged_dropout_pct": share * self._num_invalid["dropout"],
                "force_too_uncertain_pct": share * self._num_invalid["unsure"],
            },
            "prior": {
                "force_sd_n": config.prior_force_sd,
                "moment_sd_nm": config.prior_moment_sd,
                "rule": rule,
            },
            "condition_number": {
                "median": float(np.median(self._condition.values())),
                "max": self._largest_condition,  # where J is not singular
                "singular_pct": share * self._num_singular,
            },
            "wrench": self._all.metrics(),
            "valid": {"wrench": self._of_valid.metrics()},
            "outside_model": {
                "motion_pct": share * self._outside_motion,
                **{f"{name}_pct": share * count for name, count in self._outside.items()},
            },
        }

    def warnings(self) -> list[str]:
        found = []
        outside = self._outside_motion / self.count
        if outside > _OUTSIDE_WARNING:
            worst = {
                name: self._model.joint_names[int(np.argmax(self._outside[name]))]
                for name in ("q", "v")
                if self._outside[name].any()
            }
            where = " and ".join(
                f"{'position' if name == 'q' else 'speed'} of {joint}"
                for name, joint in worst.items()
            )
            found.append(
                f"{100 * outside:.1f} % of the samples lie outside the motion that the model was "
                f"identified on (mostly {where}): it extrapolates there"
            )
        unsure = self._num_invalid["unsure"] / self.count
        if unsure > _UNSURE_WARNING:
            found.append(
                f"{100 * unsure:.0f} % of the samples say less about the force than the prior: "
                "noise, posture or model do not allow more"
            )
        return found

    def figure(self) -> "Figure":
        from analyses.output.figures import BAND_ALPHA, COLOUR, new_figure

        low, high, mean = self._envelope.values()
        t, is_invalid = mean[:, 0], mean[:, 1] > 0.5
        figure, axes = new_figure(3, 2, share_x=True)
        for k, axis in enumerate(AXES):
            panel: Any = axes[k % 3, k // 3]
            unit = "N" if axis.startswith("f") else "N m"
            panel.fill_between(
                t,
                low[:, 6 + k],
                high[:, 6 + k],
                color=COLOUR["estimate"],
                alpha=BAND_ALPHA,
                lw=0,
                label="95 % band",
            )
            # The extremes of each stretch, in turn: one line that shows every peak of a long log.
            panel.plot(
                t.repeat(2),
                np.stack([low[:, k], high[:, k]], axis=1).ravel(),
                color=COLOUR["estimate"],
                lw=0.9,
                label="estimate",
            )
            panel.set_ylabel(f"{axis[0]}$_{axis[1]}$ [{unit}]")
            panel.set_ylim(*self._limits(k, low, high))
            _shade(panel, t, is_invalid, COLOUR["invalid"])
            if k % 3 == 2:
                panel.set_xlabel("time [s]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        figure.suptitle("Wrench of the environment on the robot, at E in axes of W")
        return figure

    def _limits(self, k: int, low: Array, high: Array) -> tuple[float, float]:
        """Range of y that shows the valid samples; an invalid one may read anything."""
        bottom, top = self._valid_range[:, k]
        if not np.isfinite(bottom):
            bottom, top = np.percentile(low[:, k], 2), np.percentile(high[:, k], 98)
        margin = 0.05 * (top - bottom) or 1.0
        return float(bottom - margin), float(top + margin)


def _shade(panel: Any, t: Array, is_invalid: Flags, colour: str) -> None:
    """Marks the stretches that hold invalid samples."""
    padded = np.concatenate([[False], is_invalid, [False]]).astype(np.int8)
    begins, ends = np.flatnonzero(np.diff(padded) == 1), np.flatnonzero(np.diff(padded) == -1) - 1
    half = 0.5 * float(np.median(np.diff(t))) if len(t) > 1 else 0.5
    for index, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        label = "not valid" if index == 0 else None
        panel.axvspan(t[begin] - half, t[end] + half, color=colour, lw=0, zorder=0, label=label)
