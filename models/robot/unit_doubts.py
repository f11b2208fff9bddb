"""What sizes and masses say of the units of a robot's description."""

import math

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.rotational_inertia import BodyInertia

_MIN_JOINTS = 3  # of what is judged; two joints may cross in one point
_USUAL_REACH = 0.8  # m
_REACH_RANGE = (0.05, 8.0)  # m, of arms; beyond it is doubted
_MAX_REACH = 30.0  # m; no arm
# kg of moving mass per m^3 of reach cubed: SO-100 14, UR10e 15, KR1000 143
_DENSITY_RANGE = (0.2, 300.0)
_MAX_DENSITY = 3000.0  # no arm
# Radius of gyration of a link over the arm's reach: .9 at most on public arms whose inertias may be
# true, 1.2 and 3.1 where 1 kg m^2 stands on all links, 7.7 in another unit.
_MAX_GYRATION = 1.5
_LIGHTEST_LINK = 1e-6  # kg; a lighter one has no mass
_USUAL_GYRATION = 0.1  # of the reach
_MAX_SPEED = 30.0  # rad/s (m/s); no drive of an arm
_USUAL_DENSITY = 15.0
_LENGTHS = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254, "metres": 1.0}
_INERTIAS = {"kg mm^2": 1e-6, "kg cm^2": 1e-4, "kg m^2": 1.0}
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
        doubts += _inertia_doubts(robot, reach)
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


def _inertia_doubts(robot: Robot, reach: float) -> list[str]:
    """A sentence on links whose rotational inertia is that of a body larger than the arm."""
    gyration = np.array([_gyration(link) for link in robot.chain.inertial_parameters])
    names = [robot.joint_names[j] for j in np.flatnonzero(gyration > _MAX_GYRATION * reach)]
    if not names:
        return []
    largest = float(gyration.max())
    lengths = {unit: math.sqrt(factor) for unit, factor in _INERTIAS.items()}
    unit = _likeliest(lengths, largest, _USUAL_GYRATION * reach)
    sentence = (
        f"the inertia of what {', '.join(names)} moves is that of a body larger than the arm: "
        f"radius of gyration up to {largest:.2g} m, reach {reach:.2g} m"
    )
    if unit != "kg m^2":
        sentence += f"; in {unit} it would be {largest * lengths[unit]:.2g} m"
    return [f"{sentence}: check the inertias of the file, which are in kg m^2"]


def _gyration(parameters: Array) -> float:
    """The largest radius of gyration about the centre of mass, m, of m, m c (3), I (6); or 0."""
    if parameters[0] < _LIGHTEST_LINK:
        return 0.0
    body = BodyInertia.of(parameters)
    return math.sqrt(max(float(np.linalg.eigvalsh(body.inertia)[-1]), 0.0) / body.mass)


def reach_of(robot: Robot, postures: Array) -> float:
    """The farthest that E is from the first joint, m, in postures (N, n)."""
    _, p_WE = robot.chain.pose(postures)
    return float(np.linalg.norm(p_WE - robot.chain.p_PJ[0], axis=1).max())


def _likeliest(units: dict[str, float], value: float, usual: float) -> str:
    """The unit in which a value is nearest to the usual one."""
    return min(units, key=lambda unit: abs(math.log(max(value, 1e-12) * units[unit] / usual)))
