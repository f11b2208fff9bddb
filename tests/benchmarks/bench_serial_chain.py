"""The rigid-body kernels, and the map of condition numbers, against a loop of pinocchio calls.

Run as a script. Both sides of a ratio are timed in turn, in one run; the times are medians. Results
are compared before they are timed.
"""

import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numba
import numpy as np
import pinocchio

from wrenchsight.analyses.methods.jcn_map.jcn_map import sample, slice_plane
from wrenchsight.analyses.methods.jcn_map.jcn_map_settings import SliceConfig
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS, all_terms, observer_terms
from wrenchsight.models.rigid_body.conditioning import condition_number
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

REPETITIONS = 5


class PinocchioArm:
    """The bundled arm in pinocchio: what someone would write without our kernels."""

    def __init__(self, robot: Robot) -> None:
        self.model = pinocchio.buildModelFromXML(robot.urdf_text)
        self.model.armature = np.array(robot.chain.reflected_inertia)
        self.data = self.model.createData()
        self.frame = self.model.getFrameId("E")

    def momentum_terms(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        model, data = self.model, self.data
        M = pinocchio.crba(model, data, q)  # from Python both triangles are filled
        C = pinocchio.computeCoriolisMatrix(model, data, q, v)
        return M @ v, C.T @ v, pinocchio.computeGeneralizedGravity(model, data, q).copy()

    def jacobian(self, q: Array) -> Array:
        model, data = self.model, self.data
        return pinocchio.computeFrameJacobian(
            model, data, q, self.frame, pinocchio.LOCAL_WORLD_ALIGNED
        )

    def observer_terms(self, q: Array, v: Array) -> tuple[Array, ...]:
        J = self.jacobian(q)
        placement = self.data.oMf[self.frame]
        return (*self.momentum_terms(q, v), J, placement.rotation, placement.translation)

    def terms(self, q: Array, v: Array) -> tuple[Array, ...]:
        remaining_terms = self.observer_terms(q, v)
        return (*remaining_terms, self.data.C @ v, self.data.M.copy(), remaining_terms[3] @ v)

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array) -> Array:
        return pinocchio.rnea(self.model, self.data, q, v, vdot)

    def regressor(self, q: Array, v: Array, vdot: Array) -> Array:
        return pinocchio.computeJointTorqueRegressor(self.model, self.data, q, v, vdot)


def seconds(call: Callable[[], Any], calls: int) -> float:
    start = time.perf_counter()
    for _ in range(calls):
        call()
    return (time.perf_counter() - start) / calls


def compare(
    name: str,
    ours: Callable[[], Any],
    theirs: Callable[[], Any],
    calls: int = 1,
    scale: float = 1.0,
) -> None:
    """Prints one row; `scale` is how many times their measured part the whole job is."""
    ours()
    theirs()
    a, b = [], []
    for _ in range(REPETITIONS):
        a.append(seconds(ours, calls))
        b.append(scale * seconds(theirs, calls))
    ratios = [y / x for x, y in zip(a, b, strict=True)]
    unit, factor = ("us", 1e6) if statistics.median(a) < 1e-3 else ("s ", 1.0)
    print(
        f"{name:52} {factor * statistics.median(a):9.3g} {unit} "
        f"{factor * statistics.median(b):9.3g} {unit} {statistics.median(ratios):7.1f} x"
        f"   ({min(ratios):.1f} to {max(ratios):.1f})"
    )


def preallocated(chain: SerialChain) -> list[Array]:
    """Outputs of `observer_terms` and its scratch memory."""
    n = chain.num_joints
    shapes: list[tuple[int, ...]] = [(n,), (n,), (n,), (6, n), (3, 3), (3,), (n, SCRATCH_COLUMNS)]
    return [np.empty(shape) for shape in shapes]


def main() -> None:
    """Prints the table."""
    robot = Robot.load("sts_sre4_600")
    chain, arm = robot.chain, PinocchioArm(robot)
    rng = np.random.default_rng(0)
    q, v, vdot = rng.uniform(-2.5, 2.5, (3, 100_000, chain.num_joints))
    q1, v1, vdot1 = q[0].copy(), v[0].copy(), vdot[0].copy()
    momentum, CTv, G, J, R_WE, p_WE, scratch = preallocated(chain)

    for ours, theirs in zip(chain.momentum_terms(q1, v1), arm.momentum_terms(q1, v1), strict=True):
        assert np.allclose(ours, theirs, rtol=0, atol=1e-10)
    linear_first = arm.jacobian(q1)
    assert np.allclose(
        chain.jacobian(q1), np.vstack([linear_first[3:], linear_first[:3]]), rtol=0, atol=1e-10
    )
    assert np.allclose(
        chain.regressor(q1, v1, vdot1), arm.regressor(q1, v1, vdot1), rtol=0, atol=1e-10
    )

    print(f"Bundled 6-joint arm, {numba.get_num_threads()} threads for many samples.")
    print(f"{'':52} {'kernels':>12} {'pinocchio':>12} {'ratio':>9}   (smallest to largest)")

    compare(
        "one sample: observer_terms (Mv, CTv, G, J, pose)",
        lambda: observer_terms(chain.table, q1, v1, momentum, CTv, G, J, R_WE, p_WE, scratch),
        lambda: arm.observer_terms(q1, v1),
        calls=2_000,
    )
    terms = chain.terms(q1, v1).record
    compare(
        "one sample: all_terms (and Cv, M, V), preallocated",
        lambda: all_terms(chain.table, terms, scratch),
        lambda: arm.terms(q1, v1),
        calls=2_000,
    )
    compare(
        "one sample: chain.terms",
        lambda: chain.terms(q1, v1),
        lambda: arm.terms(q1, v1),
        calls=2_000,
    )
    compare(
        "100,000 samples: Mv, CTv, G",
        lambda: chain.momentum_terms(q, v),
        lambda: [arm.momentum_terms(a, b) for a, b in zip(q, v, strict=True)],
    )
    compare(
        "100,000 samples: Jacobian",
        lambda: chain.jacobian(q),
        lambda: [arm.jacobian(a).copy() for a in q],
    )
    compare(
        "100,000 samples: inverse dynamics",
        lambda: chain.inverse_dynamics(q, v, vdot),
        lambda: [arm.inverse_dynamics(*row).copy() for row in zip(q, v, vdot, strict=True)],
    )
    few = [signal[:20_000] for signal in (q, v, vdot)]
    compare(
        "20,000 samples: regressor (6 x 60)",
        lambda: chain.regressor(*few),
        lambda: [arm.regressor(*row).copy() for row in zip(*few, strict=True)],
    )
    number, part = 500_000, 5_000

    def places_and_condition_numbers(q: Array) -> tuple[Array, Array]:
        pairs = [(arm.jacobian(a).copy(), arm.data.oMf[arm.frame].translation.copy()) for a in q]
        Js, places = (np.array(x) for x in zip(*pairs, strict=True))
        return places, np.linalg.cond(Js)

    few_samples = sample(robot, part, 0)
    places, jcn = places_and_condition_numbers(few_samples.q)
    assert np.allclose(few_samples.p_WE, places, rtol=0.0, atol=1e-12)
    low = jcn < 1e6
    assert np.allclose(few_samples.jcn[low], jcn[low], rtol=1e-9, atol=0.0)
    compare(
        "500,000 configurations: places, cond. numbers (1)",
        lambda: sample(robot, number, 0),
        lambda: places_and_condition_numbers(few_samples.q),
        scale=number / part,
    )
    Js = chain.jacobian(rng.uniform(-np.pi, np.pi, (number, chain.num_joints)))
    compare(
        "500,000 condition numbers of given Jacobians (2)",
        lambda: condition_number(Js),
        lambda: np.linalg.cond(Js[:part]),
        scale=number / part,
    )
    print(f"(1) pinocchio's Jacobians and numpy.linalg.cond, measured on {part:,} and scaled up.")
    print(f"(2) numpy.linalg.cond on the stack, measured on {part:,} and scaled up.")
    plane = partial(slice_plane, robot, SliceConfig(), np.array([0.8, 0.8, 1.2]))
    print(f"a slice of 41 x 41 points: {seconds(plane, 1):.2f} s")


if __name__ == "__main__":
    main()
