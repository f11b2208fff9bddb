"""What does the estimate read while the arm machines, and what force does it hold with it?

One way of the path in 15, 30 and 60 s, there and back (section 5). Each feed is machined twice:
with a force/torque sensor in the force loop, the readings compared on one and the same run, and
without any sensor, the loop closed by the estimate alone.

Readings, of the force along the feed's direction and along the surface's normal, against the true
contact force while the tool works, from the first to the last motion, turns included:

    article          semi-parametric friction, K_0 = 20, eq. 22
    coulomb_viscous  the same with the identified law alone
    ours             the estimator in the loop, which reads with what an air pass has taught
                     (`models.machining.air_pass`), wherever the feed is steady; where joints
                     start, stop or turn round, the Bayesian reading with the covariance of
                     contact-free logs
    known_friction   no estimator: the article's with the true friction taken off the torques
    sensor           no estimator: the sensor under the tool, behind its low-pass
"""

import gc
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from analyses.experiments.free_motion.identification import ROBOT
from analyses.methods.learning.arm_models import ArmModels, identify_arm
from analyses.methods.reading.force_errors import draw_signal
from analyses.methods.runs.air_pass import record_air_pass, teach
from analyses.output.figures import COLOUR, new_figure, save_figure
from analyses.study.experiment import (
    ComparisonRow,
    ExperimentContext,
    ExperimentResult,
    FigureFile,
)
from diagrams.closed_loop import make_closed_loop
from diagrams.machining import longest_duration, make_machining_path, view_of
from diagrams.pages.run_page import make_meshcat, start_recording, write_recording
from diagrams.scenario import Scenario, load_scenario
from models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from models.estimation.momentum_observer import MomentumObserverConfig
from models.estimation.wrench import WrenchReconstructionConfig
from models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from models.machining.air_pass import TaughtTorque, raised_motion
from models.machining.machining_path import MachiningPath
from models.machining.machining_phases import FAULT_SENTENCES, Fault, Phase
from models.robot.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
ProgressCallback = Callable[[float, str], None]

LAW, PLAIN = "semi-parametric", "coulomb-viscous"
FEEDS = (15.0, 30.0, 60.0)  # s, one way
QUICK_SHARE = 1.0 / 15.0  # of these
K_0 = 20.0  # 1/s, the article's
FEEDBACKS = ("sensor", "estimate")
COMPONENTS = ("tangential", "normal")
READINGS = ("article", "coulomb_viscous", "ours", "known_friction", "sensor")
_AIR_SEED = 1000  # apart from the runs' own
_STRETCH = 0.5  # s between two reports of progress
_FPS = 12.0  # of the recording
_METRES_PER_NEWTON = 0.008
_LOGGED = (
    "q",
    "v",
    "current",
    "wrench",
    "wrench_true",
    "ft_wrench",
    "tau_f_true",
    "phase",
    "fault",
    "progress",
    "feed_time",
    "force_setpoint",
)


@dataclass(frozen=True)
class MachiningTask:
    """What a study is about.

    Attributes:
        scenario: bundled, with the sensor in its loop.
        sensorless: bundled, the same without.
        component: of the force, which the article shows: tangential or normal.
        correlation, rmse_n: the article's, by feed.
        figure: of the article.
    """

    scenario: str
    sensorless: str
    component: str
    correlation: tuple[float, float, float]
    rmse_n: tuple[float, float, float]
    figure: str


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


def learn(
    scenario: Scenario,
    models: ArmModels,
    plan: MachiningPath,
    seed: int,
    progress: ProgressCallback = lambda fraction, what: None,
) -> TaughtTorque:
    """What an air pass of the scenario teaches the estimator of LAW.

    Args:
        scenario: with machining and an air_pass.
        models: what the estimator knows.
        plan: of the scenario.
        seed: of the air pass's noise.
        progress: told the share done.
    """
    robot = models.robot
    assert scenario.machining is not None
    motion = raised_motion(robot, plan.trajectory, scenario.machining.air_pass)
    air = record_air_pass(scenario, robot, motion, seed, progress)
    return teach(air, motion, plan, robot, models.models[LAW], scenario.estimator)


def run_machining(
    scenario: Scenario,
    models: ArmModels,
    plan: MachiningPath,
    taught: TaughtTorque | None = None,
    recording: Path | None = None,
    progress: ProgressCallback = lambda fraction, what: None,
) -> MachiningRun:
    """Machines, from the approach to the lift.

    Args:
        scenario: with machining.
        models: what controller and estimator know; their robot has its simulated truth.
        plan: of the scenario.
        taught: by an air pass along the plan.
        recording: where to write a Meshcat recording.
        progress: told the share done.
    """
    machining, robot = scenario.machining, models.robot
    assert machining is not None
    scenario = replace(
        scenario,
        duration=longest_duration(plan, machining.phases),
        recording=replace(scenario.recording, fps=_FPS, metres_per_newton=_METRES_PER_NEWTON),
    )
    meshcat: Meshcat | None = None
    if recording is not None:
        middle = plan.path.num_samples // 2
        meshcat = make_meshcat(robot, plan.path.p_WS[middle], view_of(plan.path))
    loop = make_closed_loop(
        scenario,
        robot,
        models.models[LAW],
        meshcat,
        also_log=("tau_f_true",),
        machining_path=plan,
        log_only=_LOGGED,
        taught=taught,
    )
    simulator = Simulator(loop.diagram)
    simulator.Initialize()
    if meshcat is not None:
        start_recording(meshcat, _FPS)
    count = max(1, round(scenario.duration / _STRETCH))
    collecting = gc.isenabled()
    gc.disable()  # see analyses.methods.runs.simulation
    try:
        for k in range(count):
            simulator.AdvanceTo(scenario.duration * (k + 1) / count)
            progress((k + 1) / count, "machining")
    finally:
        if collecting:
            gc.enable()
    if meshcat is not None and recording is not None:
        title = f"{scenario.description} One way in {machining.one_way:g} s."
        write_recording(meshcat, recording, title)
    t, signals = loop.logged(simulator.get_context())
    return MachiningRun(plan, t, signals)


def read_all(run: MachiningRun, models: ArmModels) -> dict[str, dict[str, Array]]:
    """(T,) N by reading (READINGS) and component."""
    robot, signals = models.robot, run.signals
    speed = float(np.abs(run.plan.trajectory.v).max())
    inverse = WrenchReconstructionConfig("inverse")
    bayesian = models.estimator(LAW, speed, K_0, WrenchReconstructionConfig("bayesian"))
    config = WrenchEstimatorConfig(MomentumObserverConfig([K_0]), inverse)
    nothing = SemiParametricFriction(CoulombViscous.zero(robot.num_joints))
    free = signals["current"] - signals["tau_f_true"] / (
        robot.torque_per_ampere * robot.current_sign
    )

    def read(estimator: WrenchEstimator, current: Array) -> Array:
        state = estimator.initial_state()
        return estimator.run(state, signals["q"], signals["v"], current).wrench[:, 3:]

    law, plain = models.models[LAW], models.models[PLAIN]
    forces = {
        "article": read(WrenchEstimator(robot, law, config), signals["current"]),
        "coulomb_viscous": read(WrenchEstimator(robot, plain, config), signals["current"]),
        "ours": np.where(
            run.steady[:, np.newaxis],
            signals["wrench"][:, 3:],
            read(bayesian, signals["current"]),
        ),
        "known_friction": read(
            WrenchEstimator(robot, replace(law, friction=nothing), config), free
        ),
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


def regulation(run: MachiningRun) -> dict[str, float]:
    """How well the true normal force was held: RMS and extremes of its error in N.

    From the first motion along the path to the last; overshoot_n is the most above the set-point
    since the touch, least_n the least true force at work.
    """
    force = run.components(run.signals["wrench_true"][:, 3:])["normal"]
    error = force - run.signals["force_setpoint"][:, 0]
    pressed = run.working | (run.signals["phase"][:, 0] == Phase.TOUCH)
    return {
        "rms_n": float(np.sqrt(np.mean(error[run.working] ** 2))),
        "steady_rms_n": float(np.sqrt(np.mean(error[run.steady] ** 2))),
        "max_error_n": float(np.abs(error[run.working]).max()),
        "overshoot_n": float(max(0.0, error[pressed].max())),
        "least_n": float(force[run.working].min()),
    }


def study_machining(context: ExperimentContext, task: MachiningTask) -> ExperimentResult:
    """The experiments `polishing` and `grinding` of `study`."""
    robot = Robot.load(ROBOT)
    models = identify_arm(
        robot, context.seed, context.quick, lambda s, what: context.progress(0.1 * s, what)
    )
    scenarios = {
        feedback: load_scenario(name)
        for feedback, name in zip(FEEDBACKS, (task.scenario, task.sensorless), strict=True)
    }
    total = 2.0 * sum(FEEDS)
    done = 0.0
    metrics: dict[str, Any] = {}
    shown: dict[float, tuple[MachiningRun, dict[str, dict[str, Array]]]] = {}
    without: dict[float, MachiningRun] = {}
    picture = context.out / "recording.html"
    for feed in FEEDS:
        one_way = feed * (QUICK_SHARE if context.quick else 1.0)
        runs: dict[str, MachiningRun] = {}
        plan, taught = None, None
        for feedback, scenario in scenarios.items():
            assert scenario.machining is not None
            own = replace(
                scenario,
                seed=scenario.seed + context.seed,
                machining=replace(scenario.machining, one_way=one_way),
            )

            def told(share: float, what: str, start: float = done, feed: float = feed) -> None:
                place = (start + share * feed) / total
                context.progress(0.1 + 0.85 * place, f"{what}, {feed:g} s one way")

            if plan is None or taught is None:  # the same for both
                plan = make_machining_path(own, robot)
                taught = learn(own, models, plan, _AIR_SEED + context.seed)
            with_picture = feedback == "estimate" and feed == FEEDS[0]
            runs[feedback] = run_machining(
                own, models, plan, taught, picture if with_picture else None, told
            )
            done += feed
            if not runs[feedback].steady.any():
                why = FAULT_SENTENCES.get(runs[feedback].fault, "no steady feed")
                raise RuntimeError(f"{feedback} feedback, {feed:g} s: the pass ended early: {why}")
        readings = read_all(runs["sensor"], models)
        metrics[_key(feed)] = feed_metrics(task, runs, readings)
        shown[feed], without[feed] = (runs["sensor"], readings), runs["estimate"]
    metrics |= over_feeds(metrics)
    metrics["sources"] = sources(models, {feed: run for feed, (run, _) in shown.items()})
    context.progress(0.96, "figures")
    return ExperimentResult(
        metrics=metrics,
        figures=_figures(context, task, shown, without, metrics),
        recordings=[
            FigureFile(
                Path("recording.html"),
                f"The arm at work without a sensor, one way in {FEEDS[0]:g} s: true force black, "
                "estimated force blue.",
            )
        ],
        comparison=_comparison(task),
        notes=_notes(task, metrics),
        configuration={"scenarios": scenarios, "feeds_s": FEEDS, "K_0": K_0},
    )


def _key(feed: float) -> str:
    return f"T{feed:g}"


def feed_metrics(
    task: MachiningTask,
    runs: Mapping[str, MachiningRun],
    readings: Mapping[str, Mapping[str, Array]],
) -> dict[str, Any]:
    """All figures of one feed: first the article's method on the article's component."""
    run = runs["sensor"]
    truth = run.components(run.signals["wrench_true"][:, 3:])
    working, steady = run.working, run.steady
    out: dict[str, Any] = {}
    for name in READINGS:
        by_component = {
            component: errors(readings[name][component][working], truth[component][working])
            for component in COMPONENTS
        }
        while_steady = errors(readings[name][task.component][steady], truth[task.component][steady])
        out[name] = by_component[task.component] | {"steady": while_steady} | by_component
    for key in ("correlation", "rmse_n"):
        out[key] = out["article"][key]
    out["steady_share"] = float(steady.sum() / working.sum())
    out["regulation"] = {feedback: regulation(own) for feedback, own in runs.items()}
    out["fault"] = {
        feedback: FAULT_SENTENCES.get(own.fault, "none") for feedback, own in runs.items()
    }
    return out


def sources(models: ArmModels, runs: Mapping[float, MachiningRun]) -> dict[str, Any]:
    """What makes a feed harder than another: friction that the law misses, by feed.

    Speeds are planned; friction errors are those of the law at the measured speed, joint by joint,
    over the steady feed and over the rest of the work (starts, stops, turns).
    """
    law = models.models[LAW].friction.velocity_law
    out: dict[str, Any] = {}
    for feed, run in runs.items():
        error = run.signals["tau_f_true"] - law.torque(run.signals["v"])
        planned = np.abs(run.plan.trajectory.v[run.plan.steady == 1.0])
        parts = {"steady": run.steady, "unsteady": run.working & ~run.steady}
        out[_key(feed)] = {
            "mean_joint_speed_rad_per_s": planned.mean(axis=0).tolist(),
            "mean_jcn": float(
                np.mean(models.robot.chain.condition_number(run.signals["q"][run.working][::50]))
            ),
            **{
                f"{name}_friction_error_nm": np.sqrt(np.mean(error[rows] ** 2, axis=0)).tolist()
                for name, rows in parts.items()
            },
        }
    return out


def over_feeds(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """The figures that are compared, as lists over the feeds."""

    def collect(*path: str) -> list[float]:
        values = []
        for feed in FEEDS:
            value: Any = metrics[_key(feed)]
            for part in path:
                value = value[part]
            values.append(value)
        return values

    return {
        name: {"correlation": collect(name, "correlation"), "rmse_n": collect(name, "rmse_n")}
        for name in READINGS
    } | {
        "regulation": {
            feedback: {"rms_n": collect("regulation", feedback, "rms_n")} for feedback in FEEDBACKS
        }
    }


def _comparison(task: MachiningTask) -> list[ComparisonRow]:
    feeds = ", ".join(f"{feed:g}" for feed in FEEDS)
    force = f"{task.component.capitalize()} force, one way in {feeds} s"
    ours = "reads with what a pass through the air has taught"
    return [
        ComparisonRow(f"{force}: correlation", "article.correlation", "", list(task.correlation)),
        ComparisonRow(f"{force}: RMSE", "article.rmse_n", "N", list(task.rmse_n)),
        ComparisonRow(f"{force}: correlation, ours", "ours.correlation", "", None, ours),
        ComparisonRow(f"{force}: RMSE, ours", "ours.rmse_n", "N", None, ours),
        ComparisonRow(
            f"True normal force held without a sensor, {feeds} s: RMS error",
            "regulation.estimate.rms_n",
            "N",
            None,
        ),
        ComparisonRow(
            f"True normal force held with a sensor, {feeds} s: RMS error",
            "regulation.sensor.rms_n",
            "N",
            None,
        ),
    ]


def _row(metrics: Mapping[str, Any], path: str, digits: int = 2) -> str:
    values = []
    for feed in FEEDS:
        value: Any = metrics[_key(feed)]
        for part in path.split("."):
            value = value[part]
        values.append(f"{value:.{digits}f}")
    return ", ".join(values)


def _share(metrics: Mapping[str, Any], feed: float) -> str:
    """Percent of the work in which the feed is not steady."""
    return f"{100.0 * (1.0 - metrics[_key(feed)]['steady_share']):.1f}"


def _notes(task: MachiningTask, metrics: Mapping[str, Any]) -> list[str]:
    rmse = [metrics[_key(feed)]["rmse_n"] for feed in FEEDS]
    slowest, fastest = metrics["sources"][_key(FEEDS[-1])], metrics["sources"][_key(FEEDS[0])]

    def worst(part: Mapping[str, Any]) -> str:
        return " ".join(f"{value:.2f}" for value in part["steady_friction_error_nm"])

    growth = np.subtract(slowest["steady_friction_error_nm"], fastest["steady_friction_error_nm"])
    grown = int(np.argmax(growth)) + 1
    faults = sorted(
        {fault for feed in FEEDS for fault in metrics[_key(feed)]["fault"].values()} - {"none"}
    )
    return [
        f"{task.component.capitalize()} force by the article's method (semi-parametric friction, "
        f"K_0 = {K_0:g}, eq. 22), one way in {', '.join(f'{feed:g}' for feed in FEEDS)} s: RMSE "
        f"{_row(metrics, 'rmse_n')} N; with Coulomb-viscous friction alone "
        f"{_row(metrics, 'coulomb_viscous.rmse_n')} N; ours {_row(metrics, 'ours.rmse_n')} N; with "
        f"the true friction known {_row(metrics, 'known_friction.rmse_n')} N. While the feed is "
        f"steady, the article's {_row(metrics, 'article.steady.rmse_n')} N, ours "
        f"{_row(metrics, 'ours.steady.rmse_n')} N.",
        "Ours reads with what a pass through the air has taught, just above the surface along the "
        "same motion: what the observer reads there is the model's error and is taken off (eq. 4, "
        "on the observer's output). What contact itself changes is left: friction that grows with "
        "the load.",
        "Force control without a sensor holds the true normal force within "
        f"{_row(metrics, 'regulation.estimate.rms_n')} N RMS "
        f"({_row(metrics, 'regulation.sensor.rms_n')} N with the sensor), "
        f"{_row(metrics, 'regulation.estimate.steady_rms_n')} N while the feed is steady. The most "
        f"above the set-point is {_row(metrics, 'regulation.estimate.overshoot_n', 1)} N "
        f"({_row(metrics, 'regulation.sensor.overshoot_n', 1)} N with the sensor): joints come to "
        "rest at the touch, where no current tells the force, so that the press is fed forward.",
        f"In the article slower feeds are harder to read. Here the article's method errs by "
        f"{rmse[-1] / rmse[0]:.2f} times as much in {FEEDS[-1]:g} s as in {FEEDS[0]:g} s. Two "
        "things work against each other. Starts, stops and turns, where joints rest and hide force "
        f"within their stiction, take {_share(metrics, FEEDS[0])} % of the time in {FEEDS[0]:g} s "
        f"and {_share(metrics, FEEDS[-1])} % in {FEEDS[-1]:g} s. Over the steady feed the error "
        "goes from "
        f"{metrics[_key(FEEDS[0])]['article']['steady']['rmse_n']:.2f} to "
        f"{metrics[_key(FEEDS[-1])]['article']['steady']['rmse_n']:.2f} N: friction at joints 1 to "
        f"6 errs by {worst(fastest)} N m at the fastest feed and {worst(slowest)} N m at the "
        f"slowest. It grows most at joint {grown}, of "
        f"{1e3 * slowest['mean_joint_speed_rad_per_s'][grown - 1]:.1f} mrad/s in the mean at the "
        "slowest: the slower a joint, the longer it stays where it sticks.",
        "The workpiece stands where the article's reading has the least predicted sd "
        "(`analyses.methods.planning.machining_placement`), which takes the identified model, the "
        "planned speeds and contact-free logs.",
        *(f"A pass was broken off: {fault}." for fault in faults),
    ]


def force_figure(
    task: MachiningTask,
    shown: Mapping[float, tuple[MachiningRun, Mapping[str, Mapping[str, Array]]]],
    component: str,
) -> "Figure":
    """True, measured and estimated force at work, a panel a feed (the article's Figs. 25, 27)."""
    figure, axes = new_figure(len(shown), 1, height=2.5 * len(shown) + 0.6)
    for panel, (feed, (run, readings)) in zip(axes[:, 0], shown.items(), strict=True):
        rows = run.working
        t = run.t[rows] - run.t[rows][0]
        truth = run.components(run.signals["wrench_true"][:, 3:])[component][rows]
        panel.plot(t, readings["sensor"][component][rows], color="#bdbdbd", lw=4.0, label="sensor")
        draw_signal(
            panel, t, readings["article"][component][rows], COLOUR["article"], "article's method"
        )
        draw_signal(panel, t, readings["ours"][component][rows], COLOUR["estimate"], "ours")
        panel.plot(t, truth, color=COLOUR["truth"], lw=0.8, label="true")
        low, high = truth.min(), truth.max()
        room = 0.35 * (high - low) + 6.0
        panel.set_ylim(low - room, high + room)
        panel.set_ylabel(f"{component} force [N]")
        panel.set_title(f"one way in {feed:g} s")
    axes[-1, 0].set_xlabel("time since the feed started [s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def regulation_figure(
    with_sensor: Mapping[float, MachiningRun], without: Mapping[float, MachiningRun]
) -> "Figure":
    """The true normal force from touch to lift, force control with and without a sensor."""
    figure, axes = new_figure(len(without), 1, height=2.5 * len(without) + 0.6)
    for panel, feed in zip(axes[:, 0], without, strict=True):
        for run, colour, label in (
            (without[feed], COLOUR["estimate"], "held by the estimate"),
            (with_sensor[feed], COLOUR["after"], "held by a sensor"),
        ):
            phase = run.signals["phase"][:, 0]
            rows = (phase >= Phase.TOUCH) & (phase <= Phase.RELEASE)
            start = run.t[run.working][0]
            force = run.components(run.signals["wrench_true"][:, 3:])["normal"]
            draw_signal(panel, run.t[rows] - start, force[rows], colour, label)
        setpoint = run.signals["force_setpoint"][rows, 0]
        panel.plot(run.t[rows] - start, setpoint, color=COLOUR["truth"], lw=0.8, label="set-point")
        panel.set_ylabel("normal force [N]")
        panel.set_ylim(bottom=0.0)
        panel.set_title(f"one way in {feed:g} s")
    axes[-1, 0].set_xlabel("time since the feed started [s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def feed_figure(task: MachiningTask, metrics: Mapping[str, Any]) -> "Figure":
    """RMSE over the feed's duration: is slower harder? And how the force was held."""
    figure, axes = new_figure(1, 2, height=4.2)
    reading, held = axes[0]
    reading.plot(
        FEEDS, task.rmse_n, "s--", color=COLOUR["reference"], label="printed in the article"
    )
    for key, colour, label in (
        ("article", COLOUR["article"], "article's method, here"),
        ("ours", COLOUR["estimate"], "ours"),
        ("known_friction", COLOUR["truth"], "true friction known"),
    ):
        values = [metrics[_key(feed)][key]["rmse_n"] for feed in FEEDS]
        reading.plot(FEEDS, values, "o-", color=colour, label=label)
    steady = [metrics[_key(feed)]["article"]["steady"]["rmse_n"] for feed in FEEDS]
    reading.plot(FEEDS, steady, "o:", color=COLOUR["article"], label="article's, steady feed")
    reading.set_title(f"{task.component} force read")
    for feedback, colour, label in (
        ("estimate", COLOUR["estimate"], "held by the estimate"),
        ("sensor", COLOUR["after"], "held by a sensor"),
    ):
        values = [metrics[_key(feed)]["regulation"][feedback]["rms_n"] for feed in FEEDS]
        held.plot(FEEDS, values, "o-", color=colour, label=label)
    held.set_title("normal force held")
    for panel in (reading, held):
        panel.set_xlabel("one way in [s]")
        panel.set_ylabel("RMS error [N]")
        panel.set_ylim(bottom=0.0)
        panel.set_xticks(FEEDS)
    entries = [panel.get_legend_handles_labels() for panel in (reading, held)]
    handles = [handle for entry in entries for handle in entry[0]]
    labels = [label for entry in entries for label in entry[1]]
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _figures(
    context: ExperimentContext,
    task: MachiningTask,
    shown: Mapping[float, tuple[MachiningRun, Mapping[str, Mapping[str, Array]]]],
    without: Mapping[float, MachiningRun],
    metrics: Mapping[str, Any],
) -> list[FigureFile]:
    other = COMPONENTS[1 - COMPONENTS.index(task.component)]
    with_sensor = {feed: run for feed, (run, _) in shown.items()}
    files = []
    for stem, figure, caption in (
        (
            "forces",
            force_figure(task, shown, task.component),
            f"{task.component.capitalize()} force at work, true, measured and estimated "
            f"({task.figure}). At the ends joints rest or turn round, and friction hides the "
            "force; the highest peaks of the readings are cut off.",
        ),
        (
            f"{other}",
            force_figure(task, shown, other),
            f"{other.capitalize()} force, the same runs.",
        ),
        (
            "regulation",
            regulation_figure(with_sensor, without),
            "True normal force, held with a sensor in the loop and without one.",
        ),
        (
            "feeds",
            feed_figure(task, metrics),
            "Is a slower feed harder? Errors of reading and of holding the force.",
        ),
    ):
        path = Path("figures") / f"{stem}.png"
        save_figure(figure, context.out / path)
        files.append(FigureFile(path, caption))
    return files
