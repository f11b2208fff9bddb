"""What a person knows beside the log: the tool on the flange, and the direction of the contact."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.reading.estimate_config import EstimateConfig
from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.calibration.known_tool import with_tool_of
from wrenchsight.models.contact.contact_reading import ContactReader
from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimatorConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.observer_kinds import make_observer
from wrenchsight.models.recordings.recording import Recording, concatenated
from wrenchsight.models.robot.robot import Robot


def with_known_tool(
    model: IdentifiedModel, robot: Robot, config: EstimateConfig, source: Path
) -> IdentifiedModel:
    """Returns the model with the tool that the robot carries.

    Raises:
        InputError: the model has another tool, and it is not said what that means.
    """
    if config.tool:
        return with_tool_of(model, robot)
    if model.fitted_robot.differs_by_tool(robot) and not config.other_robot:
        raise InputError(
            source,
            "fitted_robot.tool_mass",
            model.fitted_robot.tool_difference(robot),
            "if robot.yaml's tool is on the arm and its numbers are known, say --tool; else use "
            "the model.yaml that payload writes, or identify again; --other-robot reads its "
            "weight as a force",
        )
    return model


class Read(NamedTuple):
    """A part of a log, what is read of it, contact, and tau_ext as a controller would see it."""

    chunk: Recording
    batch: EstimateBatch
    found: Detection
    tau_ext: Array


def read_later(
    parts: Iterable[Read],
    take: Callable[[Read], EstimateBatch],
    finish: Callable[[], EstimateBatch],
) -> Iterator[Read]:
    """The parts of a log again, with a reading that comes some samples after them.

    Args:
        parts: as a controller would read them.
        take: takes a part, and returns what is read of the earliest samples without a reading.
        finish: returns what is left.
    """
    ahead: Read | None = None
    for part in parts:
        whole = part if ahead is None else _joined(ahead, part)
        ready = take(part)
        count = len(ready.valid)
        if count:
            yield _rows(whole, slice(0, count))._replace(batch=ready)
        ahead = _rows(whole, slice(count, None))
    if ahead is not None:
        yield ahead._replace(batch=finish())


def read_contact(
    parts: Iterable[Read],
    robot: Robot,
    settings: EstimateConfig,
    config: WrenchEstimatorConfig,
    is_known: Callable[[Recording, EstimateBatch], Flags],
) -> Iterator[Read]:
    """The parts of a log again, read by what is known of the contact's direction.

    Args:
        parts: as a controller would read them.
        settings: with the contact's axis.
        config: with the log's time step.
        is_known: (N,) samples that were measured.
    """
    observer = make_observer(config.observer, robot.num_joints)
    reader = ContactReader(
        robot,
        observer.pole,
        config.observer.time_step,
        settings.contact,
        config.reconstruction.max_force_sd,
    )

    def take(part: Read) -> EstimateBatch:
        chunk, batch = part.chunk, part.batch
        tau_J = robot.joint_torque(chunk.current)
        return reader.take(chunk.q, chunk.v, tau_J, is_known(chunk, batch), batch)

    return read_later(parts, take, reader.finish)


def _joined(one: Read, other: Read) -> Read:
    return Read(
        concatenated([one.chunk, other.chunk]),
        EstimateBatch.joined([one.batch, other.batch]),
        Detection.joined([one.found, other.found]),
        np.concatenate([one.tau_ext, other.tau_ext]),
    )


def without_breaks(reads: Iterable[Read]) -> Iterator[Read]:
    """The parts of a log again, without the samples between the episodes of a data set."""
    for read in reads:
        rows = read.chunk.row
        if rows is None or rows.all():
            yield read
        elif rows.any():
            yield _rows(read, rows != 0)


def _rows(read: Read, rows: slice | Flags) -> Read:
    return Read(read.chunk[rows], read.batch.rows(rows), read.found.rows(rows), read.tau_ext[rows])
