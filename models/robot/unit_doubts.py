"""What sizes and masses say of the units of a robot's description."""

import math

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

_MIN_JOINTS = 3  # of what is judged; two joints may cross in one point
_USUAL_REACH = 0.8  # m
_REACH_RANGE = (0.05, 8.0)  # m, of arms; beyond it is doubted
_MAX_REACH = 30.0  # m; no arm
# kg of moving mass per m^3 of reach cubed: SO-100 14, UR10e 15, KR1000 143
_DENSITY_RANGE = (0.2, 300.0)
_MAX_DENSITY = 3000.0  # no arm
_MAX_SPEED = 30.0  # rad/s (m/s); no drive of an arm
_USUAL_DENSITY = 15.0
_LENGTHS = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254, "metres": 1.0}
_MASSES = {"grams": 1e-3, "tonnes": 1e3, "kilograms": 1.0}


def unit_doubts(robot: Robot, postures: Array) -> tuple[str, ...]:
    """Sentences on sizes, masses and speeds that an arm has hardly, with the likely unit.

    What is unusual is doubted; what no arm is (_MAX_REACH, _MAX_DENSITY) is refused where another
    unit explains it.

    Args:
        robot: as its file describes it.
        postures: (N, n) rad or m, over which the reach is taken.

    Raises:
        InputError: no arm has such a size or mass.
    """
    if robot.num_joints < _MIN_JOINTS:
        return ()
    reach = reach_of(robot, postures)
    doubts: list[str] = []
    if reach > _REACH_RANGE[1] or reach < _REACH_RANGE[0]:
        unit = _likeliest(_LENGTHS, reach, _USUAL_REACH)
        sentence = f"the arm reaches {reach:.3g} m"
        if unit != "metres":
            scaled = reach * _LENGTHS[unit]
            sentence += f"; in {unit} it would be {scaled:.2g} m"
            if reach > _MAX_REACH:  # refused, since another unit explains it; else doubted alone
                remedy = f"multiply all lengths of the file by {_LENGTHS[unit]:g}: a URDF has m"
                raise InputError(robot.config.urdf, "", sentence, remedy)
        doubts.append(f"{sentence}: check the units of the file")
    mass = float(robot.chain.inertial_parameters[:, 0].sum())
    if robot.has_inertias and mass > 0.0 and reach > 0.0:
        density = mass / reach**3
        if not _DENSITY_RANGE[0] <= density <= _DENSITY_RANGE[1]:
            unit = _likeliest(_MASSES, density, _USUAL_DENSITY)
            sentence = f"{mass:.3g} kg move on an arm that reaches {reach:.2g} m"
            if unit != "kilograms":
                sentence += f"; in {unit} it would be {mass * _MASSES[unit]:.2g} kg"
                if density > _MAX_DENSITY:
                    remedy = (
                        f"multiply masses and inertias of the file by {_MASSES[unit]:g}: a URDF "
                        "has kg and kg m^2"
                    )
                    raise InputError(robot.config.urdf, "", sentence, remedy)
            doubts.append(f"{sentence}: check the masses of the file")
    fast = [
        f"{name} {speed:.3g}"
        for name, speed in zip(robot.joint_names, robot.velocity_limit.tolist(), strict=True)
        if math.isfinite(speed) and speed > _MAX_SPEED
    ]
    if fast:
        doubts.append(
            f"no arm's joint is as fast as the file states (rad/s or m/s: {', '.join(fast)}): "
            "they count as not stated; write the data sheet's speeds into it"
        )
    return tuple(doubts)


def reach_of(robot: Robot, postures: Array) -> float:
    """The farthest that E is from the first joint, m, in postures (N, n)."""
    _, p_WE = robot.chain.pose(postures)
    return float(np.linalg.norm(p_WE - robot.chain.p_PJ[0], axis=1).max())


def _likeliest(units: dict[str, float], value: float, usual: float) -> str:
    """The unit in which a value is nearest to the usual one."""
    return min(units, key=lambda unit: abs(math.log(max(value, 1e-12) * units[unit] / usual)))
