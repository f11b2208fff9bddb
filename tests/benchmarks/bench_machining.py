"""The closed loops of machining in contact: how many times faster than real time they run.

Run as a script. All blocks are in: arm with brakes and contact, friction, noise, process, force/
torque sensor, reference, controller, estimator, truth, log of all signals; 1 ms ticks. Several
stretches of the same pass are timed: the spread says how much the machine can be trusted.
"""

import gc
import time
from dataclasses import replace

import numpy as np
from pydrake.systems.analysis import Simulator

from diagrams.closed_loop import make_closed_loop
from diagrams.machining import make_machining_path
from diagrams.scenario import load_scenario
from models.friction.velocity_friction import CoulombViscous, SemiParametricFriction
from models.identification.identified_model import IdentifiedModel
from models.machining.machining_phases import Phase
from models.robot.robot import Robot

STRETCH = 1.5  # s of simulated time
STRETCHES = 4


def main() -> None:
    """Prints the table."""
    robot = Robot.load("sts_sre4_600")
    law = CoulombViscous(robot.truth.stiction, robot.truth.viscous, np.zeros(robot.num_joints))
    model = replace(IdentifiedModel.nominal(robot), friction=SemiParametricFriction(law))
    print(f"{'':20} {'times real time':>16} {'worst':>8} {'us a tick':>12}")
    for name in ("Polishing", "Grinding"):
        scenario = load_scenario(name)
        plan = make_machining_path(scenario, robot)
        loop = make_closed_loop(scenario, robot, model, machining_path=plan, fused=True)
        simulator = Simulator(loop.diagram)
        assert scenario.machining is not None
        phases = scenario.machining.phases
        working = phases.standoff / phases.approach_speed + phases.rise + phases.settle + 1.0
        seconds: dict[str, list[float]] = {"approach": [], "work": []}
        gc.disable()  # as `simulate` does
        for part, start in (("approach", 0.2), ("work", working)):
            simulator.AdvanceTo(start)
            for k in range(1 if part == "approach" else STRETCHES):
                before = time.perf_counter()
                simulator.AdvanceTo(start + (k + 1) * STRETCH)
                seconds[part].append(time.perf_counter() - before)
        gc.enable()
        _, signals = loop.logged(simulator.get_context())
        assert signals["phase"][-1, 0] == Phase.WORK, "the pass must still be at work"
        assert signals["fault"][-1, 0] == 0.0
        for part, spent in seconds.items():
            factor = STRETCH / np.array(spent)
            print(
                f"{name + ', ' + part:20} {np.median(factor):16.2f} {factor.min():8.2f} "
                f"{1e6 * scenario.time_step / np.median(factor):12.0f}"
            )


if __name__ == "__main__":
    main()
