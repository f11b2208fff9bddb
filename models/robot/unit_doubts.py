"""What sizes and masses say of the units of a robot's description."""

import math

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.rotational_inertia import MASS, MOMENT, BodyInertia

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
_LARGEST_GYRATION = 10.0  # no link of an arm
_LARGEST_OFFSET = 10.0  # of the reach, of a link's centre of mass from its joint; no link of an arm
_SAME_INERTIA = 1e-6  # relative, of moments that one number was written for
_MIN_SAME_LINKS = 3
# rad, of a joint that turns between two ends: 12.6 is the most in 1500 public files, but for wrists
# of hands that float (20)
_MAX_TURN = 30.0
_MOST_DEGREES = 3600.0  # an end beyond it means no end, in any unit
_LIGHTEST_LINK = 1e-6  # kg; a lighter one has no mass
_USUAL_GYRATION = 0.1  # of the reach
_MAX_MESH = 10.0  # of the reach, the length of a collision mesh
_USUAL_MESH = 0.3  # of the reach
_MAX_SPEED = 30.0  # rad/s (m/s); no drive of an arm
_USUAL_DENSITY = 15.0
_LENGTHS = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254, "metres": 1.0}
_INERTIAS = {"g mm^2": 1e-9, "kg mm^2": 1e-6, "kg cm^2": 1e-4, "kg m^2": 1.0}
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
    _refuse_degrees(robot)
    reach = reach_of(robot, postures)
    doubts = [*_doubts_of_meshes(robot, reach)]
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
        _refuse_far_centres(robot, reach)
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


def _refuse_degrees(robot: Robot) -> None:
    """Refuses ranges in degrees.

    Raises:
        InputError: of three joints that turn or more, and of half of them at least.
    """
    ends = np.maximum(np.abs(robot.position_lower), np.abs(robot.position_upper))
    ends = ends[~robot.chain.prismatic & np.isfinite(ends)]
    far = ends[(ends > _MAX_TURN) & (ends <= _MOST_DEGREES)]
    if len(far) < max(_MIN_JOINTS, 0.5 * len(ends)):
        return
    problem = (
        f"{len(far)} joints turn by {far.min():.4g} to {far.max():.4g} rad either way; in degrees "
        f"the most would be {math.radians(far.max()):.3g} rad"
    )
    remedy = (
        "multiply lower, upper and velocity of each <limit> by 0.0174533: a URDF has rad; a joint "
        'that turns without end is of type "continuous"'
    )
    raise InputError(robot.config.urdf, "", problem, remedy)


def _doubts_of_meshes(robot: Robot, reach: float) -> list[str]:
    """Nothing where the collision meshes fit the arm.

    Raises:
        InputError: half of them are far longer than the arm, which another unit explains.
    """
    lengths = robot.collision_mesh_lengths
    length = float(np.median(list(lengths.values()))) if lengths else 0.0
    if not length > _MAX_MESH * reach > 0.0:
        return []
    unit = _likeliest(_LENGTHS, length, _USUAL_MESH * reach)
    sentence = (
        f"the collision meshes ({', '.join(lengths)}) are about {length:.2g} m long, and the arm "
        f"reaches {reach:.2g} m"
    )
    if unit == "metres":
        return [f"{sentence}: check their scale"]
    factor = _LENGTHS[unit]
    sentence += f"; in {unit} it would be {length * factor:.2g} m"
    scale = f'scale="{factor:g} {factor:g} {factor:g}"'
    raise InputError(robot.config.urdf, "", sentence, f"write {scale} into each <mesh>")


def _refuse_far_centres(robot: Robot, reach: float) -> None:
    """Refuses centres of mass in another unit than the lengths.

    Raises:
        InputError: one is far beyond the arm.
    """
    parameters = robot.chain.inertial_parameters
    far: list[str] = []
    farthest = 0.0
    for name, link in zip(robot.joint_names, parameters, strict=True):
        offset = (
            float(np.linalg.norm(link[MOMENT])) / link[MASS] if link[MASS] > _LIGHTEST_LINK else 0.0
        )
        if offset > _LARGEST_OFFSET * reach:
            far.append(name)
            farthest = max(farthest, offset)
    if far:
        unit = _likeliest(_LENGTHS, farthest, _USUAL_MESH * reach)
        problem = (
            f"the centre of mass of what {', '.join(far)} moves is up to {farthest:.3g} m away, "
            f"and the arm reaches {reach:.2g} m; in {unit} it would be "
            f"{farthest * _LENGTHS[unit]:.2g} m"
        )
        remedy = f"multiply xyz of the <inertial>'s <origin> by {_LENGTHS[unit]:g}: a URDF has m"
        raise InputError(robot.config.urdf, "", problem, remedy)


def _inertia_doubts(robot: Robot, reach: float) -> list[str]:
    """Sentences on rotational inertias: the same of all links, or those of too large a body.

    Raises:
        InputError: those of a body far larger than the arm, which another unit explains.
    """
    links = [_moments(link) for link in robot.chain.inertial_parameters]
    doubts = []
    same = _same_of_all(links)
    if same is not None:
        doubts.append(
            f"nearly all links of the file have the same rotational inertia ({same:.3g} kg m^2), a "
            "placeholder: `identify` finds the true ones; without its model, starts and stops are "
            "read as forces"
        )
    gyration = np.array(
        [
            math.sqrt(max(float(moments.max()), 0.0) / link[0]) if moments is not None else 0.0
            for moments, link in zip(links, robot.chain.inertial_parameters, strict=True)
        ]
    )
    names = [robot.joint_names[j] for j in np.flatnonzero(gyration > _MAX_GYRATION * reach)]
    if not names or same is not None:  # a placeholder has no unit
        return doubts
    largest = float(gyration.max())
    lengths = {unit: math.sqrt(factor) for unit, factor in _INERTIAS.items()}
    unit = _likeliest(lengths, largest, _USUAL_GYRATION * reach)
    sentence = (
        f"the inertia of what {', '.join(names)} moves is that of a body larger than the arm: "
        f"radius of gyration up to {largest:.2g} m, reach {reach:.2g} m"
    )
    if unit != "kg m^2":
        sentence += f"; in {unit} it would be {largest * lengths[unit]:.2g} m"
        if np.median(gyration) > _LARGEST_GYRATION * reach:
            remedy = f"multiply the inertias of the file by {_INERTIAS[unit]:g}: a URDF has kg m^2"
            raise InputError(robot.config.urdf, "", sentence, remedy)
    return [*doubts, f"{sentence}: check the inertias of the file, which are in kg m^2"]


def _moments(parameters: Array) -> Array | None:
    """(3,) principal moments about the centre of mass, kg m^2, of m, m c (3), I (6)."""
    if parameters[0] < _LIGHTEST_LINK:
        return None  # a link without a mass
    return np.asarray(np.linalg.eigvalsh(BodyInertia.of(parameters).inertia), float)


def _same_of_all(links: list[Array | None]) -> float | None:
    """kg m^2, the moment that all links have about each axis, but for one that carries parts."""
    with_mass = [moments for moments in links if moments is not None]
    for first in with_mass[:2]:
        alike = [np.allclose(moments, first[0], rtol=_SAME_INERTIA) for moments in with_mass]
        if sum(alike) >= max(_MIN_SAME_LINKS, len(with_mass) - 1) and first[0] > 0.0:
            return float(first[0])
    return None


def reach_of(robot: Robot, postures: Array) -> float:
    """The farthest that E is from the first joint, m, in postures (N, n)."""
    _, p_WE = robot.chain.pose(postures)
    return float(np.linalg.norm(p_WE - robot.chain.p_PJ[0], axis=1).max())


def _likeliest(units: dict[str, float], value: float, usual: float) -> str:
    """The unit in which a value is nearest to the usual one."""
    return min(units, key=lambda unit: abs(math.log(max(value, 1e-12) * units[unit] / usual)))
