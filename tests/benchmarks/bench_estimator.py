"""The whole estimator, per tick and over a log, against the same chain in Python with pinocchio.

Run by `make bench`. All is timed in one run, in turns, so that the ratios hold on a busy machine
too; results are compared before they are timed. A tick: current to torque, M v, C^T v, G, J,
friction, observer, Bayesian wrench with covariance, condition number and flag, for a 6-joint arm.
"""

import gc
import time
from collections.abc import Callable
from dataclasses import replace

import numba
import numpy as np
import pinocchio
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from sample_models import sample_torque_error

from wrenchsight.diagrams.estimator import add_estimator_to_ports, make_estimator
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

Tick = Callable[[int], Array]

LOG_SAMPLES = 100_000
TICKS = 20_000
ROUNDS = 5
DIAGRAM_TICKS = 5_000
STRETCH = 100  # ticks between two looks at the clock, which is that of the process


class PinocchioEstimator:
    """The chain as someone would write it in Python: fast library calls, memory allocated once."""

    def __init__(self, reference: WrenchEstimator) -> None:
        robot, model = reference.robot, reference.model
        self.model = pinocchio.buildModelFromXML(robot.urdf_text)
        self.model.armature = np.array(reference.chain.reflected_inertia)
        self.data = self.model.createData()
        self.frame = self.model.getFrameId("E")
        law = model.friction.coulomb_viscous
        self.coulomb, self.viscous, self.offset = law.coulomb, law.viscous, law.offset
        self.gain = robot.torque_per_ampere * robot.current_sign
        self.T = reference.observer.time_step
        self.pole = np.exp(-reference.observer.K_0 * self.T)
        self.rate = (1.0 - self.pole) / self.T
        self.weight = np.linalg.inv(model.residual_covariance)
        prior = reference.config.reconstruction
        assert prior.prior_force_sd is not None
        assert prior.prior_moment_sd is not None
        self.prior_information = np.diag(
            [prior.prior_moment_sd**-2] * 3 + [prior.prior_force_sd**-2] * 3
        )
        self.max_variance = 0.5 * prior.prior_force_sd**2
        self.started = False
        self.tau_ext = np.zeros(robot.num_joints)
        self.predicted = np.zeros(robot.num_joints)
        self.J = np.empty((6, robot.num_joints))

    def step(self, q: Array, v: Array, current: Array) -> tuple[Array, Array, Array, float, bool]:
        model, data = self.model, self.data
        C = pinocchio.computeCoriolisMatrix(model, data, q, v)  # leaves joint Jacobians and poses
        pinocchio.updateFramePlacement(model, data, self.frame)
        linear_first = pinocchio.getFrameJacobian(
            model, data, self.frame, pinocchio.LOCAL_WORLD_ALIGNED
        )
        self.J[:3], self.J[3:] = linear_first[3:], linear_first[:3]
        CTv = v @ C
        momentum = pinocchio.crba(model, data, q) @ v
        G = pinocchio.computeGeneralizedGravity(model, data, q)
        tau_f = self.offset + self.coulomb * np.sign(v) + self.viscous * v
        half = (0.5 * self.T) * (CTv - G - tau_f)
        if self.started:
            self.tau_ext = self.pole * self.tau_ext + self.rate * (momentum - half - self.predicted)
        self.started = True
        self.predicted = momentum + half + self.T * (self.gain * current)
        weighted = self.J @ self.weight
        covariance = np.linalg.inv(weighted @ self.J.T + self.prior_information)
        wrench = covariance @ (weighted @ self.tau_ext)
        s = np.linalg.svd(self.J, compute_uv=False)
        worst = np.linalg.eigvalsh(covariance[3:, 3:])[-1]
        return (
            self.tau_ext,
            wrench,
            covariance,
            float(s[0] / s[-1]),
            bool(worst <= self.max_variance),
        )


def log(robot: Robot, T: float) -> tuple[Array, Array, Array]:
    """All joints in smooth motion, currents of a real size."""
    t = T * np.arange(LOG_SAMPLES)[:, None]
    w = np.array([1.1, 0.9, 1.7, 2.3, 3.1, 2.0])
    phase = np.arange(6.0)
    q = np.array([0.0, 0.2, -0.6, 0.3, 1.0, 0.0]) + 0.5 * np.sin(w * t + phase)
    v = 0.5 * w * np.cos(w * t + phase)
    noise = np.random.default_rng(0).normal(size=q.shape)
    tau = robot.chain.gravity_torque(q) + noise
    return q, v, robot.motor_current(tau)


def tick_times(ticks: list[Tick], count: int) -> list[Array]:
    """Seconds of each of `count` calls of each, in turns of a hundred."""
    times: list[list[int]] = [[] for _ in ticks]
    for start in range(0, count, 100):
        for tick, record in zip(ticks, times, strict=True):
            for k in range(start, start + 100):
                before = time.perf_counter_ns()
                tick(k)
                record.append(time.perf_counter_ns() - before)
    return [np.array(record) * 1e-9 for record in times]


def simulation(
    robot: Robot,
    model: IdentifiedModel,
    samples: tuple[Array, ...],
    T: float,
    fused: bool | None,
    check: bool = True,
) -> Simulator:
    """Of the estimator with Drake's own sources and a log of the wrench; None: without it."""
    builder = DiagramBuilder()
    t = T * np.arange(len(samples[0]))
    ports = {}
    for name, signal in zip(("q", "v", "current"), samples, strict=True):
        held = PiecewisePolynomial.ZeroOrderHold(t, signal.T)
        ports[name] = builder.AddSystem(TrajectorySource(held)).get_output_port()
    logged = ports["q"]
    if fused is not None:
        config = WrenchEstimatorConfig(check_samples=check)
        estimator = add_estimator_to_ports(builder, robot, model, config, **ports, fused=fused)
        logged = estimator.GetOutputPort("wrench")
    LogVectorOutput(logged, builder, T)
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    return simulator


def row(name: str, times: Array, reference: Array) -> None:
    median, high = 1e6 * np.median(times), 1e6 * np.percentile(times, 99)
    by_median = np.median(reference) / np.median(times)
    by_high = np.percentile(reference, 99) / np.percentile(times, 99)
    print(f"{name:44} {median:9.1f} us {high:9.1f} us {by_median:9.2f} x {by_high:9.2f} x")


def main() -> None:
    """Prints the table."""
    robot = Robot.load("sts_sre4_600")
    law = CoulombViscous(np.full(6, 5.0), np.full(6, 4.0), np.full(6, 0.1))
    model = replace(IdentifiedModel.nominal(robot), friction=SemiParametricFriction(law))
    knowing = replace(model, torque_error=sample_torque_error())
    config = WrenchEstimatorConfig()
    ours = WrenchEstimator(robot, model, config)
    T = ours.observer.time_step
    q, v, current = log(robot, T)

    batch = ours.run(ours.initial_state(), q, v, current)
    theirs = PinocchioEstimator(ours)
    for k in range(2000):
        tau_ext, wrench, covariance, condition, valid = theirs.step(q[k], v[k], current[k])
        assert np.allclose(tau_ext, batch.tau_ext[k], rtol=0, atol=1e-7)
        assert np.allclose(wrench, batch.wrench[k], rtol=1e-6, atol=1e-6)
        assert np.allclose(covariance, batch.covariance[k], rtol=1e-6, atol=1e-6)
        assert np.isclose(condition, batch.condition_number[k], rtol=1e-8)
        assert k < 200 or valid == batch.valid[k]  # before, the observer is settling

    print("Six-joint arm, one tick. Ratios: time of the Python chain over the row's.")
    print(f"{'':44} {'median':>12} {'99th pct':>12} {'median':>11} {'99th pct':>11}")
    trusting = WrenchEstimator(robot, knowing, config)
    state, trusted_state = ours.initial_state(), trusting.initial_state()
    theirs = PinocchioEstimator(ours)
    kernel_times, trusted_times, reference_times = tick_times(
        [
            lambda k: ours.step(state, q[k], v[k], current[k]).wrench,
            lambda k: trusting.step(trusted_state, q[k], v[k], current[k]).wrench,
            lambda k: theirs.step(q[k], v[k], current[k])[1],
        ],
        TICKS,
    )
    row("Python with pinocchio", reference_times, reference_times)
    row("WrenchEstimator.step", kernel_times, reference_times)
    row("the same, of a model with a torque error", trusted_times, reference_times)

    diagram = make_estimator(robot, model, config)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    inputs = [
        (diagram.GetInputPort(name).FixValue(context, signal[0]), signal)
        for name, signal in (("q", q), ("v", v), ("current", current))
    ]
    outputs = [
        diagram.GetOutputPort(name)
        for name in ("tau_ext", "wrench", "covariance", "condition_number", "valid")
    ]
    simulator.Initialize()

    def diagram_tick(k: int) -> Array:
        for value, signal in inputs:
            value.GetMutableData().get_mutable_value().SetFromVector(signal[k])
        values = [port.Eval(context) for port in outputs]
        simulator.AdvanceTo((k + 1) * T)
        wrench: Array = values[1]
        return wrench

    theirs = PinocchioEstimator(ours)
    worst = 0.0
    for k in range(500):
        worst = max(worst, float(np.abs(diagram_tick(k) - batch.wrench[k]).max()))
    assert worst < 1e-9, worst
    diagram_times, reference_times = tick_times(
        [
            lambda k: diagram_tick(500 + k),
            lambda k: theirs.step(q[k], v[k], current[k])[1],
        ],
        DIAGRAM_TICKS,
    )
    row("the Drake diagram: inputs, AdvanceTo, outputs", diagram_times, reference_times)

    print(f"\nThe same in a simulation, {STRETCH} ticks at a time: sources, estimator, log.")
    samples = tuple(signal[: DIAGRAM_TICKS + STRETCH] for signal in (q, v, current))
    simulators = {
        "sources and log alone": simulation(robot, model, samples, T, None),
        "the Drake diagram of stages": simulation(robot, model, samples, T, False),
        "the fused block": simulation(robot, model, samples, T, True),
        "the same, samples not checked, like the chain": simulation(
            robot, model, samples, T, True, False
        ),
        "the same, of a model with a torque error": simulation(robot, knowing, samples, T, True),
    }
    theirs = PinocchioEstimator(ours)
    times: dict[str, list[float]] = {name: [] for name in ("Python with pinocchio", *simulators)}
    gc.disable()  # as `simulate` does
    for start in range(0, DIAGRAM_TICKS, STRETCH):
        before = time.process_time()
        for k in range(start, start + STRETCH):
            theirs.step(q[k], v[k], current[k])
        times["Python with pinocchio"].append((time.process_time() - before) / STRETCH)
        for name, one in simulators.items():
            before = time.process_time()
            one.AdvanceTo((start + STRETCH) * T)
            times[name].append((time.process_time() - before) / STRETCH)
    gc.enable()
    for name, seconds in times.items():
        row(name, np.array(seconds), np.array(times["Python with pinocchio"]))

    print(f"\nA log of {LOG_SAMPLES:,} samples; processor time on one thread, elapsed on all.")
    log_times(ours, trusting, (q, v, current))


def log_times(ours: WrenchEstimator, trusting: WrenchEstimator, log: tuple[Array, ...]) -> None:
    """Prints what a log takes. Elapsed times hold where nothing else runs."""
    all_threads, rows = numba.get_num_threads(), LOG_SAMPLES // 5

    def chain_over_rows() -> None:  # a fifth of the log: the loop has no other costs
        chain = PinocchioEstimator(ours)
        for k in range(rows):
            chain.step(*(signal[k] for signal in log))

    ways: dict[str, Callable[[], object]] = {
        "Python with pinocchio": chain_over_rows,
        "WrenchEstimator.run": lambda: ours.run(ours.initial_state(), *log),
        "the same, of a model with a torque error": lambda: trusting.run(
            trusting.initial_state(), *log
        ),
    }
    for threads in sorted({1, all_threads}):
        numba.set_num_threads(threads)
        records: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
        for _ in range(ROUNDS):
            for name, way in ways.items():
                records[name].append(elapsed(way))
        seconds = {
            name: np.median(times, axis=0)[int(threads == 1)] for name, times in records.items()
        }
        seconds["Python with pinocchio"] *= LOG_SAMPLES / rows
        print(f"{threads} thread{'s' * (threads > 1)}")
        for name, own in seconds.items():
            print(f"{name:44} {own:9.3f} s  {seconds['Python with pinocchio'] / own:9.1f} x")


def elapsed(call: Callable[[], object]) -> tuple[float, float]:
    """The time that passes, and that of the processor, s."""
    before = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - before[0], time.process_time() - before[1]


if __name__ == "__main__":
    main()
