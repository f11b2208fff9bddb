"""Clearance of an arm from itself, the floor and a workpiece: of postures and of whole motions."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from wrenchsight.diagrams.distances.arm_shapes import ArmShapes
from wrenchsight.diagrams.scenario import BladeConfig, PlateConfig
from wrenchsight.diagrams.workpiece import add_workpiece
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

INFLUENCE = 0.12  # m, beyond which a pair of shapes does not count
SHARPNESS = 400.0  # 1/m, of the smooth minimum: 2 mm below the true one for two equal pairs
_FINEST = 1e-4  # s, shortest interval of a motion that is looked at
_LARGEST_SCALE = 10.0  # of a pair that must keep little, so that its gradient stays smooth


@dataclass(frozen=True)
class ClosestPair:
    """The two shapes that come closest in a motion.

    Attributes:
        first, second: names of their links; floor or workpiece where it is one of these.
        distance: m, negative where they overlap.
        slack: m, distance less what this pair must keep.
        time: s.
    """

    first: str
    second: str
    distance: float
    slack: float
    time: float


class _Interval(NamedTuple):
    """A part of a motion that is not yet proved to be clear: its times, s, and slacks there, m."""

    start: float
    end: float
    first_slack: float
    last_slack: float


class Clearance:
    """Distances between the links of an arm, its tool and the floor.

    Four kinds of pairs are left out: links that a joint connects, links that stand on the floor,
    neighbours that never come nearer than at home, and pairs that overlap at home. The shapes of
    the last are too coarse to judge (`overlapping`). A pair that is near in the home posture, as
    the parts of a wrist are, must keep half of its distance there (`near_at_home`: names, m), every
    other pair `margin`.

    Args:
        robot: its collision shapes count.
        margin: m.
        floor: height of the floor in W, m; None for none.
        workpiece: in the cell, if any; a blade counts as its convex hull. The tool, which works on
            it, may touch it, all other links keep `margin`.
    """

    def __init__(
        self,
        robot: Robot,
        margin: float = 0.02,
        floor: float | None = 0.0,
        workpiece: PlateConfig | BladeConfig | None = None,
    ) -> None:
        def add(plant: MultibodyPlant) -> None:
            if floor is not None:
                slab = Box(10.0, 10.0, 1.0)  # Drake has no distance of half space and cylinder
                X_WF = RigidTransform([0.0, 0.0, floor - 0.5])
                material = CoulombFriction(0.5, 0.5)
                plant.RegisterCollisionGeometry(plant.world_body(), X_WF, slab, "floor", material)
            if workpiece is not None:
                add_workpiece(plant, workpiece)

        self._shapes = shapes = ArmShapes(robot, add)
        self._workpiece_shapes = {
            geometry
            for geometry in shapes.body
            if workpiece is not None and shapes.name(geometry) == "workpiece"
        }
        self._may_touch_workpiece = {
            geometry
            for geometry, body in shapes.body.items()
            if body.index() == shapes.tool.index() or shapes.level.get(body.index(), 0) == 0
        }
        self.margin = margin
        self._required: dict[tuple[Any, Any], float] = {}
        overlapping: list[str] = []
        wrist: dict[tuple[Any, Any], float] = {}
        for pair in self._shapes.pairs(robot.home, 1.5 * INFLUENCE):
            key = (pair.id_A, pair.id_B)
            if not self._workpiece_shapes.isdisjoint(key):
                continue
            first = self._shapes.level[self._shapes.body[pair.id_A].index()]
            second = self._shapes.level[self._shapes.body[pair.id_B].index()]
            if first == second:
                self._required[key] = -np.inf
            elif pair.distance <= 0.0:
                self._required[key] = -np.inf
                overlapping.append(" and ".join(self._shapes.name(shape) for shape in key))
            else:
                self._required[key] = min(margin, 0.5 * pair.distance)
                if abs(first - second) <= 2:
                    wrist[key] = pair.distance
        self._drop_always_clear(robot, wrist)
        self.overlapping = tuple(dict.fromkeys(overlapping))
        near: dict[str, float] = {}
        for key, required in self._required.items():
            if np.isfinite(required) and required < margin:
                names = " and ".join(self._shapes.name(shape) for shape in key)
                near[names] = min(required, near.get(names, np.inf))
        self.near_at_home = tuple(near.items())
        self.has_shapes = len(self._shapes.body) > (0 if floor is None else 1)
        self._speed_radius = _speed_radius(robot)

    def _drop_always_clear(self, robot: Robot, pairs: dict[tuple[Any, Any], float]) -> None:
        """Leaves out neighbours that never come nearer to each other than at home.

        Only shapes two joints apart at most: 300 postures cover the motions of two joints densely.
        """
        rng = np.random.default_rng(0)
        low = np.clip(robot.position_lower, -np.pi, np.pi)
        high = np.clip(robot.position_upper, -np.pi, np.pi)
        nearest = dict(pairs)
        for q in rng.uniform(low, high, (300 if pairs else 0, robot.num_joints)):
            for pair in self._shapes.pairs(q, max(pairs.values())):
                key = (pair.id_A, pair.id_B)
                if key in nearest:
                    nearest[key] = min(nearest[key], pair.distance)
        for key, distance in nearest.items():
            if distance > 0.95 * pairs[key]:
                self._required[key] = -np.inf

    def reaches_floor(self, q: ArrayLike) -> bool:
        """Whether a moving shape touches the floor at q (n,), at home or not."""
        return any(
            pair.distance <= 0.0
            and "floor" in (self._shapes.name(pair.id_A), self._shapes.name(pair.id_B))
            for pair in self._shapes.pairs(q, 1e-3)
            if any(
                self._shapes.level[self._shapes.body[shape].index()]
                for shape in (pair.id_A, pair.id_B)
            )
        )

    def is_free(self, q: ArrayLike) -> bool:
        """Whether nothing is nearer than it may be at q (n,)."""
        return all(pair.slack >= 0.0 for pair in self.slacks(q, self.margin))

    def slacks(self, q: ArrayLike, influence: float = INFLUENCE) -> list[ClosestPair]:
        """The pairs of shapes within `influence` (m) at q (n,), with their slacks; time 0."""
        pairs = []
        for pair in self._shapes.pairs(q, influence):
            slack = pair.distance - self._requirement(pair)
            if np.isfinite(slack):
                pairs.append(
                    ClosestPair(
                        first=self._shapes.name(pair.id_A),
                        second=self._shapes.name(pair.id_B),
                        distance=pair.distance,
                        slack=slack,
                        time=0.0,
                    )
                )
        return pairs

    def slack(self, q: ArrayLike) -> float:
        """Smallest slack at q (n,), m; INFLUENCE where nothing is near."""
        slacks = [
            pair.distance - self._requirement(pair) for pair in self._shapes.pairs(q, INFLUENCE)
        ]
        return float(min([INFLUENCE, *slacks]))

    def smooth_slack(self, q: ArrayLike) -> tuple[float, Array]:
        """A smooth value (m), positive where `slack` is, and its gradient (n,) by q.

        -1/k ln sum exp(-k slack_i), k = SHARPNESS, over all pairs and one that is always at
        INFLUENCE. A pair that must keep less than the margin, as the parts of a wrist, counts in
        its own measure, margin / required: what a caller keeps in reserve then fits it too.
        """
        plant, context = self._shapes.plant, self._shapes.context
        pairs = [p for p in self._shapes.pairs(q, INFLUENCE) if np.isfinite(self._requirement(p))]
        required = np.array([self._requirement(pair) for pair in pairs] + [self.margin])
        scale = np.clip(self.margin / np.maximum(required, 1e-9), 1.0, _LARGEST_SCALE)
        distance = np.array([pair.distance for pair in pairs] + [INFLUENCE + self.margin])
        slack = scale * (distance - required)
        lowest = float(slack.min())
        share = np.exp(-SHARPNESS * (slack - lowest))
        total = float(share.sum())
        share *= scale
        gradient = np.zeros(plant.num_velocities())
        world = plant.world_frame()
        for pair, part in zip(pairs, share / total, strict=False):
            if part < 1e-6:
                continue
            for sign, shape, point in ((1.0, pair.id_A, pair.p_ACa), (-1.0, pair.id_B, pair.p_BCb)):
                frame = self._shapes.body[shape].body_frame()
                X_FG = self._shapes.inspector.GetPoseInFrame(shape)
                J = plant.CalcJacobianTranslationalVelocity(
                    context, JacobianWrtVariable.kQDot, frame, X_FG @ point, world, world
                )
                gradient += part * sign * (pair.nhat_BA_W @ J)
        return lowest - float(np.log(total)) / SHARPNESS, gradient[self._shapes.order]

    def certify(
        self,
        position: Callable[[float], Array],
        speed: Array,
        duration: float,
    ) -> tuple[bool, ClosestPair | None]:
        """Whether a motion keeps clear at every time, not only at samples.

        Samples, a tenth of a second apart or closer, must keep what is required of each pair; half
        of it is proved for all times. No point of the arm moves faster than sum_j speed_j r_j, r_j
        the farthest that it can be from joint j. Between two times with slack s_0 and s_1 the slack
        therefore stays above (s_0 + s_1 - speed * time between) / 2, with twice that speed for two
        moving links. Where this bound
        proves less, the interval is halved. It counts as not clear once it is shorter than _FINEST.

        Args:
            position: from time in s to q (n,).
            speed: (n,) rad/s, bound of each joint's speed.
            duration: s.

        Returns:
            Whether it keeps clear, and the pair with the least slack; None where nothing is near.
        """
        fastest = 2.0 * float(speed @ self._speed_radius)
        required = [value for value in self._required.values() if np.isfinite(value)]
        allowance = 0.5 * min([self.margin, *required])
        worst: ClosestPair | None = None

        def lowest_slack(t: float) -> float:
            nonlocal worst
            pairs = self.slacks(position(t))
            if not pairs:
                return INFLUENCE
            pair = min(pairs, key=lambda pair: pair.slack)
            if worst is None or pair.slack < worst.slack:
                worst = replace(pair, time=t)
            return pair.slack

        times = np.linspace(0.0, duration, max(2, round(duration / 0.1) + 1))
        slacks = [lowest_slack(float(t)) for t in times]
        intervals = [
            _Interval(times[k], times[k + 1], slacks[k], slacks[k + 1])
            for k in range(len(times) - 1)
        ]
        is_clear = min(slacks) >= 0.0
        while intervals and is_clear:
            interval = intervals.pop()
            length = interval.end - interval.start
            if interval.first_slack + interval.last_slack + 2.0 * allowance >= fastest * length:
                continue
            if length < _FINEST:
                is_clear = False
                break
            middle = 0.5 * (interval.start + interval.end)
            slack = lowest_slack(float(middle))
            is_clear = slack >= -allowance
            intervals.append(_Interval(interval.start, middle, interval.first_slack, slack))
            intervals.append(_Interval(middle, interval.end, slack, interval.last_slack))
        return is_clear, worst

    def _requirement(self, pair: Any) -> float:
        """The distance that a pair must keep, m; -inf where it does not count."""
        key = (pair.id_A, pair.id_B)
        if not self._workpiece_shapes.isdisjoint(key):
            other_shape = set(key) - self._workpiece_shapes
            may_touch = not self._may_touch_workpiece.isdisjoint(other_shape)
            return -np.inf if may_touch else self.margin
        return self._required.get(key, self.margin)


def _speed_radius(robot: Robot) -> Array:
    """(n,) m: farthest that a point of the arm can be from each joint's axis."""
    chain = robot.chain
    links = np.linalg.norm(chain.p_PJ, axis=1)
    tool = float(np.linalg.norm(chain.p_LE))
    outer_length = np.array([links[j + 1 :].sum() for j in range(robot.num_joints)]) + tool
    # Shapes stick out beyond the joints' origins by less than 0.2 m; a prismatic joint moves all
    # points alike, and stretches what the joints before it carry.
    stroke = np.where(chain.prismatic, robot.position_upper - robot.position_lower, 0.0)
    outer_stroke = np.array([stroke[j + 1 :].sum() for j in range(robot.num_joints)])
    return np.where(chain.prismatic, 1.0, outer_length + outer_stroke + 0.2)
