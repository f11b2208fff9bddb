"""What a stranger adds by a file of one's own and one line: observer, friction term, log container.

Each is registered as the documentation says, runs wherever the bundled ones do, and is taken out
again.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray
from played_logs import played

from wrenchsight.analyses.methods.identify.identification import identify
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.extended_friction import ExtendedFriction
from wrenchsight.models.friction.friction_structure import FrictionStructure
from wrenchsight.models.friction.friction_terms import TERMS, FrictionTerm
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.observer import Observed, ObserverSamples
from wrenchsight.models.observers.observer_kinds import OBSERVERS
from wrenchsight.models.recordings.log_containers import CONTAINERS, container_of
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_format import RecordingFormat
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

T = 1e-3


# An observer --------------------------------------------------------------------------------------


@dataclass
class CautiousConfig:
    """A first-order observer that reads nothing where a joint's torque may all be error."""

    bandwidth: float = 30.0  # 1/s
    time_step: float = T


@kernel
def observe_cautiously(
    bandwidth: float,
    period: float,
    state: Array,
    momentum: Array,
    model: Array,
    tau_J: Array,
    J: Array,
    sd: Array,
    tau_ext: Array,
    is_fresh: Flags,
) -> None:
    """`model` (N, n) C^T v - G - tau_f."""
    for k in range(len(momentum)):
        is_fresh[k] = np.isfinite(state[0]).all()
        for i in range(momentum.shape[1]):
            arrived = momentum[k, i] - 0.5 * period * model[k, i]
            raw = state[1, i]
            if np.isfinite(arrived) and np.isfinite(state[0, i]):
                share = -np.expm1(-bandwidth * period)
                raw += share * ((arrived - state[0, i]) / period - raw)
            felt = np.abs(J[k, :, i]).sum() > 0.0
            shrunk = max(abs(raw) - 0.1 * sd[k, i], 0.0)
            tau_ext[k, i] = np.copysign(shrunk, raw) if felt else 0.0
            state[0, i] = momentum[k, i] + 0.5 * period * model[k, i] + period * tau_J[k, i]
            state[1, i] = raw


class CautiousObserver:
    Config: ClassVar[type] = CautiousConfig
    reads_wrench: ClassVar[bool] = False

    def __init__(self, config: CautiousConfig, num_joints: int) -> None:
        self.config, self.num_joints = config, num_joints
        self.time_step = config.time_step
        self.reads_present_torque = False
        self.pole = None
        self.settling_time = 3.0 / config.bandwidth

    @property
    def parameters(self) -> dict[str, Array]:
        return {"bandwidth": np.array([self.config.bandwidth])}

    def with_parameters(self, values: dict[str, Array]) -> "CautiousObserver":
        config = replace(self.config, bandwidth=float(values["bandwidth"][0]))
        return CautiousObserver(config, self.num_joints)

    def initial_state(self) -> Array:
        return np.vstack([np.full(self.num_joints, np.nan), np.zeros(self.num_joints)])

    def observe(self, state: Array, samples: ObserverSamples) -> Observed:
        tau_ext = np.empty_like(samples.momentum)
        is_fresh = np.empty(len(tau_ext), np.bool_)
        observe_cautiously(
            self.config.bandwidth,
            self.time_step,
            state,
            samples.momentum,
            samples.CTv - samples.G - samples.tau_f,
            samples.tau_J,
            samples.J,
            samples.sd,
            tau_ext,
            is_fresh,
        )
        return Observed(tau_ext, is_fresh)


@pytest.fixture
def observer() -> Iterator[None]:
    OBSERVERS.append(CautiousObserver)
    yield
    OBSERVERS.remove(CautiousObserver)


# A friction term ----------------------------------------------------------------------------------


@kernel
def seal(q: float, v: float) -> float:
    """A seal that drags more on one side of its turn."""
    return float(np.tanh(20.0 * v) * (1.0 + np.sin(q)))


@pytest.fixture
def term() -> Iterator[FrictionTerm]:
    seal_term = FrictionTerm("seal", seal, laws=("coulomb-viscous-offset", "presliding"), least=0.0)
    TERMS.append(seal_term)
    yield seal_term
    TERMS.remove(seal_term)


# A log container ----------------------------------------------------------------------------------


class NumpyTable:
    row_word = "row"

    def __init__(self, path: Path) -> None:
        with np.load(path) as file:
            self.names: tuple[str, ...] | None = tuple(file.files)
            self._values = np.stack([file[name].astype(float) for name in file.files], axis=1)
        self.num_columns = self._values.shape[1]
        self.notices: list[str] = []
        self.progress = 0.0

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, NDArray[np.int64]]]:
        first, last = rows or (1, len(self._values))
        for begin in range(first - 1, last, 20):
            end = min(begin + 20, last)
            self.progress = end / len(self._values)
            yield self._values[begin:end][:, columns], np.arange(begin + 1, end + 1)


class NumpyContainer:
    suffixes: tuple[str, ...] = (".nparchive",)

    def open(self, path: Path, form: RecordingFormat | None) -> NumpyTable:
        return NumpyTable(path)

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        with path.open("wb") as file:  # numpy appends .npz to a name
            np.savez(file, **dict(columns))


@pytest.fixture
def container() -> Iterator[None]:
    numpy_container = NumpyContainer()
    CONTAINERS.append(numpy_container)
    yield
    CONTAINERS.remove(numpy_container)


# --------------------------------------------------------------------------------------------------


def motion(robot: Robot, rows: int, step: float = T) -> tuple[Array, Array, Array]:
    """q, v and vdot of all joints in motion."""
    rng = np.random.default_rng(11)
    t = np.arange(rows)[:, None] * step
    phase, rate = rng.uniform(0.0, 6.0, (2, 1, robot.num_joints))
    rate = 1.0 + rate
    other = 1.7 * rate
    q = robot.home + 0.4 * np.sin(rate * t + phase) + 0.2 * np.sin(other * t)
    v = 0.4 * rate * np.cos(rate * t + phase) + 0.2 * other * np.cos(other * t)
    vdot = -0.4 * rate**2 * np.sin(rate * t + phase) - 0.2 * other**2 * np.sin(other * t)
    return q, v, vdot


def samples(robot: Robot, rows: int = 300) -> tuple[Array, Array, Array]:
    q, v, _ = motion(robot, rows)
    current = np.sin(3.0 * q) + 0.05 * np.random.default_rng(1).normal(size=q.shape)
    current[120, 1] = np.nan
    return q, v, current


def batch(
    robot: Robot, model: IdentifiedModel, config: WrenchEstimatorConfig, log: tuple[Array, ...]
) -> EstimateBatch:
    estimator = WrenchEstimator(robot, model, config)
    return estimator.run(estimator.initial_state(), *log)


def ticks(
    robot: Robot, model: IdentifiedModel, config: WrenchEstimatorConfig, log: tuple[Array, ...]
) -> Array:
    estimator = WrenchEstimator(robot, model, config)
    state = estimator.initial_state()
    return np.array([estimator.step(state, *sample).wrench for sample in zip(*log, strict=True)])


def assert_alike_everywhere(
    robot: Robot, model: IdentifiedModel, config: WrenchEstimatorConfig
) -> EstimateBatch:
    """Log, ticks, diagram of stages and fused block read the same."""
    log = samples(robot)
    from_batch = batch(robot, model, config, log)
    assert np.isfinite(from_batch.wrench).all()
    assert from_batch.valid.any()
    close = {"rtol": 0.0, "atol": 1e-9}  # what is asked of two engines
    np.testing.assert_allclose(ticks(robot, model, config, log), from_batch.wrench, **close)
    for fused in (False, True):
        seen = played(robot, model, config, log, fused=fused)
        np.testing.assert_allclose(seen["tau_ext"], from_batch.tau_ext, **close)
        np.testing.assert_allclose(seen["wrench"], from_batch.wrench, **close)
        np.testing.assert_array_equal(seen["valid"][:, 0] == 1.0, from_batch.valid)
    return from_batch


@pytest.mark.long
@pytest.mark.usefixtures("observer")
def test_an_observer_runs_in_every_engine(sts: Robot) -> None:
    model = IdentifiedModel.nominal(sts)
    from_batch = assert_alike_everywhere(sts, model, WrenchEstimatorConfig(CautiousConfig()))
    plain = batch(sts, model, WrenchEstimatorConfig(MomentumObserverConfig([30.0])), samples(sts))
    sd = np.sqrt(np.diag(model.residual_covariance))
    # The oracle: the bundled observer of the same pole, less a tenth of a standard deviation. A
    # sample that is not finite ends the comparison: the toy does not keep what it had before.
    shrunk = np.sign(plain.tau_ext) * np.maximum(np.abs(plain.tau_ext) - 0.1 * sd, 0.0)
    np.testing.assert_allclose(from_batch.tau_ext[:120], shrunk[:120], rtol=0.0, atol=1e-9)
    assert np.abs(from_batch.tau_ext - plain.tau_ext).max() > 1e-3


def test_an_observer_that_is_taken_out_is_unknown(sts: Robot) -> None:
    model = IdentifiedModel.nominal(sts)
    with pytest.raises(ValueError, match="expected one of MomentumObserverConfig"):
        WrenchEstimator(sts, model, WrenchEstimatorConfig(CautiousConfig()))


@pytest.mark.long
@pytest.mark.parametrize("below", ["coulomb-viscous-offset", "presliding"])
def test_a_friction_term_runs_in_every_engine(
    sts: Robot, term: FrictionTerm, below: str, tmp_path: Path
) -> None:
    n = sts.num_joints
    structure = FrictionStructure.of(f"{below}+seal", n)
    values = {"coulomb": 3.0, "viscous": 2.0, "offset": 0.1, "stribeck": 0.5}
    values |= {"load": 0.05, "cubic": 0.1, "seal": 1.5}
    law = structure.law([np.array([values[name] for name in names]) for names in structure.terms])
    assert isinstance(law, ExtendedFriction)
    model = replace(IdentifiedModel.nominal(sts), friction=law)
    from_batch = assert_alike_everywhere(sts, model, WrenchEstimatorConfig())

    # The oracle: the law below, with the term's torque taken off the motor's instead.
    q, v, current = samples(sts)
    drag = np.tanh(20.0 * v) * (1.0 + np.sin(q)) * 1.5
    if below != "presliding":  # whose load would feel it
        drive = sts.torque_per_ampere * sts.current_sign
        plain = replace(model, friction=law.law)
        # Torque is held over a tick, friction averaged over its ends: the same in the limit.
        off = batch(sts, plain, WrenchEstimatorConfig(), (q, v, current - drag / drive))
        assert np.abs(from_batch.tau_ext - off.tau_ext)[:120].max() < 0.05
        assert np.abs(off.tau_ext).max() > 1.0
    along = law.torque_along(q, v, np.zeros_like(q)) - law.law.torque_along(q, v, np.zeros_like(q))
    np.testing.assert_allclose(along, drag, rtol=0.0, atol=1e-12)

    model.save(tmp_path / "model.yaml")
    loaded = IdentifiedModel.load(tmp_path / "model.yaml", sts).friction
    np.testing.assert_array_equal(loaded.coefficients, law.coefficients)
    TERMS.remove(term)
    try:
        with pytest.raises(InputError, match='no friction term is registered as "seal"'):
            IdentifiedModel.load(tmp_path / "model.yaml", sts)
    finally:
        TERMS.append(term)


@pytest.mark.long
@pytest.mark.usefixtures("term")
def test_identify_knows_a_registered_term(sts: Robot) -> None:
    step = 0.01
    q, v, vdot = motion(sts, 4000, step)
    n = sts.num_joints
    coefficient = np.linspace(2.0, 1.0, n)
    tau = sts.chain.inverse_dynamics(q, v, vdot) + 3.0 * v + 4.0 * np.sign(v)
    tau = tau + coefficient * np.tanh(20.0 * v) * (1.0 + np.sin(q))
    recording = Recording(
        t=step * np.arange(len(q)),
        q=q,
        v=v,
        current=tau / (sts.torque_per_ampere * sts.current_sign),
        source="made up",
    )
    config = IdentificationConfig(friction="coulomb-viscous-offset+seal", loss="squares")
    result = identify([recording], sts, config=config)
    friction = result.model.friction
    assert isinstance(friction, ExtendedFriction)
    # Filtered alike on both sides; what is left is the low-pass's ripple over the signs.
    np.testing.assert_allclose(friction.coefficients[:, 0], coefficient, rtol=0.05)
    assert result.metrics()["friction"]["law"] == "coulomb-viscous-offset+seal"
    np.testing.assert_allclose(
        result.metrics()["friction"]["terms"]["seal"], friction.coefficients[:, 0]
    )


def test_a_term_that_is_taken_out_is_unknown(sts: Robot) -> None:
    with pytest.raises(InputError, match="no friction law is named 'presliding\\+seal'"):
        identify([], sts, config=IdentificationConfig(friction="presliding+seal"))


def test_a_log_container_is_registered_reads_back_and_is_removed(
    sts: Robot, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    q, v, _ = motion(sts, 50)
    recording = Recording(t=T * np.arange(50), q=q, v=v, current=0.1 * q, source="made up")
    path = tmp_path / "log.nparchive"
    with pytest.raises(InputError, match=r"expected \.csv, \.parquet, \.npz, \.mcap"):
        write_recording(recording, path)
    request.getfixturevalue("container")
    write_recording(recording, path)
    again = read_recording(path, robot=sts, check=False)
    for name in ("t", "q", "v", "current"):
        np.testing.assert_array_equal(getattr(again, name), getattr(recording, name))
    (numpy_container,) = (kind for kind in CONTAINERS if ".nparchive" in kind.suffixes)
    # The ending of a user's kind counts before what the first bytes are: those of an npz file.
    assert container_of(path) is numpy_container
    CONTAINERS.remove(numpy_container)
    try:
        by_content = container_of(path)
        assert by_content is not None
        assert ".npz" in by_content.suffixes
    finally:
        CONTAINERS.append(numpy_container)
