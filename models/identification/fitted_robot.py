"""The keys of robot.yaml that a model was identified with, and the check that they still hold.

With other values of these keys the model's readings are wrong.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot

_NUMBER_TOLERANCE = 1e-6  # of a number: YAML keeps what a person wrote
_ZERO_TOLERANCE = 1e-12  # in the key's unit, of a component that is zero


@dataclass
class FittedRobot:
    """The keys of a robot.yaml on which the numbers of a model depend."""

    torque_per_ampere: list[float] = field(default_factory=list)  # N m/A on the joint side
    current_sign: list[float] = field(default_factory=list)  # +1 or -1
    gravity: list[float] = field(default_factory=list)  # in W, m/s^2
    tool_mass: float | None = None  # kg; 0: without a tool; None: a load has been added since
    tool_com: list[float] = field(default_factory=list)  # m, in the flange
    coupling: list[list[float]] = field(default_factory=list)  # of joints; empty: none

    @classmethod
    def of(cls, robot: Robot) -> "FittedRobot":
        """Returns the keys of `robot`."""
        tool = robot.config.tool
        return cls(
            torque_per_ampere=robot.torque_per_ampere.tolist(),
            current_sign=robot.current_sign.tolist(),
            gravity=robot.gravity.tolist(),
            tool_mass=0.0 if tool is None else float(tool.mass),
            tool_com=[0.0, 0.0, 0.0] if tool is None else [float(x) for x in tool.com],
            coupling=robot.coupling.tolist() if robot.is_coupled else [],
        )

    def check(self, robot: Robot, model: Path) -> None:
        """Compares the robot with these keys; an empty one is not checked.

        Raises:
            InputError: a key that every torque depends on differs, naming it and both values.
        """
        for place, problem in self.differences(robot):
            raise InputError(
                model,
                f"fitted_robot.{place}" if place else "",
                problem,
                "set it back, or identify again; if the difference is meant, pass --other-robot",
            )

    def differences(self, robot: Robot) -> list[tuple[str, str]]:
        """Compares the keys that every torque depends on; an empty one is not compared.

        The tool is not among them: a difference there reads as a force (`warnings`).

        Returns:
            Name of each key that differs, once for each number of it, and a sentence with both
            values.
        """
        current = FittedRobot.of(robot)
        differences: list[tuple[str, str]] = []
        if self.torque_per_ampere and not _same(self.coupling, current.coupling):
            coupling_of_model = self.coupling or "no coupling of joints"
            coupling_of_robot = current.coupling or "none"
            problem = f"the model was identified with {coupling_of_model}, "
            problem += f"{robot.source} has {coupling_of_robot}"
            differences.append(("coupling", problem))
        for key in ("torque_per_ampere", "current_sign", "gravity"):
            of_model, of_robot = getattr(self, key), getattr(current, key)
            if not of_model:
                continue
            if len(of_model) != len(of_robot):
                problem = f"{len(of_model)} numbers, expected {len(of_robot)}"
                differences.append((key, problem))
                continue
            is_same = np.isclose(of_model, of_robot, rtol=_NUMBER_TOLERANCE, atol=_ZERO_TOLERANCE)
            for j in np.flatnonzero(~is_same):
                place = f"component {j + 1}" if key == "gravity" else robot.joint_names[j]
                problem = f"the model was identified with {of_model[j]:g} ({place}), "
                problem += f"{robot.source} has {of_robot[j]:g}"
                differences.append((key, problem))
        return differences

    def warnings(self, robot: Robot) -> list[str]:
        """Warnings about differences that may be meant, one sentence each."""
        if not self.torque_per_ampere:
            return [
                "the model states no torque per ampere, current sign, gravity and tool that it was "
                "identified with: they are not compared with the robot's; identify it again"
            ]
        if not self.differs_by_tool(robot):
            return []
        return [
            f"{self.tool_difference(robot)}: the difference reads as a force; use the model.yaml "
            "that `wrenchsight payload` writes, or identify again with this tool"
        ]

    def differs_by_tool(self, robot: Robot) -> bool:
        """Whether the robot carries another tool; False where the file does not say which."""
        if not self.torque_per_ampere or self.tool_mass is None:
            return False
        current = FittedRobot.of(robot)
        mass = current.tool_mass or 0.0
        of_model = [self.tool_mass, *(self.tool_mass * x for x in self.tool_com)]
        of_robot = [mass, *(mass * x for x in current.tool_com)]
        if len(of_model) != len(of_robot):
            return True
        return not np.allclose(of_model, of_robot, rtol=1e-6, atol=1e-9)

    def tool_difference(self, robot: Robot) -> str:
        """Message text: the masses of both tools, and the difference of their weights."""
        mass, mass_of_robot = self.tool_mass or 0.0, FittedRobot.of(robot).tool_mass or 0.0
        weight = abs(mass_of_robot - mass) * float(np.linalg.norm(robot.gravity))
        return (
            f"the model was identified with a tool of {mass:g} kg, {robot.source.name} has one of "
            f"{mass_of_robot:g} kg ({weight:.3g} N of weight)"
        )


def _same(a: list[list[float]], b: list[list[float]]) -> bool:
    return np.shape(a) == np.shape(b) and bool(
        np.allclose(a, b, rtol=_NUMBER_TOLERANCE, atol=_ZERO_TOLERANCE)
    )
