"""How long the searches take that learn an arm: an excitation, and friction networks.

Run as a script. To be reached on two cores: an excitation within a minute, the networks of six
joints within 20 s of the processor.
"""

import time

import numpy as np

from wrenchsight.analyses.methods.excite.excitation import excite
from wrenchsight.analyses.methods.identify.friction_training import train_networks
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.robot.robot import Robot

NUM_SAMPLES = 3000  # of friction, each joint


def main() -> None:
    """Prints seconds."""
    robot = Robot.load("sts_sre4_600")
    excite(robot)  # compiles the kernels
    start = time.perf_counter()
    result = excite(robot)
    seconds = time.perf_counter() - start
    print(f"an excitation of {robot.name}: {seconds:.1f} s, {result.evaluations} evaluations")
    n = robot.num_joints
    v = np.random.default_rng(0).uniform(-0.3, 0.3, (NUM_SAMPLES, n))
    law = CoulombViscous(np.ones(n), np.ones(n), np.zeros(n))
    start = time.process_time()
    trained = train_networks(v, np.sign(v) * (2.0 - v**2), law, v_crit=np.full(n, 0.3))
    seconds = time.process_time() - start
    print(f"networks of {n} joints: {seconds:.1f} s of the processor, {max(trained.steps)} steps")


if __name__ == "__main__":
    main()
