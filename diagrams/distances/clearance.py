"""Clearance of an arm from itself, the floor and a workpiece: of postures and of whole motions."""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Box, GeometryId, SignedDistancePair
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import Context

from wrenchsight.diagrams.distances.arm_shapes import ArmShapes
from wrenchsight.diagrams.scenario import BladeConfig, PlateConfig
from wrenchsight.diagrams.workpiece import add_workpiece
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.joint_ranges import ranges_of_postures
from wrenchsight.models.planning.placement.placement_task import (
    FLOOR,
    WORKPIECE,
    ObstacleConfig,
)
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import pose_of

# m. A pair that is farther than it, in `smooth_slack` and `slack` farther by it than the margin, is
# not looked at: larger ones cost more distances for each posture.
INFLUENCE_DISTANCE = 0.12
# 1/m, of the smooth minimum: 2 mm below the true one for two equal pairs. Larger ones make the
# gradient turn more sharply where another pair becomes the nearest.
MINIMUM_SHARPNESS = 400.0
# m, slack that the smooth minimum has where nothing is near. Pairs enter it with the slack
# INFLUENCE_DISTANCE or more. This is less by ten e-folds of their shares, so that an entry moves
# the value by 0.1 um at most. Less still would tell fewer distances apart.
_FAR_SLACK = INFLUENCE_DISTANCE - 10.0 / MINIMUM_SHARPNESS
# Of a pair's distance at home, that it must keep where this is less than the margin: it may come
# nearer than at home, as parts of a wrist do, and does not touch.
_KEPT_SHARE_OF_HOME = 0.5
# m, within which pairs at home are looked at; with a large margin it is more (`_required_by_home`).
_NEAR_AT_HOME = 1.5 * INFLUENCE_DISTANCE
# Of the distance at home. A pair that never comes below it counts as one that never comes nearer:
# the rest is for joints that move it by little, and for rounding.
_NEVER_NEARER_SHARE = 0.95
# Random postures, in which neighbours are looked at: in the plane of two joints' positions they are
# a seventeenth of the ranges apart.
_NEIGHBOUR_POSTURES = 300
# Of random postures, in which two links on both sides of one joint overlap: from here on their
# shapes are judged too coarse. A maker's limits keep the two apart; where they do not quite, as
# between an upper arm and what is mounted behind the elbow, it is in less than half of the range.
_COARSE_SHARE = 0.5
_COARSE_POSTURES = 100  # random ones, in which such pairs are counted
# s, shortest interval of a motion that is halved. Of links that move at 1 m/s to each other, slacks
# within 0.05 mm of the least that is allowed may then remain without proof.
_MIN_INTERVAL = 1e-4
_SLACK_ACCURACY = 2e-3  # m, to which the least slack of a motion is known
_FLOOR_SIZE = (10.0, 10.0, 1.0)  # m, of the floor
# m that a program of postures requires beyond what must be kept, for what happens between them;
# distances are exact to some micrometres.
DISTANCE_ROUNDING = 1e-3
_MAX_PROTRUSION = 3e-3  # m, by which a shape may stand out beyond the part that it covers
_MAX_SUNK_BASE = 0.01  # m, by which the shape of a base may reach into the table it stands on
_SAME_DISTANCE = 1e-6  # m; distances of curved shapes are exact to that
_BOX_CORNERS = tuple(itertools.product((-1.0, 1.0), repeat=3))  # of a box
_MAX_SAMPLE_PERIOD = 0.1  # s, between the times at which a motion is looked at first
_MIN_REQUIRED = 1e-9  # m, that stands for 0 in a quotient by what a pair must keep
# Of a slack in the smooth minimum (`_scales`), whose rate by distance it is: with a larger one the
# gradient turns more sharply where a pair that must keep little becomes the nearest.
_LARGEST_SCALE = 10.0
# Of a pair in the gradient, below which its two Jacobians are not computed: less than a solver that
# rounds its gradients to 1e-6 sees.
_MIN_GRADIENT_SHARE = 1e-6


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


class _FoundPairs(NamedTuple):
    """Pairs of shapes that were found near each other at a posture.

    Attributes:
        pairs: as Drake states them.
        context: the plant's, at this posture until the next search moves it: `ArmShapes` has one.
    """

    pairs: list[SignedDistancePair]
    context: Context


class _Interval(NamedTuple):
    """A part of a motion that is not yet proved to be clear.

    Attributes:
        start, end: s.
        first_slack, last_slack: (n + 1, n + 1) m, least slacks there as `_LeastSlacks.at`.
    """

    start: float
    end: float
    first_slack: Array
    last_slack: Array


@dataclass
class _LeastSlacks:
    """The least slacks of a motion at the times that are asked for.

    Attributes:
        by_levels_at: least slacks at a time, s, of the pairs within INFLUENCE_DISTANCE, by the
            levels of their shapes, and the pair with the least of all.
        num_levels: number of joints and the world.
        far_slack: m, that no pair beyond INFLUENCE_DISTANCE is below.
        worst: pair with the least slack at all times so far; None: nothing has been near.
    """

    by_levels_at: Callable[[float], tuple[dict[tuple[int, int], float], ClosestPair | None]]
    num_levels: int
    far_slack: float
    worst: ClosestPair | None = None

    def at(self, t: float) -> Array:
        """(n + 1, n + 1) m, the least slacks at a time in s by the lower and the higher level.

        `far_slack` stands where it is that or more.
        """
        by_levels, closest = self.by_levels_at(t)
        if closest is not None and (self.worst is None or closest.slack < self.worst.slack):
            self.worst = replace(closest, time=t)
        slacks = np.full((self.num_levels, self.num_levels), self.far_slack)
        for levels, slack in by_levels.items():
            slacks[levels] = min(slack, self.far_slack)
        return slacks

    def is_known(self, lowest: float) -> bool:
        """Whether slacks of `lowest` (m) or more leave the least one as it is, to the accuracy."""
        return self.worst is None or lowest >= self.worst.slack - _SLACK_ACCURACY


def _stays_above(
    bound: float, least_slacks: _LeastSlacks, intervals: Sequence[_Interval], fastest: Array
) -> bool:
    """Whether it is proved that no slack of a motion is below a bound in some intervals.

    Between two times with slacks s_0 and s_1 of two levels no slack of theirs is below

        (s_0 + s_1 - fastest (t_1 - t_0)) / 2

    as it falls and rises at `fastest` at most. Where this is below the bound, or below the least
    slack that has been seen by more than _SLACK_ACCURACY, the interval is halved. The proof fails
    where a slack is found below the bound, or this is below it in an interval shorter than
    _MIN_INTERVAL.

    Args:
        bound: m.
        least_slacks: slacks of the motion at any time.
        intervals: with slacks that are not below the bound.
        fastest: (n + 1, n + 1) m/s, at which a distance between two levels changes at most.
    """
    unproved = list(intervals)  # in any order
    while unproved:
        interval = unproved.pop()
        length = interval.end - interval.start
        ends = interval.first_slack + interval.last_slack
        lowest = 0.5 * float((ends - fastest * length).min())
        is_short = length < _MIN_INTERVAL
        if lowest >= bound and (is_short or least_slacks.is_known(lowest)):
            continue
        if is_short:
            return False
        middle = 0.5 * (interval.start + interval.end)
        slack = least_slacks.at(middle)
        if slack.min() < bound:
            return False
        unproved.append(_Interval(interval.start, middle, interval.first_slack, slack))
        unproved.append(_Interval(middle, interval.end, slack, interval.last_slack))
    return True


class Clearance:
    """Distances between the links of an arm, its tool, the floor, obstacles and a workpiece.

    The slack of a pair of shapes is its distance less what the pair must keep:

        kind of pair   must keep             which
        near at home   half its distance at  of the arm or with the floor, where this half is less
                       home                  than `margin`, as between the parts of a wrist
        resting        0                     a workpiece that floats with the floor or an obstacle,
                                             on which it may lie
        left out       nothing: does not     see below
                       count
        other          `margin`              all others

    Left out, whatever their distance, are pairs of these kinds:

        jointed        two links that one joint connects; Drake itself does not state their distance
        rigid          no joint lies between the two, as between parts that stand on the floor
        overlapping    the two overlap at home: their shapes are too coarse to judge
        coarse         one joint lies between the two, and they overlap in half of its range or more
        always clear   neighbours, with two joints between them or fewer, that never come nearer to
                       each other than at home
        working        the workpiece and what may touch it: the tool, or its shapes at E alone

    Args:
        robot: its collision shapes count.
        margin: m, least distance of a pair that was not near at home.
        floor: height of the floor in W, m; None for none.
        workpiece: in the cell, if any; a blade counts as its convex hull.
        obstacles: boxes that stand in the cell; all links that move keep `margin`.
        add: adds what else there is to the plant, as a body that floats; its shapes of the name
            WORKPIECE count as a workpiece.
        tip_only: whether of the tool only the shapes at E may touch the workpiece, not the whole.

    Attributes:
        shapes: the plant with all of them.
        margin: m, as given.
        overlapping: pairs of this kind, by the names of their links ("A and B").
        coarse: pairs of this kind that do not overlap at home, by the same names, with the share of
            the range in which they overlap.
        near_at_home: pairs of this kind, by the same names, with what they must keep, m.
        has_shapes: whether the arm has any.
    """

    def __init__(
        self,
        robot: Robot,
        margin: float = 0.02,
        floor: float | None = 0.0,
        workpiece: PlateConfig | BladeConfig | None = None,
        *,
        obstacles: Sequence[ObstacleConfig] = (),
        add: Callable[[MultibodyPlant], None] = lambda plant: None,
        tip_only: bool = False,
    ) -> None:
        def add_surroundings(plant: MultibodyPlant) -> None:
            _add_surroundings(plant, floor, obstacles, workpiece)
            add(plant)

        self.shapes = ArmShapes(robot, add_surroundings)
        self.margin = margin
        self._tell_shapes_apart(obstacles, tip_only)
        self._require(robot)
        self.has_shapes = bool(self._arm_shapes)
        # (n,) m: no point of the arm is farther from the axis of joint j than entry j.
        self._speed_radius = _speed_radius(robot, self.shapes)

    def _tell_shapes_apart(self, obstacles: Sequence[ObstacleConfig], tip_only: bool) -> None:
        """Sets the sets of geometry ids: of arm, workpiece, floor and obstacles.

        The arm's are those of its links and of its tool. The others are told by name: a task
        refuses an obstacle that is called as the floor or the workpiece.
        """
        shapes = self.shapes
        self._arm_shapes = {
            shape
            for shape, body in shapes.body.items()
            if body.model_instance() == shapes.parts.model_instance
        }
        self._workpiece_shapes = self._others_named({WORKPIECE})
        self._floor_shapes = self._others_named({FLOOR})
        self._obstacle_shapes = self._others_named({box.name for box in obstacles})
        self._may_touch_workpiece = (
            _working_shapes(shapes, self.margin) if tip_only else self._tool_shapes()
        )

    def _require(self, robot: Robot) -> None:
        """Sets what a pair of shapes (two ids) must keep, m, where it is not `margin`.

        -inf: the pair is left out. The home posture says what pairs of arm and floor must keep. Of
        a workpiece and obstacles it follows from what may touch them. Pairs of the home posture
        have the order in which Drake states them, always the same for two shapes; the others are
        there in either order. No pair is in both.
        """
        arm_and_floor = self.shapes.body.keys() - self._workpiece_shapes - self._obstacle_shapes
        by_home, self.overlapping = self._required_by_home(robot, arm_and_floor)
        coarse = self._coarse(robot, by_home)
        by_home |= dict.fromkeys(coarse, -np.inf)
        shares: dict[str, float] = {}  # of several shapes of two links the largest
        for pair, share in coarse.items():
            names = self._names(pair)
            shares[names] = max(share, shares.get(names, 0.0))
        self.coarse = tuple(shares.items())
        self.near_at_home = self._less_than_margin(by_home)
        self._required: dict[tuple[Any, Any], float] = by_home | self._required_of_others()
        self._known_pairs: dict[tuple[Any, Any], tuple[float, tuple[int, int]]] = {}

    def _tool_shapes(self) -> set[Any]:
        """Shapes of the tool, or of the link that E lies on."""
        tool = self.shapes.tool.index()
        return {shape for shape in self._arm_shapes if self.shapes.body[shape].index() == tool}

    def _less_than_margin(
        self, requirements: dict[tuple[Any, Any], float]
    ) -> tuple[tuple[str, float], ...]:
        """Pairs that must keep less than the margin, and what, m, by name.

        Of several shapes of two links the least counts.
        """
        least: dict[str, float] = {}
        for pair, required in requirements.items():
            if np.isfinite(required) and required < self.margin:
                names = self._names(pair)
                least[names] = min(required, least.get(names, np.inf))
        return tuple(least.items())

    def _others_named(self, names: set[str]) -> set[Any]:
        """Shapes of these names that are none of the arm's."""
        others = self.shapes.body.keys() - self._arm_shapes
        return {shape for shape in others if self.shapes.name(shape) in names}

    def base_in_obstacles(self, robot: Robot) -> dict[tuple[str, str], float]:
        """Obstacles that the standing base reaches into: names of link and obstacle; depth, m."""
        depths: dict[tuple[str, str], float] = {}
        still = [shape for shape in self.shapes.body if self._level(shape) == 0]
        for shape, obstacle in itertools.product(still, still):
            if shape not in self._arm_shapes or obstacle not in self._obstacle_shapes:
                continue
            depth = -self.shapes.distance(robot.home, shape, obstacle)
            key = (self.shapes.name(shape), self.shapes.name(obstacle))
            if depth > _MAX_SUNK_BASE:
                depths[key] = max(depth, depths.get(key, 0.0))
        return depths

    def _names(self, pair: tuple[Any, Any]) -> str:
        return " and ".join(self.shapes.name(shape) for shape in pair)

    def _required_by_home(
        self, robot: Robot, arm_and_floor: set[Any]
    ) -> tuple[dict[tuple[Any, Any], float], tuple[str, ...]]:
        """What pairs of shapes of arm and floor must keep, by their distances at home.

        Args:
            robot: the arm.
            arm_and_floor: ids of these shapes.

        Returns:
            m, by the ids of the two shapes, in the order in which Drake states them; -inf of a pair
            that is left out. Pairs that are not in it must keep the margin, but for jointed ones,
            whose distance Drake never states. And the names of overlapping pairs.
        """
        # m. A pair farther than margin / _KEPT_SHARE_OF_HOME must keep the margin in any case. Of a
        # small margin _NEAR_AT_HOME is more, so that rigid and always clear pairs are found, and
        # left out, as far as `smooth_slack` reaches.
        near = max(_NEAR_AT_HOME, self.margin / _KEPT_SHARE_OF_HOME)
        at_home = {
            (pair.id_A, pair.id_B): pair.distance
            for pair in self.shapes.pairs(robot.home, near)
            if arm_and_floor.issuperset((pair.id_A, pair.id_B))
        }
        rigid = {pair for pair in at_home if self._is_rigid(pair)}
        overlapping = {pair for pair, distance in at_home.items() if distance <= 0.0} - rigid
        neighbours = {
            pair: distance
            for pair, distance in at_home.items()
            if self._are_neighbours(pair) and pair not in rigid | overlapping
        }
        left_out = rigid | overlapping | self._always_clear(robot, neighbours)
        requirements = {
            pair: -np.inf if pair in left_out else min(self.margin, _KEPT_SHARE_OF_HOME * distance)
            for pair, distance in at_home.items()
        }
        names = [self._names(pair) for pair in at_home if pair in overlapping]
        return requirements, tuple(dict.fromkeys(names))  # each once: a link may have many shapes

    def _is_rigid(self, pair: tuple[Any, Any]) -> bool:
        """Whether no joint lies between two shapes: their distance never changes."""
        return self._level(pair[0]) == self._level(pair[1])

    def _are_neighbours(self, pair: tuple[Any, Any]) -> bool:
        """Whether two joints lie between two shapes, or fewer."""
        return abs(self._level(pair[0]) - self._level(pair[1])) <= 2

    def _level(self, shape: Any) -> int:
        return self.shapes.level.get(self.shapes.body[shape].index(), 0)

    def _required_of_others(self) -> dict[tuple[Any, Any], float]:
        """What all pairs with the workpiece or an obstacle must keep, m, in either order."""
        requirements: dict[tuple[Any, Any], float] = {}
        stated = self._workpiece_shapes | self._obstacle_shapes
        for shape in (shape for shape in self.shapes.body if shape in stated):
            is_workpiece = shape in self._workpiece_shapes
            is_fixed = self.shapes.body[shape].index() == self.shapes.plant.world_body().index()
            for other in self.shapes.body:
                if other in self._arm_shapes and is_workpiece:
                    is_working = other in self._may_touch_workpiece
                    is_rigid = is_fixed and self._level(other) == 0
                    required = -np.inf if is_working or is_rigid else self.margin
                elif other in self._arm_shapes:  # and `shape` is an obstacle's
                    required = -np.inf if self._level(other) == 0 else self.margin  # -inf: rigid
                elif is_workpiece and not is_fixed:
                    is_rigid = other in self._workpiece_shapes
                    required = -np.inf if is_rigid else 0.0  # 0: resting
                else:
                    continue  # both stand still, or the other way round
                requirements[shape, other] = requirements[other, shape] = required
        return requirements

    def left_out(self) -> list[tuple[Any, Any]]:
        """Pairs of shapes whose distance does not count."""
        return [pair for pair, required in self._required.items() if required == -np.inf]

    def small_requirements(self) -> dict[tuple[Any, Any], float]:
        """Pairs of shapes that must keep less than the margin, with what they must keep, m.

        A workpiece that may lie on an obstacle must keep 0.
        """
        small: dict[tuple[Any, Any], float] = {}
        for (first, second), required in self._required.items():
            if np.isfinite(required) and required < self.margin and (second, first) not in small:
                small[first, second] = required
        return small

    def _always_clear(
        self, robot: Robot, neighbours: dict[tuple[Any, Any], float]
    ) -> set[tuple[Any, Any]]:
        """Those of the neighbours that never come nearer to each other than at home.

        Judged in random postures, the same in every run: that is evidence, no proof. A pair counts
        as never nearer if it keeps _NEVER_NEARER_SHARE of its distance at home in all of them.

        Args:
            robot: the arm.
            neighbours: pairs with their distances at home, m.
        """
        if not neighbours:
            return set()
        nearest = dict(neighbours)  # m, distances at home and in all postures
        # No neighbour is farther apart at home: one that is beyond has not come nearer.
        farthest_at_home = max(neighbours.values())
        ranges = ranges_of_postures(
            robot.position_lower, robot.position_upper, robot.chain.prismatic
        )
        rng = np.random.default_rng(0)
        for q in rng.uniform(*ranges, (_NEIGHBOUR_POSTURES, robot.num_joints)):
            for pair in self.shapes.pairs(q, farthest_at_home):
                key = (pair.id_A, pair.id_B)
                if key in nearest:
                    nearest[key] = min(nearest[key], pair.distance)
        return {
            pair
            for pair, distance in nearest.items()
            if distance > _NEVER_NEARER_SHARE * neighbours[pair]
        }

    def _coarse(
        self, robot: Robot, by_home: dict[tuple[Any, Any], float]
    ) -> dict[tuple[Any, Any], float]:
        """Pairs of the arm's shapes that are coarse, with the share of postures of overlap.

        Args:
            robot: the arm.
            by_home: what pairs must keep by their distances at home; those left out are not looked
                at.
        """
        counts: Counter[tuple[Any, Any]] = Counter()
        ranges = ranges_of_postures(
            robot.position_lower, robot.position_upper, robot.chain.prismatic
        )
        rng = np.random.default_rng(0)
        for q in rng.uniform(*ranges, (_COARSE_POSTURES, robot.num_joints)):
            counts.update(
                (pair.id_A, pair.id_B)
                for pair in self.shapes.pairs(q, 0.0)
                if self._arm_shapes.issuperset((pair.id_A, pair.id_B))
                and abs(self._level(pair.id_A) - self._level(pair.id_B)) == 1
            )
        shares = {pair: count / _COARSE_POSTURES for pair, count in counts.items()}
        return {
            pair: share
            for pair, share in shares.items()
            if share >= _COARSE_SHARE and by_home.get(pair) != -np.inf
        }

    def coarse_notes(self) -> list[str]:
        """A sentence on each pair of `coarse`."""
        return [
            f"{pair} overlap in {100.0 * share:.0f} % of the range of the one joint between them: "
            "their shapes are too coarse, and contact between them is not checked; if the joint "
            "must not go there, narrow its limits in the URDF"
            for pair, share in self.coarse
        ]

    def reaches_floor(self, q: ArrayLike) -> bool:
        """Whether a moving shape touches the floor at q (n,), at home or not."""
        return any(
            pair.distance <= 0.0
            and not self._floor_shapes.isdisjoint((pair.id_A, pair.id_B))
            and any(self._level(shape) for shape in (pair.id_A, pair.id_B))
            for pair in self.shapes.pairs(q, 1e-3)
        )

    def lowest_at_rest(self) -> tuple[float, str] | None:
        """Height in W, m, of the lowest point of the robot's parts that stand still, and its link.

        A mesh counts as its convex hull, another shape as its box. None: none of them has a shape.
        """
        heights = []
        for shape in (shape for shape in self.shapes.body if shape in self._arm_shapes):
            corners = _corners(self.shapes.inspector, shape)
            if self._level(shape) == 0 and corners.size:
                X_WF = self.shapes.body[shape].EvalPoseInWorld(self.shapes.context)
                heights.append((float((X_WF @ corners)[2].min()), self.shapes.name(shape)))
        return min(heights, default=None)

    def is_free(self, q: ArrayLike) -> bool:
        """Whether nothing is nearer than it may be at q (n,)."""
        return all(pair.slack >= 0.0 for pair in self.slacks(q, self.margin))

    def worst(
        self, q: ArrayLike, influence: float = INFLUENCE_DISTANCE, pose: ArrayLike = ()
    ) -> ClosestPair | None:
        """The pair with the least slack over postures q (N, n); None where nothing is near.

        Args:
            influence: m, beyond which a pair does not count.
            pose: (7,) quaternion and position of the body that floats, where there is one.
        """
        pairs = [pair for row in np.asarray(q) for pair in self.slacks(row, influence, pose)]
        return min(pairs, key=lambda pair: pair.slack, default=None)

    def slacks(
        self, q: ArrayLike, influence: float = INFLUENCE_DISTANCE, pose: ArrayLike = ()
    ) -> list[ClosestPair]:
        """The pairs that count within `influence` (m) at q (n,), with their slacks; time 0."""
        return [
            ClosestPair(
                first=self.shapes.name(pair.id_A),
                second=self.shapes.name(pair.id_B),
                distance=pair.distance,
                slack=pair.distance - self._requirement(pair),
                time=0.0,
            )
            for pair in self._find_pairs(q, influence, pose).pairs
        ]

    def slack(self, q: ArrayLike) -> float:
        """Smallest slack at q (n,), m; INFLUENCE_DISTANCE stands for any that is larger."""
        pairs = self._find_pairs(q, INFLUENCE_DISTANCE + self.margin).pairs
        slacks = [pair.distance - self._requirement(pair) for pair in pairs]
        return float(min([INFLUENCE_DISTANCE, *slacks]))

    def smooth_slack(self, q: ArrayLike) -> tuple[float, Array]:
        """A smooth measure of the least slack, m, and its gradient (n,) by q, m/rad (m/m).

            value    = -1/k ln(exp(-k _FAR_SLACK) + sum_i exp(-k slack_i)),  k = MINIMUM_SHARPNESS
            slack_i  = scale_i (distance_i - required_i)
            gradient = sum_i w_i scale_i d distance_i / dq,  w_i = exp(-k slack_i) / the sum in ln

        over all pairs that count within INFLUENCE_DISTANCE + margin. scale_i (`_scales`) is
        margin / required_i, 1 to _LARGEST_SCALE: so what a pair of the wrist must keep, which is
        little, weighs as the margin of others does. As no scale is below 1, a pair enters or leaves
        the sum with a slack of INFLUENCE_DISTANCE or more, ten e-folds of its term beyond
        _FAR_SLACK: that moves the value by e^-10 / k = 0.1 um at most. Where there is no pair the
        value is _FAR_SLACK. It is never more, and positive only where `slack` is.

        The gradient is that of the value, but for pairs with w_i scale_i < _MIN_GRADIENT_SHARE,
        which it leaves out.
        """
        pairs, context_at_q = self._find_pairs(q, INFLUENCE_DISTANCE + self.margin)
        distance = np.array([pair.distance for pair in pairs])
        required = np.array([self._requirement(pair) for pair in pairs])
        scale = self._scales(required)
        slack = scale * (distance - required)
        # Of all terms in the sum the largest is made 1: else they would underflow.
        least = min([_FAR_SLACK, *slack.tolist()])
        terms = np.exp(-MINIMUM_SHARPNESS * (slack - least))
        total = math.exp(-MINIMUM_SHARPNESS * (_FAR_SLACK - least)) + float(terms.sum())
        value = least - math.log(total) / MINIMUM_SHARPNESS
        gradient = np.zeros(self.shapes.plant.num_positions())  # by all positions of the plant
        for pair, share in zip(pairs, terms * scale / total, strict=True):
            if share >= _MIN_GRADIENT_SHARE:
                gradient += share * self._distance_gradient(pair, context_at_q)
        return value, gradient[self.shapes.position_indices]

    def _scales(self, required: Array) -> Array:
        """(N,) factors of slacks in the smooth minimum, by what their pairs must keep (N,), m.

        They are margin / required, at most _LARGEST_SCALE: 1 for most pairs, more for those that
        must keep less than the margin, as the parts of a wrist. What a caller keeps in reserve of
        the margin then fits them too. Where 0 must be kept, it is _LARGEST_SCALE. Without a margin
        all are 1.
        """
        quotient = self.margin / np.maximum(required, _MIN_REQUIRED)
        return np.clip(quotient, 1.0, _LARGEST_SCALE)

    def _distance_gradient(self, pair: SignedDistancePair, context: Context) -> Array:
        """(n_q,) gradient of a pair's distance by the plant's positions.

            d distance / dt = n . (v_Ca - v_Cb)

        with the shapes' nearest points Ca and Cb, and n the normal from B to A.

        Args:
            pair: as Drake states it: these points in the frames of their shapes, n in W.
            context: context of the plant, at the posture in which the pair was found.
        """
        plant, world = self.shapes.plant, self.shapes.plant.world_frame()

        def jacobian(shape: GeometryId, p_GC: Array) -> Array:
            """(3, n_q) of a shape's point, by the positions' rates; in axes of W."""
            X_FG = self.shapes.inspector.GetPoseInFrame(shape)
            return np.asarray(
                plant.CalcJacobianTranslationalVelocity(
                    context,
                    JacobianWrtVariable.kQDot,
                    self.shapes.body[shape].body_frame(),
                    X_FG @ p_GC,
                    world,
                    world,
                )
            )

        J_Ca, J_Cb = jacobian(pair.id_A, pair.p_ACa), jacobian(pair.id_B, pair.p_BCb)
        return np.asarray(pair.nhat_BA_W @ J_Ca - pair.nhat_BA_W @ J_Cb)

    def certify(
        self,
        position: Callable[[float], Array],
        speed: Array,
        duration: float,
    ) -> tuple[bool, ClosestPair | None]:
        """Whether a motion keeps clear at every time, not only at samples.

        At samples, a tenth of a second apart or closer, every pair must keep what is required of
        it: its slack is 0 or more. At all other times it is proved (`_stays_above`) that no slack
        is below -allowance. The allowance is half of the least that any pair must keep, so that
        each keeps at least half of what is required of it. It is 0 where a workpiece may rest on
        something, a pair that must keep 0. Pairs beyond INFLUENCE_DISTANCE are not looked at: they
        count with the least slack that they can have there. With a margin above it, no motion
        counts as clear.

        The distance of two links changes by the joints between them alone: in the frame of the one,
        no point of the other moves faster than the sum over these of speed_j r_j, r_j the farthest
        that it can be from joint j. All else stands still as the base does, a workpiece that
        floats as well: it stays at its default pose.

        Args:
            position: from time in s, 0 to duration, to q (n,).
            speed: (n,) rad/s (m/s of a prismatic joint), bound of each joint's speed at all times.
            duration: s.

        Returns:
            Whether it keeps clear, and the pair with the least slack, which of a motion that keeps
            clear is the least to _SLACK_ACCURACY; None where nothing is near.
        """
        # m/s, of a point at each level in the frame of the base; of two levels the difference.
        moved = np.concatenate([[0.0], np.cumsum(speed * self._speed_radius)])
        fastest = np.abs(moved - moved[:, np.newaxis])
        # m, of the pairs in `_required` that count, the 0 of a resting pair among them. Pairs that
        # are not in it must keep the margin.
        required = [value for value in self._required.values() if value > -np.inf]
        allowance = 0.5 * min([self.margin, *required])  # m, by which a slack may be below 0
        least_slacks = _LeastSlacks(
            by_levels_at=lambda t: self._least_by_levels(position(t)),
            num_levels=len(moved),
            far_slack=INFLUENCE_DISTANCE - max([self.margin, *required]),
        )
        # A millionth of a period absorbs the rounding of a duration of whole periods.
        num_periods = max(1, math.ceil(duration / _MAX_SAMPLE_PERIOD - 1e-6))
        times = np.linspace(0.0, duration, num_periods + 1).tolist()
        slacks = [least_slacks.at(t) for t in times]
        intervals = [
            _Interval(times[k], times[k + 1], slacks[k], slacks[k + 1]) for k in range(num_periods)
        ]
        is_clear = float(np.min(slacks)) >= 0.0 and _stays_above(
            -allowance, least_slacks, intervals, fastest
        )
        return is_clear, least_slacks.worst

    def _least_by_levels(
        self, q: ArrayLike
    ) -> tuple[dict[tuple[int, int], float], ClosestPair | None]:
        """Least slacks, m, at q (n,) of the pairs within INFLUENCE_DISTANCE, and the least pair.

        Returns:
            By the lower and the higher level of the two shapes. And the pair with the least slack
            of all, time 0; None where nothing is near.
        """
        least: dict[tuple[int, int], float] = {}
        closest, closest_slack = None, np.inf
        for pair in self.shapes.pairs(q, INFLUENCE_DISTANCE):
            required, levels = self._required_and_levels(pair.id_A, pair.id_B)
            slack = pair.distance - required
            if slack < least.get(levels, np.inf):
                least[levels] = slack
                if slack < closest_slack:
                    closest, closest_slack = pair, slack
        if closest is None:
            return least, None
        names = self.shapes.name(closest.id_A), self.shapes.name(closest.id_B)
        return least, ClosestPair(*names, closest.distance, closest_slack, time=0.0)

    def _required_and_levels(
        self, first: GeometryId, second: GeometryId
    ) -> tuple[float, tuple[int, int]]:
        """What two shapes must keep, m, and their levels, the lower first; remembered."""
        known = self._known_pairs.get((first, second))
        if known is None:
            low, high = sorted((self._level(first), self._level(second)))
            known = self._required.get((first, second), self.margin), (low, high)
            self._known_pairs[first, second] = known
        return known

    def _find_pairs(self, q: ArrayLike, influence: float, pose: ArrayLike = ()) -> _FoundPairs:
        """The pairs within `influence` (m) that are not left out, as `ArmShapes.pairs`."""
        pairs = self.shapes.pairs(q, influence, pose)
        counting = [pair for pair in pairs if self._requirement(pair) > -np.inf]
        return _FoundPairs(counting, self.shapes.context)  # which `pairs` has put at q

    def _requirement(self, pair: SignedDistancePair) -> float:
        """The distance that a pair must keep, m; -inf of one that is left out."""
        return self._required.get((pair.id_A, pair.id_B), self.margin)


def _add_surroundings(
    plant: MultibodyPlant,
    floor: float | None,
    obstacles: Sequence[ObstacleConfig],
    workpiece: PlateConfig | BladeConfig | None,
) -> None:
    """Adds what stands around the arm, as `Clearance` has it, to a plant that is not finalized."""
    if floor is not None:
        slab = Box(*_FLOOR_SIZE)  # Drake has no distance of half space and cylinder
        X_WF = RigidTransform([0.0, 0.0, floor - 0.5 * _FLOOR_SIZE[2]])
        _fix(plant, X_WF, slab, FLOOR)
    for obstacle in obstacles:
        _fix(plant, pose_of(obstacle.pose), Box(*obstacle.size), obstacle.name)
    if workpiece is not None:
        add_workpiece(plant, workpiece)


def _fix(plant: MultibodyPlant, X_WG: RigidTransform, shape: Any, name: str) -> None:
    """Fixes a shape in the world."""
    friction = CoulombFriction(0.5, 0.5)
    plant.RegisterCollisionGeometry(plant.world_body(), X_WG, shape, name, friction)


def _working_shapes(shapes: ArmShapes, margin: float) -> set[Any]:
    """Shapes fixed to E that cannot keep the margin from a workpiece on which E stands.

    They are the shape that E is nearest to, and those that end at the plane through E across its z
    axis, where the workpiece begins.
    """
    frame_E = shapes.parts.frame_E
    welded = {body.index() for body in shapes.plant.GetBodiesWeldedTo(frame_E.body())}
    X_WE = frame_E.CalcPoseInWorld(shapes.context)
    query = shapes.plant.get_geometry_query_input_port().Eval(shapes.context)
    distances = {
        found.id_G: float(found.distance)
        for found in query.ComputeSignedDistanceToPoint(X_WE.translation())
        if shapes.body[found.id_G].index() in welded
    }
    nearest = min(distances.values(), default=0.0) + _SAME_DISTANCE
    working = {shape for shape, distance in distances.items() if distance <= nearest}
    for shape in distances:
        X_WF = shapes.body[shape].EvalPoseInWorld(shapes.context)
        corners = box_corners(shapes.inspector, shape)
        end = (X_WE.inverse() @ X_WF @ corners)[2].max() if corners.size else np.inf
        if abs(end) <= margin + DISTANCE_ROUNDING + _MAX_PROTRUSION:
            working.add(shape)
    return working


def box_corners(inspector: Any, shape: Any) -> Array:
    """(3, 8) corners of a shape's box in its link's frame, m; (3, 0) of a shape without one."""
    box = inspector.GetObbInGeometryFrame(shape)
    if box is None:
        return np.empty((3, 0))
    corners = (np.array(_BOX_CORNERS) * box.half_width()).T
    return np.asarray(inspector.GetPoseInFrame(shape) @ box.pose() @ corners)


def _corners(inspector: Any, shape: Any) -> Array:
    """(3, N) corners of a mesh's convex hull, or of a shape's box, in its link's frame, m."""
    hull = inspector.GetConvexHull(shape)
    if hull is None:
        return box_corners(inspector, shape)
    corners = np.array([hull.vertex(k) for k in range(hull.num_vertices())]).T
    return np.asarray(inspector.GetPoseInFrame(shape) @ corners)


def _speed_radius(robot: Robot, shapes: ArmShapes) -> Array:
    """(n,) m: farthest that a point of the arm's shapes can be from each joint's axis."""
    chain, n = robot.chain, robot.num_joints
    extent = np.zeros(n)  # of the shapes that move with a joint and not with the next, from it
    plant, context = shapes.plant, shapes.plant.CreateDefaultContext()
    for shape, body in shapes.body.items():
        level = shapes.level.get(body.index(), 0)
        corners = box_corners(shapes.inspector, shape)
        if level == 0 or not corners.size:
            continue
        frame = shapes.parts.joints[level - 1].frame_on_child()
        X_JF = plant.CalcRelativeTransform(context, frame, body.body_frame())
        distances = np.linalg.norm(X_JF @ corners, axis=0)
        extent[level - 1] = max(extent[level - 1], distances.max())
    # A prismatic joint moves all points alike, and stretches what the joints before it carry.
    stroke = np.where(chain.prismatic, robot.position_upper - robot.position_lower, 0.0)
    lengths = np.linalg.norm(chain.p_PJ, axis=1) + stroke
    radius = np.empty(n)
    for j in range(n):
        to_joint = np.concatenate([[0.0], np.cumsum(lengths[j + 1 :])])
        radius[j] = np.max(to_joint + extent[j:])
    return np.where(chain.prismatic, 1.0, radius)
