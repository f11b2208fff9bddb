"""Contact-free hours of a simulated arm: twins of real logs on many days, read by one model.

A real arm's recordings hold minutes without contact, and minutes cannot confirm a rate of one
false alarm an hour. The simulated twin of each log (`twin_logs`) moves as the log does, with joints
that differ from day to day, and knows that nothing touches it.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_trials import TrialLog
from wrenchsight.analyses.experiments.setups.ur10e_recordings.twin_logs import twin_log
from wrenchsight.analyses.methods.identify.identification import identify
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

FIRST_DAY = 10  # of the twins that are read; those of the fit are of the days 1 and 2
_FIRST_SEED = 1000  # of their noise; that of the fit's twins has 0, 1, 2


def model_of_twins(recordings: Sequence[Recording], robot: Robot) -> IdentifiedModel:
    """Identified on twins of these logs, the first on a day of its own."""
    twins = [
        twin_log(recording, robot, day=1 + min(k, 1), seed=k)
        for k, recording in enumerate(recordings)
    ]
    return identify(twins, robot, [], IdentificationConfig(friction="presliding")).model


class TwinAlarms(NamedTuple):
    """Alarms in logs of free motion, all of them false.

    Attributes:
        hours: of the logs that were read.
        by_rate: how many, by the false alarms an hour that the detector states.
        by_log: how many at the lowest of these rates, by the name of the real log.
    """

    hours: float
    by_rate: dict[float, int]
    by_log: dict[str, int]


def alarms_of_twins(
    recordings: Mapping[str, Recording],
    robot: Robot,
    model: IdentifiedModel,
    rates: Sequence[float],
    days: int,
) -> TwinAlarms:
    """Counts the alarms in simulated twins of real logs, in which nothing touches the arm.

    Args:
        recordings: real logs, by name, whose motion the twins repeat.
        robot: with its simulated truth.
        model: that reads the twins.
        rates: false alarms an hour.
        days: how many twins of each log, from FIRST_DAY on: the joints differ from those of the
            twins that `model_of_twins` was fitted on.
    """
    by_rate = dict.fromkeys(rates, 0)
    by_log = dict.fromkeys(recordings, 0)  # at the least rate
    hours = 0.0
    for day in range(days):
        for name, recording in recordings.items():
            twin = twin_log(recording, robot, day=FIRST_DAY + day, seed=_FIRST_SEED + day)
            log = TrialLog(twin, robot, model)
            hours += log.hours
            for rate in rates:
                count = len(log.alarms(rate))
                by_rate[rate] += count
                if rate == min(rates):
                    by_log[name] += count
    return TwinAlarms(hours, by_rate, by_log)
