"""One run of a machining task: readings of the force, and how well the normal force is held.

The run goes from the approach to the lift. The force along the feed's direction and along the
surface's normal is judged against the true contact force while the tool works. That is from the
first to the last motion, turns included. The readings are:

    article          semi-parametric friction, K_0 = 20, eq. 22
    coulomb_viscous  the same with the identified law alone
    ours             the estimator in the loop, bayesian: presliding friction, which follows the
                     joints through rest and reversal; the correction learnt on an air pass
                     (`models.machining.air_pass`); less friction where the tool vibrates
                     (`models.machining.tool_vibration`); its band by the state of each joint,
                     learnt from another air pass
    known_friction   no estimator: the article's with the true friction taken off the torques
    sensor           no estimator: the sensor under the tool, behind its low-pass
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import ArmModels
from wrenchsight.analyses.methods.simulate.advance import advance, even_stretches
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.diagrams.closed_loop import LogRequest, LoopEstimator, make_closed_loop
from wrenchsight.diagrams.machining import longest_duration, view_of
from wrenchsight.diagrams.pages.run_page import make_meshcat, start_animation, write_page
from wrenchsight.diagrams.scenario import Scenario
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.air_pass import AirPassCorrection
from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.machining.machining_phases import Fault, Phase
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.rigid_body.spatial_vectors import AXES
from wrenchsight.models.signals.bands import SIGMA_95

LAW, PLAIN, OURS = "semi-parametric", "coulomb-viscous", "presliding"
FEED_TIMES = (15.0, 30.0, 60.0)  # s, one way
K_0 = 20.0  # 1/s, the article's
FEEDBACKS = ("sensor", "estimate")
COMPONENTS = ("tangential", "normal")
READINGS = ("article", "coulomb_viscous", "ours", "known_friction", "sensor")
_PROGRESS_PERIOD = 0.5  # s between two reports of progress
_FRAME_RATE = 12.0  # of the page
_METRES_PER_NEWTON = 0.008
_LOGGED = (
    "q",
    "v",
    "current",
    "wrench",
    "covariance",
    "valid",
    "invalid",
    "wrench_true",
    "ft_wrench",
    "tau_f_true",
    "phase",
    "fault",
    "progress",
    "feed_time",
    "force_setpoint",
)
_LOGGED_CORRECTED = (*_LOGGED, "tool_vibration")


@dataclass(frozen=True)
class MachiningTask:
    """A machining task and the article's figures of it.

    Attributes:
        scenario: bundled, with the sensor in its loop.
        sensorless: bundled, the same without.
        component: of the force, which the article shows: tangential or normal.
        correlation, rmse_n: the article's, by feed.
        figure: of the article.
        remark: why the RMSE differs.
    """

    scenario: str
    sensorless: str
    component: str
    correlation: tuple[float, float, float]
    rmse_n: tuple[float, float, float]
    figure: str
    remark: str


@dataclass(frozen=True, eq=False)
class MachiningRun:
    """One run of a task.

    Attributes:
        plan: of the pass.
        t: (T,) s.
        signals: (T, size) each, by name: see `make_closed_loop`.
    """

    plan: MachiningPath
    t: Array
    signals: Mapping[str, Array]

    @property
    def working(self) -> Flags:
        """(T,) where the tool is led along the path."""
        return np.asarray(self.signals["phase"][:, 0] == Phase.WORK)

    @property
    def steady(self) -> Flags:
        """(T,) where the feed is steady, known from the plan."""
        on_plan = np.interp(
            self.signals["feed_time"][:, 0], self.plan.trajectory.t, self.plan.steady
        )
        return np.asarray(self.working & (on_plan == 1.0))

    @property
    def parts(self) -> dict[str, Flags]:
        """(T,) by part of the work: steady, ends (first motion, last one), turns, all."""
        steady, working = self.steady, self.working
        led = np.flatnonzero(steady)
        between = np.zeros_like(working)
        if len(led):
            between[led[0] : led[-1]] = True
        unsteady = working & ~steady
        return {
            "steady": steady,
            "ends": unsteady & ~between,
            "turns": unsteady & between,
            "all": working,
        }

    @property
    def ways(self) -> NDArray[np.int64]:
        """(T,) number of the way along the path, from 1, where the tool works; else 0."""
        moves = np.sign(np.diff(self.plan.s, append=self.plan.s[-1]))
        led = np.flatnonzero(moves)
        numbers = np.zeros(len(moves), np.int64)
        numbers[led] = 1 + np.cumsum(np.diff(moves[led], prepend=moves[led[0]]) != 0.0)
        numbers = np.maximum.accumulate(np.maximum(numbers, 1))  # at rest: of the way before
        feed_time = self.signals["feed_time"][:, 0]
        k = np.searchsorted(self.plan.trajectory.t, feed_time, side="right") - 1
        return np.asarray(np.where(self.working, numbers[np.clip(k, 0, len(numbers) - 1)], 0))

    @property
    def directions(self) -> dict[str, Array]:
        """(T, 3) unit vectors by component: of the path from its start to its end, and outward."""
        path, place = self.plan.path, self.signals["progress"][:, 0]
        s = path.distance / path.distance[-1]
        along = np.gradient(path.p_WS, s, axis=0)
        n, d = (
            np.stack([np.interp(place, s, x[:, k]) for k in range(3)], axis=1)
            for x in (path.n_W, along)
        )
        n = n / np.linalg.norm(n, axis=1, keepdims=True)
        d = d - n * np.sum(n * d, axis=1, keepdims=True)
        return {"tangential": d / np.linalg.norm(d, axis=1, keepdims=True), "normal": n}

    def components(self, force: Array) -> dict[str, Array]:
        """(T,) N of a force (T, 3) in W, by component."""
        return {name: np.sum(force * d, axis=1) for name, d in self.directions.items()}

    @property
    def fault(self) -> Fault:
        """Why the pass was broken off; NONE where it was not."""
        return Fault(int(self.signals["fault"][-1, 0]))


def run_machining(
    scenario: Scenario,
    models: ArmModels,
    plan: MachiningPath,
    air_pass: AirPassCorrection | None = None,
    reads: IdentifiedModel | None = None,
    page: Path | None = None,
    progress: ProgressCallback = lambda fraction, action: None,
) -> MachiningRun:
    """Machines, from the approach to the lift.

    Args:
        scenario: with machining.
        models: LAW is the controller's, OURS the estimator's unless `reads` is given; their robot
            has its simulated truth.
        plan: of the scenario.
        air_pass: the correction learnt on an air pass along the plan; None: no correction.
        reads: the estimator's model in the place of OURS, such as one whose band is learnt.
        page: where to write the arm in motion (HTML); None: nowhere, and nothing is drawn.
        progress: called with the share done.

    Returns:
        The signals of _LOGGED; with a correction also the tool's vibration.
    """
    machining, robot = scenario.machining, models.robot
    assert machining is not None
    timed = replace(  # long enough for a pass with every retreat
        scenario,
        duration=longest_duration(plan, machining.phases),
        recording=replace(
            scenario.recording, fps=_FRAME_RATE, metres_per_newton=_METRES_PER_NEWTON
        ),
    )
    meshcat: Meshcat | None = None  # with a page alone
    if page is not None:
        middle = plan.path.num_samples // 2
        meshcat = make_meshcat(robot, plan.path.p_WS[middle], view_of(plan.path))
    loop = make_closed_loop(
        timed,
        robot,
        models.models[LAW],
        motion=plan,
        estimator=LoopEstimator(model=reads or models.models[OURS], air_pass=air_pass),
        log=LogRequest(
            also=("tau_f_true",), only=_LOGGED if air_pass is None else _LOGGED_CORRECTED
        ),
        meshcat=meshcat,
    )
    simulator = Simulator(loop.diagram)
    simulator.Initialize()
    if meshcat is not None:
        start_animation(meshcat, _FRAME_RATE)
    advance(
        simulator,
        even_stretches(timed.duration, _PROGRESS_PERIOD),
        lambda share: progress(share, "machining"),
    )
    if meshcat is not None and page is not None:
        title = f"{scenario.description} One way in {machining.one_way:g} s."
        write_page(meshcat, page, title)
    t, signals = loop.logged(simulator.get_context())
    return MachiningRun(plan, t, signals)


def read_all(run: MachiningRun, models: ArmModels) -> dict[str, dict[str, Array]]:
    """(T,) N by reading (READINGS) and component."""
    robot, signals = models.robot, run.signals
    inverse = WrenchReconstructionConfig("inverse")
    config = WrenchEstimatorConfig(MomentumObserverConfig([K_0]), inverse)

    def read(estimator: WrenchEstimator, tau_f: Array | None = None) -> Array:
        state = estimator.initial_state()
        q, v, current = signals["q"], signals["v"], signals["current"]
        return estimator.run(state, q, v, current, tau_f=tau_f).wrench[:, 3:]

    law, plain = models.models[LAW], models.models[PLAIN]
    forces = {
        "article": read(WrenchEstimator(robot, law, config)),
        "coulomb_viscous": read(WrenchEstimator(robot, plain, config)),
        "ours": signals["wrench"][:, 3:],
        "known_friction": read(WrenchEstimator(robot, law, config), signals["tau_f_true"]),
        "sensor": signals["ft_wrench"][:, 3:],
    }
    return {name: run.components(force) for name, force in forces.items()}


def errors(reading: Array, truth: Array) -> dict[str, float]:
    """Correlation, RMSE, largest and mean error of a force (T,) in N."""
    error = reading - truth
    return {
        "correlation": float(np.corrcoef(reading, truth)[0, 1]),
        "rmse_n": float(np.sqrt(np.mean(error**2))),
        "max_error_n": float(np.abs(error).max()),
        "bias_n": float(error.mean()),
    }


def band_shares(run: MachiningRun, valid_only: bool = False) -> dict[str, dict[str, float]]:
    """Share of the estimator's readings inside its stated 95 % band, by part and axis of W.

    A part that the run does not have is left out.

    Args:
        valid_only: whether only readings count that are valid; a part without one is left out.
    """
    wrench, truth = run.signals["wrench"], run.signals["wrench_true"]
    covariance = run.signals["covariance"].reshape(-1, 6, 6)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    inside = (np.abs(wrench - truth) <= SIGMA_95 * sd)[:, 3:]
    valid = run.signals["valid"][:, 0] != 0.0
    parts = {part: rows & valid if valid_only else rows for part, rows in run.parts.items()}
    return {
        part: dict(zip(AXES, inside[rows].mean(axis=0).tolist(), strict=True))
        for part, rows in parts.items()
        if rows.any()
    }


def errors_within_ways(reading: Array, truth: Array, ways: NDArray[np.int64]) -> dict[str, Any]:
    """How well a reading follows the force beyond the mean of each way.

    Friction along the feed changes its sign when the feed turns round: over several ways most of a
    correlation is that change. Here each way's means are taken off first.

    Args:
        reading, truth: (T,) N.
        ways: (T,) number of the way of a sample; 0 is left out.

    Returns:
        correlation and RMSE over all ways, and `ways` with those of each.
    """
    parts = [
        (reading[entry], truth[entry]) for entry in (ways == k for k in np.unique(ways[ways > 0]))
    ]
    centred = [(entry - entry.mean(), true - true.mean()) for entry, true in parts]
    together = [np.concatenate(signal) for signal in zip(*centred, strict=True)]
    wanted = ("correlation", "rmse_n")
    each = [errors(*pair) for pair in centred]
    return {key: errors(together[0], together[1])[key] for key in wanted} | {
        "ways": {key: [entry[key] for entry in each] for key in wanted}
    }


def regulation(run: MachiningRun) -> dict[str, float]:
    """How well the true normal force was held: RMS, median and extremes of its error in N.

    From the first motion along the path to the last; median_n is that of the error's magnitude over
    time, overshoot_n the most above the set-point since the touch, least_n the least true force at
    work.
    """
    force = run.components(run.signals["wrench_true"][:, 3:])["normal"]
    error = force - run.signals["force_setpoint"][:, 0]
    pressed = run.working | (run.signals["phase"][:, 0] == Phase.TOUCH)
    return {
        "rms_n": float(np.sqrt(np.mean(error[run.working] ** 2))),
        "median_n": float(np.median(np.abs(error[run.working]))),
        "steady_rms_n": float(np.sqrt(np.mean(error[run.steady] ** 2))),
        "max_error_n": float(np.abs(error[run.working]).max()),
        "overshoot_n": float(max(0.0, error[pressed].max())),
        "least_n": float(force[run.working].min()),
    }


def feed_key(feed: float) -> str:
    """The key of a feed (s, one way) in the metrics: T15."""
    return f"T{feed:g}"
