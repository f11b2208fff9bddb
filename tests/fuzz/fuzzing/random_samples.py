"""`python -m fuzzing.random_samples --ticks 1000000`: doubles of any bits, in every estimator.

Sound samples with any finite doubles among them; for every observer, every way that it reads a
wrench, with and without a model of the torque's error. What leaves must be finite, a tick with an
impossible sample must not be valid. Every second block has impossible samples alone: the settling
time of the observer (3 / K_0) after the last of them is told, all must be within the stated band of
what is read without them, and two such times later valid as if nothing had been: after so many
impossible samples only a reading without force is believed (`models.observers.fault_signature`).
"""

import argparse
import math
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from sample_models import torque_error

from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_methods import METHODS
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.observer_kinds import OBSERVERS, kind_name
from wrenchsight.models.robot.robot import Robot

Array = NDArray[np.float64]
T = 0.002
ROWS = 1000
_TOLD = 2  # ticks after an impossible current: one tells of it, with the next the time begins
_ALLOWED = 1.0  # sd of the difference: what one has of the time before the hole, and one has not
_IMPOSSIBLE = 1e5  # far beyond the numbers of any arm


@cache
def arm() -> Robot:
    """The arm whose samples these are."""
    return Robot.load("ur10e")


def sound_log() -> tuple[Array, Array, Array]:
    """A smooth motion that nothing touches, and noise of the currents."""
    t = T * np.arange(ROWS)[:, None]
    w = np.array([1.1, 0.9, 1.7, 2.3, 3.1, 2.0])
    q, v = arm().home + 0.3 * np.sin(w * t), 0.3 * w * np.cos(w * t)
    vdot = -0.3 * w**2 * np.sin(w * t)
    tau = arm().chain.inverse_dynamics(q, v, vdot)
    tau += np.random.default_rng(2).normal(size=(ROWS, 6))
    return q, v, tau / (arm().torque_per_ampere * arm().current_sign)


def model_of(with_error: bool) -> IdentifiedModel:
    """The arm's nominal model, with a torque error that follows the state or without."""
    model = IdentifiedModel.nominal(arm())
    if not with_error:
        return model
    error = torque_error(
        constant=0.3,
        speed=0.02,
        load=0.02,
        acceleration=0.02,
        reversal=0.02,
        correlation_time=0.2,
        lasting=0.05,
        fitted_speed=1.0,
        fitted_load=30.0,
        resolution=1e-6,
    )
    return replace(model, torque_error=error)


def estimators() -> Iterator[tuple[str, WrenchEstimator]]:
    """Every observer, method and kind of model that go together, by a name."""
    for kind in OBSERVERS:
        for method in METHODS:
            for with_error in (False, True):
                config = WrenchEstimatorConfig(
                    replace(kind.Config(), time_step=T),
                    WrenchReconstructionConfig(method, prior_force_sd=30.0, prior_moment_sd=3.0),
                )
                try:
                    estimator = WrenchEstimator(arm(), model_of(with_error), config)
                except ValueError:  # this observer has no use for this method
                    continue
                error = "with" if with_error else "without"
                yield f"{kind_name(kind)}, {method}, {error} torque error", estimator


def faults(estimator: WrenchEstimator, ticks: int, seed: int) -> list[str]:
    """What goes wrong in that many ticks; [] if nothing does."""
    rng = np.random.default_rng(seed)
    sound = sound_log()
    state = estimator.initial_state()
    clean = estimator.run(estimator.initial_state(), *sound)
    settled = math.ceil(estimator.observer.settling_time / T - 1e-6) + _TOLD
    messages: list[str] = []
    for block in range(max(1, ticks // ROWS)):
        bits = rng.integers(0, 2**64, (3, ROWS, 6), dtype=np.uint64).view(np.float64)
        bits = np.where(np.isfinite(bits), bits, 1e308)
        only_impossible = block % 2 == 1
        if only_impossible:
            bits = np.where(np.abs(bits) > _IMPOSSIBLE, bits, -1e300)
        where = rng.random((3, ROWS, 6)) < rng.choice([0.001, 0.1, 1.0])
        where[:, rng.integers(150, 400) :] = False
        wild = [np.where(w, b, x) for w, b, x in zip(where, bits, sound, strict=True)]
        batch = estimator.run(state, *wild)
        messages += [
            f"block {block}: {name} is not finite"
            for name in ("tau_ext", "wrench", "covariance")
            if not np.isfinite(getattr(batch, name)).all()
        ]
        beyond = np.stack([(np.abs(x) > _IMPOSSIBLE).any(axis=1) for x in wild])
        if batch.valid[beyond[0] | beyond[1]].any() or batch.valid[1:][beyond[2, :-1]].any():
            messages.append(f"block {block}: an impossible sample is valid")
        last = int(np.flatnonzero(where.any(axis=(0, 2)))[-1]) if where.any() else 0
        after = last + settled
        if not only_impossible:
            continue  # a current of zero is one that a drive can give: it is read, and remembered
        sd = np.hypot(batch.standard_deviation, clean.standard_deviation)
        off = np.abs(batch.wrench - clean.wrench) / (sd + 1e-9)
        free = after + 2 * settled
        if not np.array_equal(batch.valid[free:], clean.valid[free:]):
            messages.append(f"block {block}: not as valid again {3 * settled} ticks later")
        share = float(off[after:].max(initial=0.0))
        if share > _ALLOWED:
            messages.append(f"block {block}: {share:.2f} sd off {settled} ticks later")
    return messages


def main() -> int:
    """Returns 1 if something went wrong."""
    parser = argparse.ArgumentParser(prog="fuzzing.random_samples", description=__doc__)
    parser.add_argument("--ticks", type=int, default=1_000_000, help="of each estimator")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    bad = 0
    for name, estimator in estimators():
        began = time.process_time()
        messages = faults(estimator, options.ticks, options.seed)
        bad += bool(messages)
        seconds = time.process_time() - began
        print(f"{name}: {len(messages)} faults {messages[:3]} ({seconds:.1f} s)", flush=True)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
