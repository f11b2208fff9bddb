"""The map of condition numbers against a loop of pinocchio calls with numpy's `cond`.

Run as a script. Both sides are timed in turn, in one run; the times are medians, those of the loop
measured on a part and scaled up. Results are compared before they are timed.
"""

import statistics
import time

import numba
import numpy as np
import pinocchio

from wrenchsight.analyses.methods.planning.jcn_map import sample, slice_plane
from wrenchsight.analyses.methods.planning.jcn_map_settings import SliceConfig
from wrenchsight.models.arrays import Array
from wrenchsight.models.robot.robot import Robot

NUM_SAMPLES = 500_000
PART = 10_000  # of them, for the loop
REPETITIONS = 5


def main() -> None:
    """Prints seconds and ratio."""
    robot = Robot.load("sts_sre4_600")
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    data, frame = model.createData(), model.getFrameId("E")

    def loop(q: Array) -> tuple[Array, Array]:
        jcn, p_WE = np.empty(len(q)), np.empty((len(q), 3))
        for i, row in enumerate(q):
            J = pinocchio.computeFrameJacobian(
                model, data, row, frame, pinocchio.LOCAL_WORLD_ALIGNED
            )
            jcn[i] = np.linalg.cond(J)
            p_WE[i] = data.oMf[frame].translation
        return jcn, p_WE

    samples = sample(robot, PART, 0)
    jcn, p_WE = loop(samples.q)
    low = jcn < 1e6
    assert np.allclose(samples.jcn[low], jcn[low], rtol=1e-9, atol=0.0)
    assert np.allclose(samples.p_WE, p_WE, rtol=0.0, atol=1e-12)

    ours, processor, theirs = [], [], []
    for _ in range(REPETITIONS):
        wall, cpu = time.perf_counter(), time.process_time()
        sample(robot, NUM_SAMPLES, 0)
        ours.append(time.perf_counter() - wall)
        processor.append(time.process_time() - cpu)
        wall = time.perf_counter()
        loop(samples.q)
        theirs.append((time.perf_counter() - wall) * NUM_SAMPLES / PART)
    ratios = [b / a for a, b in zip(ours, theirs, strict=True)]
    print(
        f"{NUM_SAMPLES} random configurations, their condition numbers and places, "
        f"{numba.get_num_threads()} threads:"
    )
    print(f"  here       {statistics.median(ours):.3f} s (processor {min(processor):.3f} s)")
    print(f"  pinocchio  {statistics.median(theirs):.2f} s, with numpy.linalg.cond, one by one")
    print(f"  ratio      {statistics.median(ratios):.1f} ({min(ratios):.1f} to {max(ratios):.1f})")
    start = time.perf_counter()
    slice_plane(robot, SliceConfig(), np.array([0.8, 0.8, 1.2]))
    print(f"a slice of 41 x 41 points: {time.perf_counter() - start:.2f} s")


if __name__ == "__main__":
    main()
