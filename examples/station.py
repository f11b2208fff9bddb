"""A scenario with Drake's model directives: what else stands in the cell.

    python station.py

`station/station.yaml` puts a crate above the floor, beside the bundled arm. The arm holds its pose
while a force pushes its tool; the crate falls. `wrenchsight simulate` takes the same file.
"""

from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator

from wrenchsight import IdentifiedModel, Robot
from wrenchsight.diagrams.closed_loop import make_closed_loop
from wrenchsight.diagrams.scenario import load_scenario

STATION = Path(__file__).parent / "station" / "station.yaml"


def main() -> tuple[np.ndarray, np.ndarray, float]:
    """Returns the wrench (6,) at the end as it is and as it is read, and the crate's height, m."""
    scenario = load_scenario(str(STATION))
    robot = Robot.load(scenario.robot)
    loop = make_closed_loop(scenario, robot, IdentifiedModel.nominal(robot))
    simulator = Simulator(loop.diagram)
    simulator.AdvanceTo(scenario.duration)
    _, signals = loop.logged(simulator.get_context())
    plant = loop.cell.plant
    crate = plant.GetBodyByName("crate")
    X_WC = crate.EvalPoseInWorld(plant.GetMyContextFromRoot(simulator.get_context()))
    return signals["wrench_true"][-1], signals["wrench"][-1], float(X_WC.translation()[2])


if __name__ == "__main__":
    true, read, height = main()
    print(
        f"pushed by {np.round(true[3:], 1)} N, read {np.round(read[3:], 1)} N; "
        f"the middle of the crate lies {1e3 * height:.0f} mm above the floor"
    )
