"""The choice of an excitation motion as a MathematicalProgram.

    minimise    a measure of the motion (models.planning.excitation.excitation_information)
    over        the coefficients of a Fourier series: centre, sines and cosines of every joint
    subject to  v = vdot = 0 at the start, and so at the end
                position, velocity, acceleration within their limits at every time
                |rigid-body torque| <= torque_share * effort limit
                slack of every pair of shapes >= 0

Position, velocity and acceleration are trigonometric polynomials: samples within
`between_samples` of the limits keep all times within them, and the constraints are linear. Torque
and slack are held at samples; `analyses.methods.excite.excitation` checks them between.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.solvers import MathematicalProgram, SnoptSolver, SolverOptions

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.autodiff import differentiable
from wrenchsight.models.planning.excitation.excitation_information import (
    ExcitationInformation,
    Measure,
)
from wrenchsight.models.planning.excitation.excitation_limits import ExcitationLimits
from wrenchsight.models.planning.excitation.fourier_trajectory import (
    FourierTrajectory,
    between_samples,
    fourier_basis,
)
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

SlackFunction = Callable[[Array], tuple[float, Array]]
"""From q (n,) to a slack in m, at least zero where all is clear, and its gradient (n,)."""

_DIFFERENCE_STEP = 1e-3  # rad, of the differences of q in the torque
# Decimals of what the solver and the functions of the program tell each other. A solver that is
# stopped before it converges ends elsewhere after a change in the last bit of one number.
_MOTION_DECIMALS, _VALUE_DECIMALS, _GRADIENT_DECIMALS = 9, 8, 6


_SHRINK_FACTOR = 0.6  # by which a random motion that breaks a limit is made smaller
_MAX_SIZES, _MAX_SIZES_PATIENT = 4, 9  # of a random motion that are tried: down to 22 and 2 %
_ROUNDING_ROOM = 0.999  # of a random motion's largest size, so that rounding breaks no limit
_SNOPT_OPTIONS = {
    "Major feasibility tolerance": 1e-6,
    "Major optimality tolerance": 1e-4,
    "Major step limit": 0.5,  # of the coefficients' size
    "Function precision": 1e-7,  # of the distances between curved shapes, found iteratively
}
# Major ones, of the search for the nearest motion within the limits, which has mostly converged
# after fewer; where none is near, more do not find it.
_NEAREST_ITERATIONS = 10
_MOST_POSTURES = 2000  # that random motions are drawn about
UNSTATED_SPEED = 3.0  # rad/s (m/s), of a joint whose URDF states no speed limit
MAX_SPEED = 30.0  # rad/s (m/s); a limit beyond is a placeholder, and counts as not stated
_SLIDE_MARGIN = 0.1  # of a sliding joint's travel, at most, at each end: a short one keeps some way


@dataclass(frozen=True, eq=False)
class MotionBounds:
    """The limits of a motion, (n,) each: rad, rad/s, rad/s^2 (m for prismatic joints) and N m."""

    position_lower: Array
    position_upper: Array
    velocity: Array
    acceleration: Array
    torque: Array

    @classmethod
    def of_robot(cls, robot: Robot, limits: ExcitationLimits) -> "MotionBounds":
        """Joint limits of a robot, reduced as `limits` says.

        Positions keep `position_margin` (rad or m) from both ends, sliding joints no more than
        _SLIDE_MARGIN of their travel; speed and torque are held to the shares `velocity_share` and
        `torque_share` of the robot's; `acceleration` is one number for all joints, or one each.

        Raises:
            InputError: a limit that leaves no motion, or lists of a wrong length.
        """
        n = robot.num_joints

        def positive(name: str, values: Array, unit: str) -> Array:
            """The values (n,) of the setting `name`, once each is found finite and above 0."""
            for joint, value in zip(robot.joint_names, values, strict=True):
                if not (np.isfinite(value) and value > 0.0):
                    raise InputError(
                        "excite",
                        name,
                        f"leaves {joint} {value:.3g} {unit}, expected more than 0",
                        "widen the limit",
                    )
            return values

        acceleration = np.array(limits.acceleration, dtype=np.float64)
        if acceleration.shape not in ((1,), (n,)):
            problem = f"{acceleration.size} numbers, expected 1 or {n}"
            raise InputError("excite", "acceleration", problem)
        is_stated = robot.velocity_limit <= MAX_SPEED
        speed = np.where(is_stated, robot.velocity_limit, UNSTATED_SPEED)
        # A joint without position limits gains nothing from more than a turn each way.
        lower = np.maximum(robot.position_lower, -2.0 * np.pi)
        upper = np.minimum(robot.position_upper, 2.0 * np.pi)
        slide_margin = np.minimum(limits.position_margin, _SLIDE_MARGIN * (upper - lower))
        margin = np.where(robot.chain.prismatic, slide_margin, limits.position_margin)
        lower, upper = lower + margin, upper - margin
        positive("position_margin", upper - lower, "rad (m) of travel")
        acceleration = np.broadcast_to(acceleration, n).copy()
        return cls(
            position_lower=lower,
            position_upper=upper,
            velocity=positive("velocity_share", limits.velocity_share * speed, "rad/s"),
            acceleration=positive("acceleration", acceleration, "rad/s^2"),
            torque=positive("torque_share", limits.torque_share * robot.effort_limit, "N m"),
        )


@dataclass(frozen=True, eq=False)
class ExcitationSolution:
    """The solution of the program from one start.

    Attributes:
        trajectory: starts and ends at rest.
        cost: the smooth measure.
        status: as the solver states it.
        evaluations: evaluations of the cost with its gradient.
    """

    trajectory: FourierTrajectory
    cost: float
    status: str
    evaluations: int


class ProgramSettings(NamedTuple):
    """Settings of ExcitationProgram.

    Attributes:
        measure: "condition_number" or "log_det".
        base_frequency: Hz.
        num_harmonics: H.
        num_samples: number of samples of a period, for measure, linear limits, torque.
        num_postures: number of postures of a period, at which the slack is held.
    """

    measure: Measure = "condition_number"
    base_frequency: float = 0.1
    num_harmonics: int = 5
    num_samples: int = 80
    num_postures: int = 40


class Reserve(NamedTuple):
    """What a motion spares of its limits at the samples, because both change between them.

    Attributes:
        slack: m.
        torque_share: share of the torque limit.
    """

    slack: float
    torque_share: float


DEFAULT_RESERVE = Reserve(slack=0.004, torque_share=0.02)


class NoTrajectoryError(InputError):
    """No random motion keeps within the limits.

    Attributes:
        limit: that most of them broke: torque or clearance.
    """

    def __init__(self, limit: str, num_tried: int) -> None:
        self.limit = limit
        problem = f"no trajectory found: all {num_tried} random ones break this limit, also small "
        remedies = {
            "torque": "raise torque_share (1 at most), or state the drives' effort_limit",
            "clearance": "lower clearance or the floor",
        }
        super().__init__("excite", limit, f"{problem}ones", remedies[limit])


class ExcitationProgram:
    """The program of one robot.

    Args:
        chain: chain of the robot whose torque is limited.
        bounds: bounds of the motion.
        information: information of the motion about the parameters.
        settings: None for all defaults.
        slack: slack of a posture; None where nothing can touch.
        reserve: what is kept of slack and torque.
    """

    def __init__(
        self,
        chain: SerialChain,
        bounds: MotionBounds,
        information: ExcitationInformation,
        settings: ProgramSettings | None = None,
        slack: SlackFunction | None = None,
        reserve: Reserve = DEFAULT_RESERVE,
    ) -> None:
        """Builds the program, without a start; arguments as the class has them.

        Its variables are (n, 1 + 2 H): of each joint the centre, the H sines and the H cosines.
        """
        settings = ProgramSettings() if settings is None else settings
        self.chain, self.bounds, self.information = chain, bounds, information
        self.measure = settings.measure
        self.base_frequency, self.num_harmonics = settings.base_frequency, settings.num_harmonics
        self._slack = slack
        self._reserve = reserve
        self._on_evaluation: Callable[[int, float], None] = lambda evaluations, cost: None
        self._evaluations = 0
        H, num_samples = settings.num_harmonics, settings.num_samples
        period = 1.0 / settings.base_frequency
        # Harmonic k enters as k times its amplitude, so that all move the velocity alike.
        self._scale = np.concatenate([[1.0], 1.0 / np.arange(1, H + 1), 1.0 / np.arange(1, H + 1)])
        t = np.arange(num_samples) * period / num_samples
        # Position, velocity and acceleration (num_samples, 1 + 2 H) by the scaled coefficients.
        self._basis = [b * self._scale for b in fourier_basis(t, settings.base_frequency, H)]
        # Clearance is checked at few samples, torque at every other one: each costs a gradient in
        # all variables, and `reserve` is for what lies between. Motion is checked at all samples.
        self._slack_rows = slice(0, None, max(1, num_samples // settings.num_postures))
        self._torque_rows = slice(0, None, 2)
        # What samples keep to this share of a linear limit, all times keep to the limit.
        self._share_at_samples = between_samples(H, num_samples)
        self.program = MathematicalProgram()
        self._x = self.program.NewContinuousVariables(chain.num_joints, 1 + 2 * H, "x")
        self._add_constraints()

    def random_feasible(self, rng: np.random.Generator, num_draws: int = 60) -> FourierTrajectory:
        """A random motion within all limits (at the samples), as large as its shape allows.

        Each draw is a posture and the shape of a motion about it, as large as the limits of
        position, speed and acceleration let it be; it is made smaller until torque and clearance
        hold, too. Where none of `num_draws` is found, as many more are drawn: then postures that
        cannot be held at rest no longer count as draws, and the motions may be smaller.

        Args:
            rng: of the postures and shapes.
            num_draws: as said.

        Raises:
            NoTrajectoryError: none was found; the line names the limit that most draws broke.
        """
        num_broken = {"torque": 0, "clearance": 0}  # draws by the limit that they broke when small
        num_tried = 0
        for _ in range(_MOST_POSTURES):
            if num_tried == 2 * num_draws:
                break
            x = self._random_motion(rng)
            is_patient = num_tried >= num_draws
            # Another posture, where this one alone breaks a limit.
            at_rest = np.hstack([x[:, :1], np.zeros_like(x[:, 1:])])
            if is_patient and self._broken(at_rest):
                continue
            num_tried += 1
            for _ in range(_MAX_SIZES_PATIENT if is_patient else _MAX_SIZES):
                broken_limit = self._broken(x)  # the first that it breaks; "": none
                if not broken_limit:
                    return self._trajectory(x)
                x[:, 1:] *= _SHRINK_FACTOR  # about the same centre
            num_broken[broken_limit] += 1
        worst = max(num_broken, key=lambda name: num_broken[name])
        raise NoTrajectoryError(worst, num_tried)

    def _random_motion(self, rng: np.random.Generator) -> Array:
        """The largest motion of a random shape about a random posture, by the linear limits alone.

        Returns:
            x (n, 1 + 2 H): each joint's centre, its sines k A_k and its cosines k B_k; A_k and B_k
            are the amplitudes of harmonic k = 1 to H.
        """
        n, H = self.chain.num_joints, self.num_harmonics
        low, high = self.bounds.position_lower, self.bounds.position_upper
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        # In the middle half of the range, or of a turn: room to both sides.
        centre = middle + rng.uniform(-0.5, 0.5, n) * np.minimum(half, np.pi)
        x = rng.normal(size=(n, 1 + 2 * H))
        x[:, 0] = 0.0
        # At rest at the start: sum k A_k = 0, without velocity; sum k^2 B_k = 0, without
        # acceleration.
        x[:, 1 : 1 + H] -= x[:, 1 : 1 + H].mean(axis=1, keepdims=True)
        k = np.arange(1, H + 1)
        x[:, 1 + H :] -= np.outer(x[:, 1 + H :] @ k, k) / (k @ k)
        q, v, vdot = (basis @ x.T for basis in self._basis)
        room_about_centre = self._share_at_samples * half - np.abs(centre - middle)
        amplitude = np.min(
            [
                room_about_centre / np.abs(q).max(axis=0),
                self._share_at_samples * self.bounds.velocity / np.abs(v).max(axis=0),
                self._share_at_samples * self.bounds.acceleration / np.abs(vdot).max(axis=0),
            ],
            axis=0,
        )
        x *= _ROUNDING_ROOM * amplitude[:, None]
        x[:, 0] = centre
        return x

    def solve(
        self,
        start: FourierTrajectory,
        iterations: int = 200,
        watch: Callable[[int, float], None] = lambda evaluations, cost: None,
    ) -> ExcitationSolution:
        """Solves from one start.

        Args:
            start: motion of the same harmonics.
            iterations: major ones of SNOPT, at most.
            watch: called with the number of evaluations and the cost at each.

        Returns:
            The motion at which SNOPT ended, converged or not (`status`); the start, where it
            returned none. The limits are not checked here.
        """
        self._on_evaluation, self._evaluations = watch, 0  # `_cost` calls and counts
        x, info = self._solved(self.program, start, iterations)
        trajectory = self._trajectory(x)
        return ExcitationSolution(
            trajectory=trajectory,
            cost=self.cost(trajectory),
            status=f"snopt {info}",
            evaluations=self._evaluations,
        )

    def nearest_within_limits(
        self, trajectory: FourierTrajectory, iterations: int = _NEAREST_ITERATIONS
    ) -> FourierTrajectory:
        """The motion next to a given one, in its coefficients, that keeps all limits at samples.

        Few iterations of `solve` lower the measure and leave limits broken. From there this takes
        about as long as ten of them, as it leaves the measure out.

        Args:
            trajectory: of the same harmonics.
            iterations: major ones of SNOPT, at most.

        Returns:
            The motion at which SNOPT ended; limits that no motion nearby keeps are broken by it,
            too.
        """
        program = self.program.Clone()
        for cost in program.GetAllCosts():
            program.RemoveCost(cost)
        all_x = self._x.ravel()
        guess = np.round(self._coefficients(trajectory), _MOTION_DECIMALS)
        program.AddQuadraticErrorCost(np.eye(len(all_x)), guess.ravel(), all_x)
        return self._trajectory(self._solved(program, trajectory, iterations)[0])

    def _solved(
        self, program: MathematicalProgram, start: FourierTrajectory, iterations: int
    ) -> tuple[Array, int]:
        """Where SNOPT ends in a program of this one's variables, and what it states of that.

        Returns:
            x (n, 1 + 2 H), the start's where SNOPT returned none; SNOPT's info, 1 if it converged.
        """
        settings = SolverOptions()
        solver = SnoptSolver()
        for name, value in {
            "Major iterations limit": iterations,
            "Iterations limit": 100 * iterations,  # minor ones, of all quadratic programs
            **_SNOPT_OPTIONS,
        }.items():
            settings.SetOption(solver.solver_id(), name, value)
        # As all that solver and program tell each other: the last bit must not decide the end.
        guess = np.round(self._coefficients(start), _MOTION_DECIMALS)
        program.SetInitialGuess(self._x, guess)
        result = solver.Solve(program, None, settings)
        x = np.asarray(result.GetSolution(self._x), dtype=np.float64)
        if not np.isfinite(x).all():  # SNOPT returned none
            x = self._coefficients(start)
        return x, int(result.get_solver_details().info)

    def cost(self, trajectory: FourierTrajectory) -> float:
        """The smooth measure of a motion of the same harmonics, within the limits or not."""
        q, v, vdot = (basis @ self._coefficients(trajectory).T for basis in self._basis)
        return self.information.cost(self.measure, q, v, vdot)[0]

    def _trajectory(self, x: Array) -> FourierTrajectory:
        H = self.num_harmonics
        c = x * self._scale
        return FourierTrajectory(self.base_frequency, c[:, 0], c[:, 1 : 1 + H], c[:, 1 + H :])

    def _coefficients(self, trajectory: FourierTrajectory) -> Array:
        c = np.hstack([trajectory.centre[:, None], trajectory.sine, trajectory.cosine])
        return np.asarray(c / self._scale)

    def _broken(self, x: Array) -> str:
        """The limit that a motion breaks at the samples; '' if none."""
        q, v, vdot = (basis @ x.T for basis in self._basis)
        if (np.abs(self.chain.inverse_dynamics(q, v, vdot)) > self.bounds.torque).any():
            return "torque"
        if self._slack is not None and any(
            self._slack(row)[0] < self._reserve.slack for row in q[self._slack_rows]
        ):
            return "clearance"
        return ""

    def _add_constraints(self) -> None:
        """Bounds positions, rates, torques and clearance, and adds the cost.

        Of a joint's variables the first is the constant; those of H sines and of H cosines follow,
        harmonic k as k times its amplitude. The two equalities are those of a motion that begins
        without velocity and acceleration. `_basis` times a joint's variables is its position,
        velocity and acceleration at the samples; where these keep to `share` of a limit, the motion
        between them keeps to the limit.

        `differentiable` turns a function that returns values and their gradients by all variables
        into what Drake calls: `_torque` (joint by joint at one sample after another, in shares of
        the limits), `_slacks` (a posture each) and `_cost` (one value).
        """
        program, x, H = self.program, self._x, self.num_harmonics
        bounds, share = self.bounds, self._share_at_samples
        k = np.arange(1.0, H + 1.0)
        middle = 0.5 * (bounds.position_lower + bounds.position_upper)
        half = 0.5 * (bounds.position_upper - bounds.position_lower)
        for j in range(self.chain.num_joints):
            joint_x = x[j]
            program.AddLinearEqualityConstraint(np.ones((1, H)), [0.0], joint_x[1 : 1 + H])
            program.AddLinearEqualityConstraint(k[None], [0.0], joint_x[1 + H :])
            reach = np.full(len(self._basis[0]), share * half[j])
            program.AddLinearConstraint(
                self._basis[0], middle[j] - reach, middle[j] + reach, joint_x
            )
            for basis, limit in zip(
                self._basis[1:], (bounds.velocity, bounds.acceleration), strict=True
            ):
                upper = np.full(len(basis), share * limit[j])
                program.AddLinearConstraint(basis, -upper, upper, joint_x)
        all_x = x.ravel()
        num_torques = self.chain.num_joints * len(self._basis[0][self._torque_rows])
        torque_bound = np.full(num_torques, 1.0 - self._reserve.torque_share)
        program.AddConstraint(differentiable(self._torque), -torque_bound, torque_bound, all_x)
        if self._slack is not None:
            num_slacks = len(self._basis[0][self._slack_rows])
            least_slack = np.full(num_slacks, self._reserve.slack)
            no_bound = np.full(num_slacks, np.inf)
            program.AddConstraint(differentiable(self._slacks), least_slack, no_bound, all_x)
        cost = differentiable(self._cost)
        program.AddCost(lambda x: cost(x)[0], vars=all_x)  # a cost is a number, not an array

    def _cost(self, x: Array) -> tuple[Array, Array]:
        motion = self._motion(x, slice(None))
        value, *by_motion = self.information.cost(self.measure, *motion)
        self._evaluations += 1
        self._on_evaluation(self._evaluations, value)
        gradient = sum(by.T @ basis for by, basis in zip(by_motion, self._basis, strict=True))
        return _rounded(np.array([value]), np.asarray(gradient).reshape(1, -1))

    def _torque(self, x: Array) -> tuple[Array, Array]:
        """Torque over its limit, sample by sample."""
        bases = [basis[self._torque_rows] for basis in self._basis]
        q, v, vdot = self._motion(x, self._torque_rows)
        tau = self.chain.inverse_dynamics(q, v, vdot) / self.bounds.torque
        n = self.chain.num_joints
        by_motion = torque_gradients(self.chain, q, v, vdot)  # (N, n, 3 n)
        gradient = sum(
            by_motion[:, :, i * n : (i + 1) * n, None] * basis[:, None, None, :]
            for i, basis in enumerate(bases)
        )
        gradient = np.asarray(gradient) / self.bounds.torque[:, None, None]
        return _rounded(tau.ravel(), gradient.reshape(tau.size, -1))

    def _slacks(self, x: Array) -> tuple[Array, Array]:
        basis = self._basis[0][self._slack_rows]
        assert self._slack is not None
        slacks, gradients = [], []
        for q in self._motion(x, self._slack_rows)[0]:
            slack, by_q = self._slack(q)
            slacks.append(slack)
            gradients.append(by_q)
        gradient = np.array(gradients)[:, :, None] * basis[:, None, :]
        return _rounded(np.array(slacks), gradient.reshape(len(slacks), -1))

    def _motion(self, x: Array, rows: slice) -> list[Array]:
        """q, v, vdot (N, n) at some of the samples, rounded, for x of the solver."""
        of_joints = x.reshape(self._x.shape).T
        return [np.round(basis[rows] @ of_joints, _MOTION_DECIMALS) for basis in self._basis]


def _rounded(values: Array, gradient: Array) -> tuple[Array, Array]:
    """What a function of the program tells the solver, without the last bits."""
    return np.round(values, _VALUE_DECIMALS), np.round(gradient, _GRADIENT_DECIMALS)


def torque_gradients(chain: SerialChain, q: Array, v: Array, vdot: Array) -> Array:
    """Gradient (N, n, 3 n) of the rigid-body torque by q, v and vdot (N, n), side by side.

    Exact in v and vdot, in which the torque is quadratic and affine; in q by central differences.
    """
    n = chain.num_joints
    steps = np.array([_DIFFERENCE_STEP] * n + [1.0] * (2 * n))
    stacked = np.concatenate([q, v, vdot], axis=1)[:, None]
    shifted = np.concatenate([stacked + np.diag(steps), stacked - np.diag(steps)], axis=1)
    rows = shifted.reshape(-1, 3 * n)
    tau = chain.inverse_dynamics(
        rows[:, :n].copy(), rows[:, n : 2 * n].copy(), rows[:, 2 * n :].copy()
    ).reshape(len(q), 6 * n, n)
    slopes = (tau[:, : 3 * n] - tau[:, 3 * n :]) / (2.0 * steps[:, None])
    return np.asarray(slopes.transpose(0, 2, 1))
