"""The closed loops, free and of machining in contact: how many times real time they run.

Run as a script. All parts are in: arm, real joints, noise, force/torque sensor, controller,
estimator, truth, log of all signals, of machining also contact and process; 1 ms ticks. Times are
the processor's, not the clock's, so that other programs on the machine count less; the spread says
how much they can be trusted. What the plant takes by itself, the same contact solved by Drake
alone, is the floor. What an estimator adds to a tick is measured in turns with the same loop
without one.
"""

import gc
import itertools
import time
from dataclasses import replace

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from sample_models import sample_torque_error

from wrenchsight.diagrams.closed_loop import LoopEstimator, make_closed_loop
from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.robot_cell import RobotCell
from wrenchsight.diagrams.scenario import Scenario, load_scenario
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.machining_phases import Phase
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

STRETCH = 0.25  # s of simulated time
STRETCHES = 12
WARM_UP = 0.1  # s
TURNS, TURN_TICKS = 150, 8


def main() -> None:
    """Prints the table."""
    robot = Robot.load("sts_sre4_600")
    law = CoulombViscous(robot.truth.stiction, robot.truth.viscous, np.zeros(robot.num_joints))
    model = replace(IdentifiedModel.nominal(robot), friction=SemiParametricFriction(law))
    print(f"{'':34} {'times real time':>16} {'worst':>8} {'best':>8} {'us a tick':>10}")
    for name in ("LinearPath", "Default"):
        simulator = Simulator(make_closed_loop(load_scenario(name), robot, model).diagram)
        show(name, timed(simulator, 0.2, STRETCHES))
    added_by_estimators(robot, model)
    for name, fused in itertools.product(("Polishing", "Grinding"), (True, False)):
        machining(name, robot, model, fused)


def added_by_estimators(robot: Robot, model: IdentifiedModel) -> None:
    """Prints what estimators add to a tick of the default loop.

    Short stretches in turns, of which the lower tenth counts: other programs on the machine
    lengthen some stretches and not others.
    """
    learnt = replace(model, torque_error=sample_torque_error())
    loops = {"without an estimator": simulated_default(robot, model, None)}
    for fused in (False, True):
        form = "one block" if fused else "stages"
        for kind, known in (("plain", model), ("learnt torque error", learnt)):
            estimator = LoopEstimator(fused=fused)
            loops[f"{form}, {kind}"] = simulated_default(robot, known, estimator)
    times: dict[str, list[float]] = {name: [] for name in loops}
    gc.disable()
    for turn in range(1, TURNS + 1):
        for name, simulator in loops.items():
            before = time.process_time()
            simulator.AdvanceTo(WARM_UP + turn * TURN_TICKS * 1e-3)
            times[name].append(1e6 * (time.process_time() - before) / TURN_TICKS)
    gc.enable()
    low = {name: float(np.percentile(seconds, 10)) for name, seconds in times.items()}
    alone = low["without an estimator"]
    print(f"{'Default loop, us a tick':34} {'lower tenth':>16} {'median':>8} {'adds':>8}")
    for name, us in low.items():
        print(f"{name:34} {us:16.0f} {np.median(times[name]):8.0f} {us - alone:8.0f}")


def simulated_default(
    robot: Robot, model: IdentifiedModel, estimator: LoopEstimator | None
) -> Simulator:
    """The default loop at WARM_UP."""
    loop = make_closed_loop(load_scenario("Default"), robot, model, estimator=estimator)
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(WARM_UP)
    return simulator


def machining(name: str, robot: Robot, model: IdentifiedModel, fused: bool) -> None:
    """Prints the lines of a pass, with the estimator as one block or as its stages."""
    scenario, form = load_scenario(name), "one block" if fused else "stages"
    plan = make_machining_path(scenario, robot)
    loop = make_closed_loop(
        scenario, robot, model, motion=plan, estimator=LoopEstimator(fused=fused)
    )
    simulator = Simulator(loop.diagram)
    assert scenario.machining is not None
    phases = scenario.machining.phases
    working = phases.standoff / phases.approach_speed + phases.rise + phases.settle + 1.0
    show(f"{name}, {form}, approach", timed(simulator, 0.2, 3))
    work = timed(simulator, working, STRETCHES)
    show(f"{name}, {form}, work", work)
    context = simulator.get_context()
    alone = plant_alone(loop.cell, context, scenario)
    show(f"{name}, work, Drake's plant alone", alone)
    print(f"{'':34} {np.median(alone) / np.median(work):16.2f} of the plant's speed at work")
    _, signals = loop.logged(context)
    assert signals["phase"][-1, 0] == Phase.WORK, "the pass must still be at work"
    assert signals["fault"][-1, 0] == 0.0


def timed(simulator: Simulator, start: float, count: int) -> Array:
    """Seconds for one simulated, of as many stretches from a time on."""
    spent = []
    simulator.AdvanceTo(start)
    gc.disable()  # as `simulate` does
    for k in range(1, count + 1):
        before = time.process_time()
        simulator.AdvanceTo(start + k * STRETCH)
        spent.append(time.process_time() - before)
    gc.enable()
    return np.array(spent) / STRETCH


def show(label: str, seconds: Array) -> None:
    """Prints a line of the table; seconds of the processor for one simulated."""
    factor = 1.0 / seconds
    print(
        f"{label:34} {np.median(factor):16.2f} {factor.min():8.2f} {factor.max():8.2f} "
        f"{1e3 * np.median(seconds):10.0f}"
    )


def plant_alone(cell: RobotCell, context: Context, scenario: Scenario) -> Array:
    """Seconds for one simulated of contact, reaction forces and step at where the pass is.

    The forces on it are fixed at what they are, so that no block is asked for them; its state is
    touched, as if it were new.
    """
    plant, parts = cell.plant, cell.parts
    plant_context = plant.GetMyMutableContextFromRoot(context.Clone())
    x = plant.GetPositionsAndVelocities(plant_context)
    for pushed in (
        plant.get_actuation_input_port(parts.model_instance),
        plant.get_applied_generalized_force_input_port(),
        plant.get_applied_spatial_force_input_port(),
    ):
        pushed.FixValue(plant_context, pushed.Eval(plant_context))
    ports = (
        plant.get_contact_results_output_port(),
        plant.get_reaction_forces_output_port(),
        plant.get_generalized_acceleration_output_port(parts.model_instance),
        plant.get_generalized_contact_forces_output_port(parts.model_instance),
    )
    ticks = round(STRETCH / scenario.time_step)
    values = plant.AllocateDiscreteVariables()
    seconds = []
    for _ in range(STRETCHES):
        before = time.process_time()
        for _ in range(ticks):
            plant.SetPositionsAndVelocities(plant_context, x)
            for port in ports:
                port.Eval(plant_context)
            plant.CalcForcedDiscreteVariableUpdate(plant_context, values)
        seconds.append((time.process_time() - before) / STRETCH)
    return np.array(seconds)


if __name__ == "__main__":
    main()
