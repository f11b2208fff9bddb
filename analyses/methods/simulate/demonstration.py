"""A robot, a push at its tool, and the wrench that its currents show: a first look, in a minute.

The simulated UR10e swings its joints under its tracking controller while a hand pushes. Encoders
and currents are logged, and the log is read as `estimate` reads one. Controller and estimator know
`known_model`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pydrake.common.value import AbstractValue

from wrenchsight.analyses.methods.simulate.advance import run_loop
from wrenchsight.analyses.methods.simulate.simulation import known_model
from wrenchsight.analyses.output.compilation import are_compiled, compile_side_by_side
from wrenchsight.analyses.output.estimator_compilation import ESTIMATOR_PARTS
from wrenchsight.analyses.output.figures import COLOUR, fill_band, legend_below, new_figure, shade
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.diagrams.closed_loop import LogRequest, make_closed_loop
from wrenchsight.diagrams.pages.arm_picture import ArmPicture
from wrenchsight.diagrams.pages.run_page import (
    FORCE_ARROWS,
    make_meshcat,
    start_animation,
    write_page,
)
from wrenchsight.diagrams.scenario import Scenario, load_scenario
from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimator
from wrenchsight.models.estimation.wrench_reading import judge_rows
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95
from wrenchsight.models.signals.root_mean_square import rms
from wrenchsight.models.truth.arm_tick import arm_drives
from wrenchsight.systems.wrench_arrows import WrenchArrows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENARIO: Final = "Push"
FORCE_AXES: Final = ("fx", "fy", "fz")
_TICKS_TO_COMPILE: Final = 3
_PROGRESS_PERIOD: Final = 0.25  # s between two reports of progress


@dataclass(frozen=True, eq=False)
class Demonstration:
    """A push as it was, and as it was read; T samples.

    Attributes:
        t: (T,) s.
        force_true, force, sd: (T, 3) N, at E in axes of W; sd as stated for `force`.
        valid: (T,) whether a reading may be used.
        files: the figure and the page.
    """

    t: Array
    force_true: Array
    force: Array
    sd: Array
    valid: Flags
    files: tuple[Path, ...] = ()

    def metrics(self) -> dict[str, Any]:
        """Share of valid readings; of these the RMSE and the share in the 95 % band, by axis."""
        error = (self.force - self.force_true)[self.valid]
        inside = np.abs(error) <= SIGMA_95 * self.sd[self.valid]
        return {
            "valid_share_pct": 100.0 * float(self.valid.mean()),
            "largest_push_n": float(np.linalg.norm(self.force_true, axis=1).max()),
            "rmse_n": rms(error).tolist(),
            "inside_95_pct": (100.0 * inside.mean(axis=0)).tolist(),
        }

    def figure(self) -> "Figure":
        """True and estimated force with the stated 95 % band."""
        figure, axes = new_figure(3, 1, share_x=True)
        colour, band = COLOUR["estimate"], SIGMA_95 * self.sd
        for k, axis in enumerate(FORCE_AXES):
            panel: Any = axes[k, 0]
            fill_band(panel, self.t, self.force[:, k], band[:, k])
            panel.plot(self.t, self.force_true[:, k], color=COLOUR["truth"], label="true")
            panel.plot(self.t, self.force[:, k], color=colour, lw=1.0, label="estimated")
            shade(panel, self.t, ~self.valid, "invalid", "not valid")
            panel.set_ylabel(f"{axis} [N]")
        axes[2, 0].set_xlabel("time [s]")
        legend_below(figure, axes[0, 0])
        figure.suptitle("Force of the environment on the robot, at E in axes of W")
        return figure


def demonstrate(
    out: Path, progress: ProgressCallback = lambda fraction, message: None
) -> Demonstration:
    """Simulates the push, reads it, and writes metrics.json, figures/force.png and push.html.

    Raises:
        InputError: `out` cannot be written, or holds what this command did not write.
    """
    with result_folder(out, "demo") as folder:
        if not are_compiled((arm_drives, judge_rows)):
            parts = {"simulated arm": _compile_arm, **ESTIMATOR_PARTS}
            compile_side_by_side(parts, lambda share, words: progress(0.6 * share, words))
        scenario = load_scenario(SCENARIO)
        robot = Robot.load(scenario.robot)
        model = known_model(robot, scenario)
        progress(0.6, "simulating")  # the first 0.6 are compilation, where there is any
        t, signals = _logged(
            scenario, robot, model, lambda share: progress(0.6 + 0.2 * share, "simulating")
        )
        progress(0.8, "reading the wrench")
        batch = _read(scenario, robot, model, signals)
        result = Demonstration(
            t=t,
            force_true=signals["wrench_true"][:, 3:],
            force=batch.wrench[:, 3:],
            sd=batch.standard_deviation[:, 3:],
            valid=batch.valid,
        )
        progress(0.85, "drawing")
        folder.write_json("metrics.json", result.metrics())
        folder.write_figure("force", result.figure())
        _write_page(folder / "push.html", scenario, robot, t, signals, batch)
    # They were written into a folder beside `out`, whose files are in `out` since the block's end.
    return replace(result, files=(out / "figures" / "force.png", out / "push.html"))


def _logged(
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel,
    report: Callable[[float], None] = lambda share: None,
) -> tuple[Array, dict[str, Array]]:
    """Times (T,) in s and signals (T, size): q, v, current and wrench_true."""
    request = LogRequest(only=("q", "v", "current", "wrench_true"))
    loop = make_closed_loop(scenario, robot, model, estimator=None, log=request)
    return run_loop(loop, scenario.duration, _PROGRESS_PERIOD, report)


def _read(
    scenario: Scenario, robot: Robot, model: IdentifiedModel, signals: dict[str, Array]
) -> EstimateBatch:
    config = scenario.estimator.with_time_step(scenario.time_step)
    estimator = WrenchEstimator(robot, model, config)
    state = estimator.initial_state()
    return estimator.run(state, signals["q"], signals["v"], signals["current"])


def _compile_arm() -> None:
    """Compiles what `_logged` calls."""
    scenario = load_scenario(SCENARIO)
    scenario.duration = _TICKS_TO_COMPILE * scenario.time_step
    robot = Robot.load(scenario.robot)
    _logged(scenario, robot, known_model(robot, scenario))


def _write_page(
    path: Path,
    scenario: Scenario,
    robot: Robot,
    t: Array,
    signals: dict[str, Array],
    batch: EstimateBatch,
) -> None:
    """Writes the arm in motion, with the true and the estimated force as arrows at its tool.

    Args:
        t: (T,) s.
        signals: (T, size): q and wrench_true are read.
        batch: the estimate of these T samples.
    """
    fps = scenario.recording.fps
    rows = np.searchsorted(t, np.arange(0.0, t[-1], 1.0 / fps))  # one a frame of the page
    q = signals["q"][rows]
    p_WE = robot.chain.pose(q)[1]
    meshcat = make_meshcat(robot, p_WE)
    picture = ArmPicture(robot, meshcat, fps)
    arrows = WrenchArrows(meshcat, FORCE_ARROWS, fps, scenario.recording.metres_per_newton)
    context = arrows.CreateDefaultContext()
    start_animation(meshcat, fps)
    for k, row in enumerate(rows.tolist()):
        picture.show(q[k], float(t[row]))
        context.SetTime(t[row])
        # In the place of the RigidBodyTerms: p_WE is all that the arrows read of them. A Value of
        # the port's type, `object`, which `Make` of the namespace itself would not give.
        terms = AbstractValue.Make(object())
        terms.set_value(SimpleNamespace(p_WE=p_WE[k]))
        arrows.GetInputPort("terms").FixValue(context, terms)
        arrows.GetInputPort("force true").FixValue(context, signals["wrench_true"][row])
        arrows.GetInputPort("force estimated").FixValue(context, batch.wrench[row])
        arrows.ForcedPublish(context)
    write_page(meshcat, path, "A push at the tool of a UR10e")
