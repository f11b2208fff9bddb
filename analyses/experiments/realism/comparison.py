"""The same statistics of real logs and of their simulated twins, and what chance does to them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from wrenchsight.analyses.experiments.realism.arm_statistics import (
    TorqueError,
    at_rest,
    correlation_time,
    current_noise,
    drift,
    load_statistics,
    pass_repeatability,
    residual_by_speed,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.twin_logs import twin_log
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import FITTED
from wrenchsight.analyses.methods.learning.identification import identify
from wrenchsight.analyses.methods.learning.identification_config import IdentificationConfig
from wrenchsight.analyses.methods.runs.simulated_logs import ProgressCallback
from wrenchsight.models.arrays import Array
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import ToolConfig

CONFIG = IdentificationConfig(friction="presliding", cross_validate=False)
FIT = tuple(name.removesuffix(".csv") for name in FITTED)
# What the truth's parameters were settled on besides the logs of the fit.
SETTLED = ("ur-20_02_10-20sec_7harm", "ur-20_02_06-20sec_5harm")
SETTLED_LOAD = ("ur-19_12_23_free", "ur-19_12_23_load")
# Seen by nobody who settled them, but for the motions' rests (noise and error at rest) of `STILL`.
CHECKED = (
    "ur-20_02_19_14harm50sec",
    "ur-20_02_19_15harm50sec",
    "ur-20_02_06-20sec_10harm",
    "ur-20_02_05-20sec_8harm",
    "ur-20_01_31-unload",
)
UNLOADED, LOADED = "ur-20_02_19_14harm50sec", "ur-20_02_19_14harm50secLoad"
STILL = "ur-20_01_17-ptp_10_points"
PASSES = tuple(f"ur-20_01_22-joint_{k}" for k in range(1, 7))
# Of LOADED: mass as published, centre of mass as found from the log's first 10 s.
PAYLOAD = ToolConfig("load", 2.805, [0.027, 0.174, 0.053], [0.005, 0.005, 0.005, 0.0, 0.0, 0.0])
ERROR = 0.05  # of calling what is chance a difference, a number
DAY_DRAWS = 6  # by which the simulated days are drawn anew: four real days are a small sample
_DAY = slice(3, 11)  # of a log's name


@dataclass(frozen=True, eq=False)
class ArmLogs:
    """Logs by their names, and the model identified on those of FIT."""

    recordings: Mapping[str, Recording]
    robot: Robot
    model: IdentifiedModel
    more_days: tuple[Recording, ...] = ()

    @classmethod
    def of(
        cls,
        recordings: Mapping[str, Recording],
        robot: Robot,
        more_days: Sequence[Recording] = (),
    ) -> "ArmLogs":
        """With the model that the logs of FIT say."""
        model = identify([recordings[name] for name in FIT], robot, [], CONFIG).model
        return cls(recordings, robot, model, tuple(more_days))

    def statistics(self) -> dict[str, Array]:
        """Of the logs of CHECKED, LOADED, STILL and PASSES; one number a joint, by name."""
        errors = {
            name: TorqueError.of(self.recordings[name], self.robot, self.model)
            for name in (*CHECKED, LOADED, STILL)
        }
        checked = [errors[name] for name in CHECKED]
        days = [TorqueError.of(log, self.robot, self.model) for log in self.more_days]
        result = {f"residual_{k}_nm": x for k, x in residual_by_speed(checked).items()}
        result["correlation_time_s"] = correlation_time(checked)
        result |= {f"drift_{k}": x for k, x in drift([*checked, *days]).items()}
        load = load_statistics(errors[UNLOADED], errors[LOADED])
        result |= {f"loaded_{k}": x for k, x in load.items()}
        result["passes_differ_nm"] = np.array(
            [
                pass_repeatability(self.recordings[name], self.robot, j)
                for j, name in enumerate(PASSES)
            ]
        )
        result["at_rest_nm"] = at_rest(errors[STILL])
        logs = [self.recordings[name] for name in CHECKED]
        result |= {f"noise_moving_{k}": x for k, x in current_noise(logs, True).items()}
        still = current_noise([self.recordings[STILL]], False)
        return result | {f"noise_at_rest_{k}": x for k, x in still.items()}


def twins(
    recordings: Mapping[str, Recording],
    robot: Robot,
    seed: int = 0,
    day_draws: int = DAY_DRAWS,
    progress: ProgressCallback = lambda fraction, what: None,
) -> tuple[dict[str, Recording], list[Recording]]:
    """The simulated twin of every log, and those of CHECKED on `day_draws` - 1 further days each.

    Logs of one day have one day's friction.
    """
    days = {day: k for k, day in enumerate(sorted({name[_DAY] for name in recordings}))}
    result: dict[str, Recording] = {}
    more: list[Recording] = []
    total = len(recordings) + (day_draws - 1) * len(CHECKED)
    for k, (name, recording) in enumerate(recordings.items()):
        progress(k / total, f"twin of {name}")
        payload = PAYLOAD if name == LOADED else None
        day = days[name[_DAY]] + 1000 * seed
        result[name] = twin_log(recording, robot, day, 100 * seed + k, payload)
    for draw in range(1, day_draws):
        for k, name in enumerate(CHECKED):
            progress((len(recordings) + len(more)) / total, f"another day of {name}")
            day = days[name[_DAY]] + 1000 * seed + 100 * draw
            more.append(twin_log(recordings[name], robot, day, 100 * seed + 50 + k))
    return result, more


def compared(
    real: Mapping[str, Array], simulated: Mapping[str, Array]
) -> dict[str, dict[str, Array]]:
    """`<statistic>.{real, simulated, ratio}`, (n,) each."""
    return {
        name: {"real": entry, "simulated": simulated[name], "ratio": simulated[name] / entry}
        for name, entry in real.items()
    }


@dataclass(frozen=True, eq=False)
class ToldApart:
    """Of one statistic.

    Attributes:
        factor: by which chance takes a ratio from 1, up or down, in all but ERROR of the cases;
            NaN where no joint tells.
        joints: (n,) whether a joint's number is further off than the aim and than chance.
    """

    factor: float
    joints: NDArray[np.bool_]


def told_apart(ratio: Array, two_simulated: Array, aim: float) -> ToldApart:
    """Judges one statistic, by Student's t with the spread of the two simulated arms.

    Were the truth right, the real arm's log ratios to one simulated arm would have the standard
    deviation of the two simulated arms' (of expectation zero, one degree of freedom a joint).

    Args:
        ratio: (n,) of simulated over real; NaN where a joint has no such number.
        two_simulated: (n,) of one simulated arm over another with the same parameters.
        aim: by which a ratio may differ from 1 before anybody asks whether it is chance.
    """
    apart = np.log(two_simulated[np.isfinite(two_simulated) & (two_simulated > 0.0)])
    if apart.size == 0:
        return ToldApart(float("nan"), np.zeros(ratio.shape, dtype=np.bool_))
    spread = float(np.sqrt(np.mean(apart**2)))
    limit = float(student.ppf(1.0 - ERROR / 2.0, apart.size)) * spread
    known = np.isfinite(ratio) & (ratio > 0.0)
    size = np.abs(np.log(np.where(known, ratio, 1.0)))
    off = np.abs(np.where(known, ratio, 1.0) - 1.0) > aim
    return ToldApart(float(np.exp(limit)), known & off & (size > limit))
