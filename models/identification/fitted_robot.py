"""What robot.yaml said when a model was identified: with other numbers its readings are wrong."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot

_TOLERANCE = 1e-6  # of a number: YAML keeps what a person wrote


@dataclass
class FittedRobot:
    """The keys of a robot.yaml that the numbers of a model rest on."""

    torque_per_ampere: list[float] = field(default_factory=list)  # N m/A on the joint side
    current_sign: list[float] = field(default_factory=list)  # +1 or -1
    gravity: list[float] = field(default_factory=list)  # in W, m/s^2
    tool_mass: float | None = None  # kg; 0: without a tool; None: a load has been added since
    tool_com: list[float] = field(default_factory=list)  # m, in the flange
    coupling: list[list[float]] = field(default_factory=list)  # of joints; empty: none

    @classmethod
    def of(cls, robot: Robot) -> "FittedRobot":
        """What `robot` says now."""
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
                "set it back, or identify again; if it is meant, say --other-robot",
            )

    def differences(self, robot: Robot) -> list[tuple[str, str]]:
        """The keys that every torque depends on and that differ, each with what differs."""
        now = FittedRobot.of(robot)
        found: list[tuple[str, str]] = []
        if self.torque_per_ampere and not _same(self.coupling, now.coupling):
            then = self.coupling or "no coupling of joints"
            has = now.coupling or "none"
            found.append(
                ("coupling", f"the model was identified with {then}, {robot.source} has {has}")
            )
        for key in ("torque_per_ampere", "current_sign", "gravity"):
            kept, own = getattr(self, key), getattr(now, key)
            if not kept:
                continue
            if len(kept) != len(own):
                found.append((key, f"{len(kept)} numbers, expected {len(own)}"))
                continue
            for j in np.flatnonzero(~np.isclose(kept, own, rtol=_TOLERANCE, atol=1e-12)):
                place = f"component {j + 1}" if key == "gravity" else robot.joint_names[j]
                found.append(
                    (
                        key,
                        f"the model was identified with {kept[j]:g} ({place}), {robot.source} has "
                        f"{own[j]:g}",
                    )
                )
        return found

    def doubts(self, robot: Robot) -> list[str]:
        """What differs and may be meant: one sentence each."""
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
        now = FittedRobot.of(robot)
        then = [self.tool_mass, *(self.tool_mass * x for x in self.tool_com)]
        mass = now.tool_mass or 0.0
        found = [mass, *(mass * x for x in now.tool_com)]
        return len(then) != len(found) or not np.allclose(then, found, rtol=1e-6, atol=1e-9)

    def tool_difference(self, robot: Robot) -> str:
        """Both tools, and the weight that they differ by, for a message."""
        mass, now = self.tool_mass or 0.0, FittedRobot.of(robot).tool_mass or 0.0
        weight = abs(now - mass) * float(np.linalg.norm(robot.gravity))
        return (
            f"the model was identified with a tool of {mass:g} kg, {robot.source.name} has one of "
            f"{now:g} kg ({weight:.3g} N of weight)"
        )


def _same(a: list[list[float]], b: list[list[float]]) -> bool:
    return np.shape(a) == np.shape(b) and bool(np.allclose(a, b, rtol=_TOLERANCE, atol=1e-12))
