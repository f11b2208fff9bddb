"""Supports docs/concepts.md, "the true `tau_ext` behind the first-order low-pass K_0 / (s + K_0)".

Experiment `bandwidth`: response of the observer to force and noise, by gain (section 4.8).

A continuous-time arm is held by a joint controller while a wrench acts at E; observers with
several gains watch it in one diagram. First sines of many frequencies act at once, without noise:
the observers' amplitude and phase against K_0 / (s + K_0), eq. 30. Then a step along X, a ramp
along Y and a sine along Z act, without and with the drives' current noise and resolution: delay,
lag, attenuation, and noise, as in Fig. 23.

Time stamps. The wrench is a sine in continuous time, the true torque at a tick is J(q)^T F at that
very moment, and the estimate at a tick is the one that uses q and v of that tick and motor torque
up to it. Nothing is shifted before the comparison. A sampled observer can then not be eq. 30
exactly: it is fed the mean of the torque over each tick T,

    H(w) = (1 - a) / (1 - a exp(-i w T))  sinc(w T / 2) exp(-i w T / 2),   a = exp(-K_0 T)

which lags eq. 30 by a phase of K_0 w T^2 / 12 and falls short of its amplitude by
(K_0 w T^2)^2 / 480, to leading order. Both comparisons are reported. (A plant that held the wrench
over its step instead would delay it by half a step, and what was compared would be the plant: 14
degrees at 80 Hz and 1 ms.)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import Context
from pydrake.systems.primitives import VectorLogSink
from scipy.optimize import minimize_scalar

from wrenchsight.analyses.methods.simulate.advance import advance
from wrenchsight.analyses.output.axes import legend_above, log_scale
from wrenchsight.analyses.output.figures import COLOUR, SERIES, Figure, legend_on_top, new_figure
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.diagrams.held_arm import HeldArm, make_held_arm
from wrenchsight.models.control.wrench_script import (
    WrenchRamp,
    WrenchScript,
    WrenchSegment,
    WrenchSine,
    WrenchStep,
)
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.robot.robot import Robot

ComplexArray = NDArray[np.complex128]

OBSERVER_GAINS = (5.0, 20.0, 50.0, 100.0)  # K_0, 1/s
TIME_STEP = 1e-3  # s
LOWEST_FREQUENCY, LOWEST_FREQUENCY_QUICK = 0.1, 0.5  # Hz
INTEGRATION_ACCURACY = 1e-4  # of Drake's error control
HIGHEST_RATIO = 5.0  # highest frequency over K_0 / (2 pi)
SETTLING_TIME_CONSTANTS = 18.0  # time constants before the fit: exp(-18) is 2e-8
_MULTIPLE_ROUNDING = 1e-9  # of frequencies: of multiples of the lowest, or relative

# Amplitudes of each tone, chosen so that every joint feels some tenths of a newton metre.
TONE_FORCE = [3.0, 4.0, 5.0]  # N
TONE_MOMENT = [0.3, 0.3, 0.5]  # N m

# Fig. 23: the three kinds of force, one along each axis, after a second of rest.
SIGNAL_START = 1.0  # s
SIGNAL_DURATION, SIGNAL_DURATION_QUICK = 8.0, 4.0  # s after that
STEP_FORCE = 20.0  # N, along X
RAMP_SLOPE, RAMP_RISE = 10.0, 3.0  # N/s along Y, s
SINE_FORCE, SINE_FREQUENCY = 20.0, 2.0  # N along Z, Hz


@dataclass(frozen=True)
class GainResponse:
    """One observer's measured frequency response, tau_ext_hat over tau_ext.

    Attributes:
        K_0: 1/s.
        frequency: (F,) Hz, up to 5 K_0 / (2 pi).
        response: (F,) complex; all joints' torques fitted together.
        joint_response: (F, n) complex, joint by joint.
        formula: (F,) complex, K_0 / (i w + K_0).
        sampled_formula: (F,) complex, that of the sampled observer (module's docstring).
    """

    K_0: float
    frequency: Array
    response: ComplexArray
    joint_response: ComplexArray
    formula: ComplexArray
    sampled_formula: ComplexArray

    def errors(self) -> dict[str, Array]:
        """(F,) of the worst joint: amplitude and phase against eq. 30, and the complex response
        against the sampled observer's formula.
        """
        ratio = self.joint_response / self.formula[:, None]
        sampled = self.joint_response / self.sampled_formula[:, None]
        return {
            "amplitude_error_pct": 100.0 * np.abs(np.abs(ratio) - 1.0).max(axis=1),
            "phase_error_deg": np.abs(np.angle(ratio, deg=True)).max(axis=1),
            "deviation_from_sampled_pct": 100.0 * np.abs(sampled - 1.0).max(axis=1),
        }

    def metrics(self) -> dict[str, Any]:
        """Of one gain, as written to metrics.json."""
        errors = self.errors()
        corner = int(np.argmin(np.abs(self.frequency - self.K_0 / (2.0 * np.pi))))
        amplitude, phase = np.abs(self.response), np.angle(self.response, deg=True)
        return {
            **{f"max_{key}": float(error.max()) for key, error in errors.items()},
            "frequency_hz": self.frequency,
            "amplitude": amplitude,
            "phase_deg": phase,
            "formula_amplitude": np.abs(self.formula),
            "formula_phase_deg": np.angle(self.formula, deg=True),
            "amplitude_error_pct": errors["amplitude_error_pct"],
            "phase_error_deg": errors["phase_error_deg"],
            "near_corner": {
                "frequency_hz": float(self.frequency[corner]),
                "amplitude": float(amplitude[corner]),
                "phase_deg": float(phase[corner]),
            },
        }


def first_order(K_0: float, frequency: ArrayLike) -> ComplexArray:
    """Eq. 30 at `frequency` (Hz): K_0 / (s + K_0)."""
    s = 2j * np.pi * np.asarray(frequency, float)
    return np.asarray(K_0 / (s + K_0))


def sampled_first_order(K_0: float, frequency: ArrayLike, time_step: float) -> ComplexArray:
    """Response of the sampled observer to a torque that is a sine in continuous time."""
    wT = 2.0 * np.pi * np.asarray(frequency, float) * time_step
    a = np.exp(-K_0 * time_step)
    mean_over_tick = np.sinc(wT / (2.0 * np.pi)) * np.exp(-0.5j * wT)
    return np.asarray((1.0 - a) / (1.0 - a * np.exp(-1j * wT)) * mean_over_tick)


def sweep_frequencies(gains: Sequence[float], lowest: float) -> Array:
    """Octaves from `lowest`, and for every gain its corner and five times it, in Hz.

    All are whole multiples of `lowest`, the corners rounded to the nearest and the highest upwards:
    over the period of `lowest` the tones are orthogonal, and none leaks into another's fit.
    """
    corners = np.asarray(gains) / (2.0 * np.pi) / lowest
    special = np.concatenate(
        [np.round(corners), np.ceil(HIGHEST_RATIO * corners - _MULTIPLE_ROUNDING)]
    )
    octaves = 2.0 ** np.arange(np.floor(np.log2(special.max())) + 1)
    special = special[special >= 1.0]
    # An octave beside one of the others would tell nothing new.
    apart = [f for f in octaves if np.abs(np.log(f / special)).min() > np.log(1.15)]
    return lowest * np.unique(np.concatenate([apart, special]))


def measure_response(
    robot: Robot,
    gains: Sequence[float] = OBSERVER_GAINS,
    lowest_frequency: float = LOWEST_FREQUENCY,
    *,
    time_step: float = TIME_STEP,
    seed: int = 0,
    progress: ProgressCallback = lambda fraction, action: None,
) -> list[GainResponse]:
    """Measures every gain's frequency response on the simulated arm, without noise.

    All tones act at once, and every observer sees them all; of each observer those up to
    HIGHEST_RATIO times its corner are returned. In the fit all have a part, so that none is taken
    for another: over its length, the period of the lowest, they are orthogonal.

    Args:
        robot: held at its home posture.
        gains: K_0, 1/s.
        lowest_frequency: Hz; its period is the length of the fit.
        time_step: s, of drives and observers.
        seed: seed of the tones' phases.

    Returns:
        One response for each of `gains`, in their order.
    """
    frequency = sweep_frequencies(gains, lowest_frequency)
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, frequency.size)
    script = WrenchScript(
        [
            WrenchSine(frequency=float(f), phase=float(p), force=TONE_FORCE, moment=TONE_MOMENT)
            for f, p in zip(frequency, phase, strict=True)
        ]
    )
    arm = make_held_arm(robot, _estimators(gains, time_step), script, robot.home)
    settling = SETTLING_TIME_CONSTANTS / min(gains)
    # Smooth: sines never jump, so that one integration step a tick is exact enough.
    context = _simulate(arm, settling + 1.0 / lowest_frequency, progress, smooth=True)
    q, wrench = _log(arm.q, context), _log(arm.wrench_true, context)
    settled = slice(round(settling / time_step), None)
    t = _ticks(len(q), time_step)[settled]
    tau_ext = np.einsum("kij,ki->kj", robot.chain.jacobian(q[settled]), wrench[settled])
    true = _phasors(t, tau_ext, frequency)  # (F, n), a row a tone, a column a joint
    responses = []
    for K_0 in gains:
        tau_ext_read = _log(arm.tau_ext[_name(K_0)], context)[settled]
        highest = sweep_frequencies([K_0], lowest_frequency)[-1]  # Hz, one of `frequency`
        used = frequency <= highest * (1.0 + _MULTIPLE_ROUNDING)
        read = _phasors(t, tau_ext_read, frequency)[used]
        # `response` is the least-squares factor from true to read, over all joints together.
        weight = np.conj(true[used])
        responses.append(
            GainResponse(
                K_0=K_0,
                frequency=frequency[used],
                response=(weight * read).sum(axis=1) / (np.abs(weight) ** 2).sum(axis=1),
                joint_response=read / true[used],
                formula=first_order(K_0, frequency[used]),
                sampled_formula=sampled_first_order(K_0, frequency[used], time_step),
            )
        )
    return responses


class Signals(NamedTuple):
    """A step, a ramp and a sine, and what they are read as.

    Attributes:
        t: (T,) s.
        true: (T, 3) N, the force.
        noisy: (T, 3) N, as it is read under noise, by K_0.
        metrics: by K_0.
    """

    t: Array
    true: Array
    noisy: dict[float, Array]
    metrics: dict[float, dict[str, Any]]


def measure_signals(
    robot: Robot, duration: float, seed: int, progress: ProgressCallback
) -> Signals:
    """Lets a step, a ramp and a sine act, each along an axis of its own, without and with noise.

    The controller does not see the current, so that the arm moves, and the true force is, alike in
    both runs.

    Args:
        robot: held at its home posture.
        duration: s of the forces, after a second of rest.
        seed: seed of the current noise.
    """
    segments: list[WrenchSegment] = [
        WrenchStep(start=SIGNAL_START, force=[STEP_FORCE, 0.0, 0.0]),
        WrenchRamp(start=SIGNAL_START, rise=RAMP_RISE, force=[0.0, RAMP_SLOPE * RAMP_RISE, 0.0]),
        WrenchSine(start=SIGNAL_START, frequency=SINE_FREQUENCY, force=[0.0, 0.0, SINE_FORCE]),
    ]

    def run(current_noise: bool, report: ProgressCallback) -> tuple[dict[float, Array], Array]:
        """The force as it is read, by K_0, and the true one, (T, 3) N each."""
        arm = make_held_arm(
            robot,
            _estimators(OBSERVER_GAINS, TIME_STEP),
            WrenchScript(segments),
            robot.home,
            current_noise=current_noise,
            seed=seed,
        )
        context = _simulate(arm, SIGNAL_START + duration, report, smooth=False)  # the step jumps
        forces = {K_0: _log(arm.wrench[_name(K_0)], context)[:, 3:] for K_0 in OBSERVER_GAINS}
        return forces, _log(arm.wrench_true, context)[:, 3:]

    clean, _ = run(False, lambda fraction, action: progress(0.5 * fraction, action))
    noisy, true = run(True, lambda fraction, action: progress(0.5 + 0.5 * fraction, action))
    t = _ticks(len(true), TIME_STEP)
    metrics = {
        K_0: _signal_metrics(robot, K_0, t, true, clean[K_0], noisy[K_0]) for K_0 in OBSERVER_GAINS
    }
    return Signals(t, true, noisy, metrics)


def _signal_metrics(
    robot: Robot, K_0: float, t: Array, true: Array, clean: Array, noisy: Array
) -> dict[str, Any]:
    """Compares the readings of step, ramp, sine and noise with the formulas of a first-order lag.

    Args:
        K_0: 1/s, of the observer.
        t: (T,) s.
        true: (T, 3) N, the force: a step along x, a ramp along y, a sine along z.
        clean, noisy: (T, 3) N, as it is read without noise of the current, and with it.

    Returns:
        By kind of force; keys with `formula_` are of the lag's formula, those beside them measured.
        The lag of the ramp is its mean once the observer has settled, of a slow one over the last
        fifth of the rise. `noise_sd_n` and its formula are (3,).
    """
    since = t - SIGNAL_START
    acting = since > 0.0

    def step_misfit(time_constant: float) -> float:
        model = STEP_FORCE * -np.expm1(-since[acting] / time_constant)
        return float(((clean[acting, 0] - model) ** 2).mean())

    bounds = (0.1 / K_0, 10.0 / K_0)  # s, wide about the formula's time constant
    fit = minimize_scalar(step_misfit, bounds=bounds, method="bounded", options={"xatol": 1e-9})
    settling = 1.0 / K_0 * SETTLING_TIME_CONSTANTS  # s, from the start of the forces
    # Of a slow observer at least the last fifth of the rise.
    on_the_ramp = (since > min(settling, 0.8 * RAMP_RISE)) & (since <= RAMP_RISE)
    late = since > settling
    tone = np.array([SINE_FREQUENCY])
    # Read over true along z, as a complex ratio of phasors (1, 1): one tone, one signal.
    read_z, true_z = clean[late, 2:], true[late, 2:]
    sine = (_phasors(t[late], read_z, tone) / _phasors(t[late], true_z, tone))[0, 0]
    formula = first_order(K_0, SINE_FREQUENCY)

    # White torque noise through the observer's pole, then through J^-T (the article's eq. 22) at
    # the home posture, where the signals are run; rounding adds its own.
    a = np.exp(-K_0 * TIME_STEP)
    variance = robot.current_noise_sd**2 + robot.current_resolution**2 / 12.0
    torque_variance = robot.torque_per_ampere**2 * variance * (1.0 - a) / (1.0 + a)
    inverse = np.linalg.pinv(robot.chain.jacobian(robot.home).T)
    return {
        "step": {
            "time_constant_s": float(fit.x),
            "formula_time_constant_s": 1.0 / K_0,
            "rise_time_s": fit.x * np.log(9.0),  # from 10 to 90 %
        },
        "ramp": {
            "lag_n": float((true - clean)[on_the_ramp, 1].mean()),
            "formula_lag_n": RAMP_SLOPE / K_0,
        },
        "sine": {
            "amplitude": float(abs(sine)),
            "phase_deg": float(np.angle(sine, deg=True)),
            "formula_amplitude": float(abs(formula)),
            "formula_phase_deg": float(np.angle(formula, deg=True)),
        },
        # The noise starts from nothing, as the observer does: after one time constant its variance
        # is 86 % of the final one, and soon nearly all of it.
        "noise_sd_n": (noisy - clean)[t > 1.0 / K_0].std(axis=0),
        "formula_noise_sd_n": np.sqrt((inverse**2 @ torque_variance)[3:]),
    }


def _ticks(count: int, time_step: float) -> Array:
    return np.asarray(np.arange(count) * time_step, dtype=np.float64)


def _log(sink: VectorLogSink, context: Context) -> Array:
    """(T, size), one row a tick."""
    return np.asarray(sink.FindLog(context).data().T, dtype=np.float64)


def _name(K_0: float) -> str:
    return f"K0_{K_0:g}"


def _estimators(gains: Sequence[float], time_step: float) -> dict[str, WrenchEstimatorConfig]:
    """For every gain an estimator with eq. 22: a prior would hide the observer."""
    return {
        _name(K_0): WrenchEstimatorConfig(
            MomentumObserverConfig([K_0], time_step), WrenchReconstructionConfig("inverse")
        )
        for K_0 in gains
    }


def _simulate(
    arm: HeldArm, duration: float, progress: ProgressCallback, *, smooth: bool
) -> Context:
    """Advances the arm from rest and returns the diagram's context, with its logs."""
    simulator = Simulator(arm.diagram)
    # A step never spans two ticks, so none sees the held torque jump. Of a smooth force one step a
    # tick takes the impulse by Simpson's rule, 2e-5 off at the highest tone; where the force jumps,
    # error control makes the step short enough.
    ResetIntegratorFromFlags(simulator, "runge_kutta3", arm.time_step)
    integrator = simulator.get_mutable_integrator()
    integrator.set_fixed_step_mode(smooth)
    if not smooth:
        integrator.set_target_accuracy(INTEGRATION_ACCURACY)
    num_ticks = round(duration / arm.time_step)
    advance(
        simulator,
        [(num_ticks * part // 20 - 0.5) * arm.time_step for part in range(1, 21)],
        lambda share: progress(share, f"{share * duration:.1f} s simulated"),
    )
    return simulator.get_context()


def _phasors(t: Array, signals: Array, frequency: Array) -> ComplexArray:
    """(F, n) complex amplitudes of the tones in `signals` (T, n), fitted all at once."""
    angle = 2.0 * np.pi * t[:, None] * frequency
    basis = np.hstack([np.ones((t.size, 1)), np.cos(angle), np.sin(angle)])
    fitted = np.linalg.lstsq(basis, signals, rcond=None)[0]
    count = frequency.size
    return np.asarray(fitted[1 : 1 + count] - 1j * fitted[1 + count :])


def run(context: ExperimentContext) -> ExperimentResult:
    """Runs the experiment `bandwidth`.

    Metrics are by gain (`_name`): of the sweep, then `step`, `ramp`, `sine` and noise; keys with
    `max_` on top are the worst over all gains.
    """
    robot = Robot.load("sts_sre4_600")
    lowest = LOWEST_FREQUENCY_QUICK if context.quick else LOWEST_FREQUENCY
    duration = SIGNAL_DURATION_QUICK if context.quick else SIGNAL_DURATION
    responses = measure_response(
        robot, OBSERVER_GAINS, lowest, seed=context.seed, progress=context.part(0.0, 0.6, "sweep: ")
    )
    signals = measure_signals(robot, duration, context.seed, context.part(0.6, 0.95, "signals: "))
    metrics: dict[str, Any] = {}
    for response in responses:
        metrics[_name(response.K_0)] = response.metrics() | signals.metrics[response.K_0]
    for key in ("amplitude_error_pct", "phase_error_deg", "deviation_from_sampled_pct"):
        metrics[f"max_{key}"] = max(metrics[_name(K_0)][f"max_{key}"] for K_0 in OBSERVER_GAINS)
    return ExperimentResult(
        metrics=metrics,
        figures=[
            (
                "bode",
                _bode_figure(responses),
                "Amplitude and phase of the estimated over the true external torque (Fig. 22); "
                "below, the errors against eq. 30.",
            ),
            (
                "signals",
                _signals_figure(signals.t, signals.true, signals.noisy),
                "A step, a ramp and a sine read with several gains under the current's noise "
                "(Fig. 23).",
            ),
        ],
        comparison=_comparison(metrics),
        notes=NOTES,
        configuration={
            "robot": robot.name,
            "lowest_frequency": lowest,
            "signal_duration": duration,
        },
    )


def _comparison(metrics: dict[str, Any]) -> list[ComparisonRow]:
    rows = []
    for K_0 in OBSERVER_GAINS:
        near = f"{_name(K_0)}.near_corner"
        frequency = metrics[_name(K_0)]["near_corner"]["frequency_hz"]
        where = f"at {frequency:.1f} Hz, K_0 = {K_0:g}"
        formula = complex(first_order(K_0, frequency))
        phase = float(np.angle(formula, deg=True))
        rows += [
            ComparisonRow(
                f"Amplitude {where}", f"{near}.amplitude", article=abs(formula), remark="eq. 30"
            ),
            ComparisonRow(f"Phase {where}", f"{near}.phase_deg", article=phase, remark="eq. 30"),
        ]
    return [
        *rows,
        ComparisonRow("Largest amplitude error against eq. 30", "max_amplitude_error_pct"),
        ComparisonRow("Largest phase error against eq. 30", "max_phase_error_deg"),
    ]


def _bode_figure(responses: Sequence[GainResponse]) -> Figure:
    """Amplitude and phase of each gain, and their errors against eq. 30 (the article's Fig. 22)."""
    figure, axes = new_figure(3, 1, height=7.8, share_x=True)
    amplitude, phase, error = axes[:, 0]
    for response, colour in zip(responses, SERIES, strict=False):
        frequency, measured = response.frequency, response.response
        fine = np.geomspace(frequency[0], frequency[-1], 200)
        formula = first_order(response.K_0, fine)
        amplitude.plot(fine, np.abs(formula), color=colour)
        label = f"$K_0$ = {response.K_0:g} 1/s"
        amplitude.plot(frequency, np.abs(measured), "o", color=colour, label=label)
        phase.plot(fine, np.angle(formula, deg=True), color=colour)
        phase.plot(frequency, np.angle(measured, deg=True), "o", color=colour)
        errors = response.errors()
        error.plot(frequency, errors["phase_error_deg"], "-o", color=colour)
        error.plot(frequency, errors["amplitude_error_pct"], ":s", color=colour, markersize=3)
    amplitude.plot([], [], color=COLOUR["reference"], label="eq. 30")
    log_scale(amplitude, "y")
    amplitude.set_ylabel("amplitude [-]")
    phase.set_ylabel("phase [deg]")
    # A guide for the eye at 1 deg and 1 %.
    error.axhline(1.0, color=COLOUR["reference"], linestyle="--", linewidth=0.9)
    error.plot([], [], "-o", color=COLOUR["reference"], label="phase [deg]")
    error.plot([], [], ":s", color=COLOUR["reference"], markersize=3, label="amplitude [%]")
    error.set_yscale("log")
    error.set_ylim(1e-6, 30.0)  # below, the integration's errors
    log_scale(error, "y")
    log_scale(error, "x")
    error.set_ylabel("error, worst joint")
    error.set_xlabel("frequency [Hz]")
    legend_above(error, ncols=2)
    legend_on_top(figure, amplitude)
    return figure


def _signals_figure(t: Array, true: Array, forces: Mapping[float, Array]) -> Figure:
    """A step, a ramp and a sine as each gain reads them (the article's Fig. 23)."""
    figure, axes = new_figure(3, 1, height=7.8)
    kinds = (("step", 1.1), ("ramp", 1.4), ("sine", 1.6))
    for axis, (kind, end) in enumerate(kinds):
        ax = axes[axis, 0]
        shown = (t >= SIGNAL_START - 0.1) & (t <= SIGNAL_START + end)
        for K_0, force in forces.items():
            label = f"$K_0$ = {K_0:g} 1/s"
            ax.plot(t[shown], force[shown, axis], linewidth=0.9, label=label)
        ax.plot(t[shown], true[shown, axis], color=COLOUR["truth"], linewidth=1.4, label="true")
        ax.set_title(kind)
        ax.set_ylabel(f"force along {'XYZ'[axis]} [N]")
    axes[2, 0].set_xlabel("time [s]")
    legend_on_top(figure, axes[0, 0])
    return figure


NOTES = (
    "Deviation from the low-pass of eq. 30, K_0 from 5 to 100 1/s: at most "
    "<max_amplitude_error_pct:.4f> % and <max_phase_error_deg:.3f> deg; from the sampled filter's "
    "own formula <max_deviation_from_sampled_pct:.4f> %.",
    f"K_0 = {OBSERVER_GAINS[0]:g} and {OBSERVER_GAINS[-1]:g} 1/s: time constant of a step "
    f"<{_name(OBSERVER_GAINS[0])}.step.time_constant_s:1e3 .0f> and "
    f"<{_name(OBSERVER_GAINS[-1])}.step.time_constant_s:1e3 .1f> ms, lag of a ramp "
    f"<{_name(OBSERVER_GAINS[0])}.ramp.lag_n:.2f> and "
    f"<{_name(OBSERVER_GAINS[-1])}.ramp.lag_n:.2f> N, noise in fx "
    f"<{_name(OBSERVER_GAINS[0])}.noise_sd_n.0:.2f> and "
    f"<{_name(OBSERVER_GAINS[-1])}.noise_sd_n.0:.2f> N.",
    "No friction and the true model: the errors are the observer's alone.",
)


EXPERIMENT = Experiment(
    name="bandwidth",
    title="Bandwidth and noise of the observer, by its gain",
    section="4.8, Figs. 22-23",
    run=run,
    order=130,
)
