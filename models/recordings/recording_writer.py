"""Writes recordings as logs that read back bit for bit."""

from pathlib import Path

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.log_containers import container_of, usual_suffixes
from wrenchsight.models.recordings.recording import Recording


def write_recording(recording: Recording, path: str | Path) -> None:
    """Writes the columns t,q1..qn,v1..vn,i1..in and all further signals, whole or not at all.

    Motor torque becomes tau1..taun, a signal of `extra` name.1..name.k (its shape is lost),
    bridged samples a column dropout. Numbers have full precision; `read_recording` reads them
    back.

    Args:
        recording: recording of any robot.
        path: path of the log; its ending decides the kind of file (`log_containers`).

    Raises:
        InputError: no kind of log has this ending, or the file cannot be written.
    """
    path = Path(path)
    container = container_of(path)
    if container is None:
        problem = f'has the ending "{path.suffix}", expected {", ".join(usual_suffixes())}'
        raise InputError(path, "", problem, "give the log another name")
    container.write(path, recording.columns())
