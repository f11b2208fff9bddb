"""The same on every machine: what changes in the last bits changes nothing that anyone reads.

Processors differ in the last bit of a sine, of a sum, of a product of matrices. Here robots, paths
and logs are moved by 1e-12 of themselves, a thousand times as much, and the same choices (branch,
elbow, place, law) and the same figures must come out. The whole suite under another processor's
arithmetic: `make test-generic`.
"""

import copy
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchsight.analyses.methods.identify.friction_training import train_networks
from wrenchsight.analyses.methods.identify.identification import (
    IdentificationConfig,
    identify,
)
from wrenchsight.analyses.methods.identify.law_choice import best_law
from wrenchsight.analyses.methods.place.placement_search import PlacementSearch, SearchEffort
from wrenchsight.analyses.methods.redundancy.redundancy import make_problem
from wrenchsight.analyses.methods.redundancy.redundancy_task import RedundancyTask
from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.placement.placement_program import PlacementProgram
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.estimation.evidence_prior import evidence_prior, evidence_prior_and_noise
from wrenchsight.models.estimation.point_of_action import find_point_of_action, jacobian_at
from wrenchsight.models.files.bundled_files import task_file
from wrenchsight.models.files.configuration import load_configuration
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.planning.excitation.excitation_information import ExcitationInformation
from wrenchsight.models.planning.excitation.excitation_limits import ExcitationLimits
from wrenchsight.models.planning.excitation.excitation_program import (
    ExcitationProgram,
    MotionBounds,
    ProgramSettings,
)
from wrenchsight.models.planning.motion.branches import all_branches, closed_form
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber
from wrenchsight.models.planning.motion.posture_map import ToolCone, best_postures
from wrenchsight.models.planning.motion.redundancy import best_on_grid, candidates, refine
from wrenchsight.models.planning.placement.placement_task import load_task
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

BITS = 1e-12  # relative, and in m and rad: a thousand times what an operation rounds by
SEEDS = (0, 1, 2)
# Six digits are more than anything prints. A path of smooth postures passes the inputs' 1e-12 on
# with a factor of a hundred or so; what a solver ends at has its own tolerance.
DIGITS = 1e-6


def moved(values, seed, bits=BITS):
    """Numbers of any shape, each with its last bits changed."""
    values = np.asarray(values, dtype=np.float64)
    return values * (1.0 + bits * np.random.default_rng(seed).uniform(-1.0, 1.0, values.shape))


def moved_robot(robot, seed):
    """The same arm with frames and inertias that differ in their last bits."""
    rng = np.random.default_rng(seed)
    chain, n = robot.chain, robot.num_joints

    def turned(R):
        turn = Rotation.from_rotvec(BITS * rng.uniform(-1.0, 1.0, (*R.shape[:-2], 3)))
        return turn.as_matrix() @ R

    other = copy.copy(robot)
    other.__dict__["chain"] = replace(
        chain,
        R_PJ=turned(chain.R_PJ),
        p_PJ=chain.p_PJ + BITS * rng.uniform(-1.0, 1.0, (n, 3)),
        R_LE=turned(chain.R_LE),
        p_LE=chain.p_LE + BITS * rng.uniform(-1.0, 1.0, 3),
        inertial_parameters=moved(chain.inertial_parameters, seed),
    )
    return other


@pytest.fixture(scope="module")
def sts():
    return Robot.load("sts_sre4_600")


@pytest.fixture(scope="module", params=["sts_sre4_600", "ur10e"])
def robot(request):
    return Robot.load(request.param)


# Tools that point down, up and ahead: wrists stand at exactly half a turn, planes are symmetric.
DOWN, TURNED = np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0])
AHEAD = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
PLACES = np.array(
    [[x, y, z] for x in (0.2, 0.35, 0.5) for y in (0.0, 0.1, -0.1, 0.3) for z in (0.1, 0.3)]
)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("R", [DOWN, TURNED, AHEAD], ids=["down", "turned", "ahead"])
def test_branches_are_the_same_in_the_same_order(robot, R, seed):
    every = np.tile(R, (len(PLACES), 1, 1))
    solutions = all_branches(robot, every, PLACES)
    other = all_branches(moved_robot(robot, seed), every, moved(PLACES, seed))
    assert np.isfinite(solutions[..., 0]).sum() > 50
    assert solutions.shape == other.shape
    # At a singular posture an error becomes its square root.
    np.testing.assert_allclose(other, solutions, atol=1e-5)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_arm_stays_one_that_is_solved_in_closed_form(robot, seed):
    assert closed_form(robot) is not None
    assert closed_form(moved_robot(robot, seed)) is not None


@pytest.mark.parametrize("seed", SEEDS)
def test_a_path_is_solved_with_the_same_choices(robot, seed):
    other = moved_robot(robot, seed)
    p = np.linspace([0.4, -0.1, 0.3], [0.4, 0.1, 0.3], 9)
    # As near to one wrist as to the other: joints 4 and 6 a quarter of a turn to either side.
    branches = all_branches(robot, DOWN[np.newaxis], p[:1])[0]
    start = branches[np.argmin(np.linalg.norm(branches - robot.home, axis=1))]
    between = start.copy()
    between[3], between[4], between[5] = start[3] + np.pi / 2, 0.0, start[5] - np.pi / 2
    for seed_posture in (start, between):
        q = follow_path(robot, DOWN, p, seed_posture)
        moved_seed = seed_posture + BITS * np.random.default_rng(seed).uniform(-1, 1, 6)
        np.testing.assert_allclose(follow_path(other, DOWN, p, moved_seed), q, atol=DIGITS)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["Polishing", "Grinding"])
def test_a_machined_path_keeps_its_branch(sts, name, seed):
    """Of two wrists that cost the same to the last bit, always the same one."""
    scenario, other = load_scenario(name), moved_robot(sts, seed)
    path, again = make_machining_path(scenario, sts), make_machining_path(scenario, other)
    np.testing.assert_allclose(again.trajectory.q, path.trajectory.q, atol=DIGITS)


@pytest.mark.parametrize("name", ["Polishing", "Grinding"])
def test_a_tie_between_wrists_is_broken_without_joint_ranges(sts, name):
    """The ranges in the scenario leave one wrist; without them two are as good as each other."""
    scenario = load_scenario(name)
    free = replace(scenario, machining=replace(scenario.machining, joint_ranges_deg={}))
    path = make_machining_path(free, sts)
    for seed in SEEDS:
        again = make_machining_path(free, moved_robot(sts, seed))
        np.testing.assert_allclose(again.trajectory.q, path.trajectory.q, atol=DIGITS)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_map_shows_the_same_postures(sts, seed):
    points = np.array([[x, y, 0.2] for x in (0.25, 0.45) for y in (-0.2, 0.0, 0.2)])

    def best(robot, p):
        measure = ConditionNumber(robot.chain)
        return best_postures(robot, measure, p, ToolCone([0.0, 0.0, -1.0], np.radians(30.0)))

    postures, other = best(sts, points), best(moved_robot(sts, seed), moved(points, seed))
    np.testing.assert_allclose(other.best, postures.best, rtol=1e-9)
    np.testing.assert_allclose(other.direction_W, postures.direction_W, atol=DIGITS)
    np.testing.assert_allclose(other.q, postures.q, atol=DIGITS)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_angle_about_the_normal_is_chosen_alike(sts, seed):
    config = load_configuration(task_file("blade_path", "redundancy"), RedundancyTask)
    patch = replace(config.surface, num_samples=31)
    config = replace(config, surface=patch, max_joint_step_deg=20.0, num_angles=24)

    def chosen(robot):
        problem, _ = make_problem(robot, config)
        on_grid = best_on_grid(problem, candidates(problem))
        return on_grid.q, refine(problem, on_grid.q).q, problem

    (grid, q, problem), (grid_again, q_again, _) = chosen(sts), chosen(moved_robot(sts, seed))
    np.testing.assert_allclose(grid_again, grid, atol=DIGITS)
    # The refinement ends where its model promises less than 1e-7 of the cost.
    assert problem.cost(q_again) == pytest.approx(problem.cost(q), rel=1e-6)
    np.testing.assert_allclose(q_again, q, atol=1e-3)


@pytest.mark.slow
def test_a_placement_is_found_in_the_same_digits(sts):
    """Descents and solver go other ways; the last steps bring them to one place."""
    task, _ = load_task("linear_path")
    bounds, path = task.bounds(sts), task.initial_path()
    effort = SearchEffort(num_samples=2000, num_poses=8, num_starts=12, num_rounds=1)

    def best(robot):
        measure = ConditionNumber(robot.chain)
        program = PlacementProgram(robot, measure, bounds, task.path_length, task.num_segments)
        return PlacementSearch(program, path).run(effort=effort).best

    placement, other = best(sts), best(moved_robot(sts, 0))
    assert other.cost == pytest.approx(placement.cost, rel=1e-9)
    np.testing.assert_allclose(other.values, placement.values, rtol=DIGITS)
    np.testing.assert_allclose(other.placement.q, placement.placement.q, atol=1e-5)
    np.testing.assert_allclose(other.placement.p_WM, placement.placement.p_WM, atol=1e-6)
    np.testing.assert_allclose(other.placement.n_W, placement.placement.n_W, atol=1e-6)


def test_an_excitation_takes_the_same_way(sts):
    """The solver is stopped on its way, and a way that differs anywhere ends elsewhere."""
    settings = ProgramSettings(num_samples=40)
    bounds = MotionBounds.of_robot(sts, ExcitationLimits())

    def slack_found_iteratively(q):
        """Of a distance whose last digits depend on the last bits of q, as between curved shapes
        (1e-7 m)."""
        away, chance = q - 0.3, np.sin(1e12 * q)
        slack = 0.2 * float(away @ away) - 0.01 + 1e-7 * float(chance[0])
        return slack, 0.4 * away + 1e-6 * chance

    def solved(chain):
        information = ExcitationInformation.of_chain(chain, 1.0 / sts.effort_limit)
        program = ExcitationProgram(chain, bounds, information, settings, slack_found_iteratively)
        start = program.random_feasible(np.random.default_rng(0))
        end = program.solve(start, iterations=8).trajectory
        return np.hstack([end.centre[:, None], end.sine, end.cosine])

    coefficients = solved(sts.chain)
    for seed in SEEDS[:2]:
        # A hundred times what an operation rounds by: of the hundred thousand numbers that the
        # solver is told, hardly one lies so near to the edge where its last decimal turns.
        again = solved(replace(sts.chain, p_PJ=moved(sts.chain.p_PJ, seed, bits=1e-14)))
        np.testing.assert_allclose(again, coefficients, atol=1e-9)


@pytest.fixture(scope="module")
def logs(sts):
    """Two motions of the arm with friction that has a bump near zero, and some noise."""
    recordings = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        t = np.arange(0.0, 15.0, 0.01)
        q, v, vdot = np.zeros((3, len(t), 6))
        for k in range(1, 6):
            w = 0.2 * np.pi * k
            size, phase = rng.uniform(0.2, 0.6, 6) / k, rng.uniform(0.0, 2.0 * np.pi, 6)
            angle = w * t[:, None] + phase
            q += size * np.sin(angle)
            v += size * w * np.cos(angle)
            vdot -= size * w**2 * np.sin(angle)
        scale = np.array([8.0, 7.0, 5.0, 2.0, 2.5, 1.5])
        friction = scale * np.sign(v) * (1.0 + 0.4 * np.exp(-((v / 0.08) ** 2))) + scale * v
        tau = sts.chain.inverse_dynamics(q, v, vdot) + friction
        tau += 0.1 * scale * rng.normal(size=tau.shape)
        current = tau / (sts.torque_per_ampere * sts.current_sign)
        recordings.append(Recording(t=t, q=q, v=v, current=current, source=f"run_{seed}.csv"))
    return recordings


@pytest.mark.slow
@pytest.mark.parametrize("law", ["coulomb-viscous", "stribeck", "presliding"])
def test_a_log_is_identified_alike(sts, logs, law):
    """Which parameters are determined, which shape a law has, which law is best."""
    config = IdentificationConfig(friction=law)
    identified = identify(logs, sts, config=config)
    again = identify(
        [replace(r, q=moved(r.q, k), current=moved(r.current, k)) for k, r in enumerate(logs)],
        moved_robot(sts, 0),
        config=config,
    )
    assert again.base.names == identified.base.names
    np.testing.assert_array_equal(again.base.independent, identified.base.independent)
    values = np.array(identified.model.base_parameters.values)
    np.testing.assert_allclose(
        again.model.base_parameters.values, values, atol=DIGITS * np.abs(values).max()
    )
    v = np.linspace(-0.5, 0.5, 41)[:, None] * np.ones(6)
    zero = np.zeros_like(v)
    torque = identified.model.friction.torque_along(zero, v, zero)
    np.testing.assert_allclose(
        again.model.friction.torque_along(zero, v, zero),
        torque,
        atol=DIGITS * np.abs(torque).max(),
    )


def test_of_laws_that_are_as_good_the_first_is_best():
    held_out = {"plain": np.full(6, 2.0), "other": moved(np.full(6, 2.0), 1)}
    for seed in SEEDS:
        named = {law: moved(errors, seed) for law, errors in held_out.items()}
        assert best_law(named) == "plain"
    assert best_law({"plain": np.full(6, 2.0), "other": np.full(6, 1.99)}) == "other"


@pytest.mark.parametrize("seed", SEEDS[:1])  # it takes seconds
def test_networks_are_trained_alike(seed):
    """With pairs of samples at one speed, forth and back, as passes of opposite direction give."""
    rng = np.random.default_rng(7)
    speed = rng.uniform(0.0, 1.0, (1500, 2)) ** 2
    v = np.concatenate([speed, -speed])
    law = CoulombViscous(np.array([6.0, 2.0]), np.array([8.0, 1.0]), np.array([0.5, 0.1]))
    torque = law.torque(v) + np.sign(v) * (4.0 * np.exp(-((v / 0.1) ** 2)) - 1.0)
    torque += 0.3 * rng.normal(size=v.shape)
    networks = train_networks(v, torque, law)
    again = train_networks(moved(v, seed), moved(torque, seed), law)
    np.testing.assert_allclose(again.v_crit, networks.v_crit, rtol=1e-9)
    np.testing.assert_array_equal(again.steps, networks.steps)
    np.testing.assert_allclose(again.rmse, networks.rmse, rtol=DIGITS)


@pytest.mark.parametrize("seed", SEEDS)
def test_priors_and_points_of_action_are_found_alike(seed):
    robot = Robot.load("ur10e")
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 10.0, 200)[:, None]
    q = np.array([0.0, -1.2, 1.4, 0.3, 0.8, 0.0]) + 0.5 * np.sin(
        np.array([0.7, 0.9, 1.1, 1.3, 1.7, 1.9]) * t + np.arange(6)
    )
    J, (R, _) = robot.chain.jacobian(q), robot.chain.pose(q)
    force = np.array([2.0, 0.0, -25.0]) + rng.normal(scale=3.0, size=(len(q), 3))
    Sigma = np.diag(np.array([1.0, 1.0, 0.5, 0.2, 0.2, 0.2]) ** 2)
    at_point = jacobian_at(J, R, [0.03, 0.18, 0.05])
    tau = np.einsum("kij,ki->kj", at_point[:, 3:], force)
    tau += rng.multivariate_normal(np.zeros(6), 1.5**2 * Sigma, len(q))
    inputs, others = (J, tau, Sigma), (moved(J, seed), moved(tau, seed), Sigma)
    # 1e-12 over the flattest curvature, that of a standard deviation that hardly matters.
    np.testing.assert_allclose(evidence_prior(*others), evidence_prior(*inputs), rtol=1e-8)
    seven = np.concatenate([J, J[:, :, :1] + 0.3], axis=2)  # one torque more than a wrench has
    tau_7, Sigma_7 = np.concatenate([tau, 0.4 * tau[:, ::-1][:, :1]], axis=1), np.eye(7)
    np.testing.assert_allclose(
        evidence_prior_and_noise(moved(seven, seed), moved(tau_7, seed), Sigma_7),
        evidence_prior_and_noise(seven, tau_7, Sigma_7),
        rtol=1e-8,
    )
    point = find_point_of_action(J, R, tau, Sigma)
    again = find_point_of_action(moved(J, seed), R, moved(tau, seed), Sigma)
    np.testing.assert_allclose(again.p_EP, point.p_EP, atol=1e-9)
    np.testing.assert_allclose(again.mean_force_W, point.mean_force_W, atol=1e-7)
    np.testing.assert_allclose(again[2:], point[2:], rtol=1e-7)
