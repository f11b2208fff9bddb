"""From nothing to a wrench that can be trusted, on a bundled simulated arm, in a short while.

    python quickstart.py [FOLDER]

1. excite    a motion from which the arm's parameters show, and a second one for validation
2. simulate  what the drives record while the arm makes them
3. identify  the arm's inertias and friction, from these logs alone
4. simulate  another motion, with a hand pushing at the tool
5. estimate  the wrench at the tool from that log, with its 95 % band
6. plot      estimate and truth

The arm is the UR10e, whose simulated friction is settled on logs of a real one. The article's small
arm errs by 8 N at its tool, more than a valid reading may on an arm for 4 kg (docs/concepts.md).
"""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

from wrenchsight import (
    ExcitationConfig,
    FourierMotion,
    IdentificationConfig,
    Recording,
    Robot,
    Scenario,
    WrenchEstimator,
    WrenchEstimatorConfig,
    excite,
    identify,
    load_scenario,
    simulate,
)

AXES = ("fx", "fy", "fz")


def record_motion(robot: Robot, seed: int) -> Recording:
    """Lets the simulated arm make an excitation motion; returns what its drives report."""
    config = ExcitationConfig(seed=seed, num_starts=4, iterations=10)  # small: to try things out
    trajectory = excite(robot, config).trajectory
    motion = FourierMotion(
        base_frequency=trajectory.base_frequency,
        centre=trajectory.centre.tolist(),
        sine=trajectory.sine.tolist(),
        cosine=trajectory.cosine.tolist(),
        stops=trajectory.stops,
    )
    scenario = Scenario(robot=robot.name, motion=motion, duration=trajectory.duration(), seed=seed)
    return simulate(scenario, robot).recording()


def pushed_scenario(robot: Robot) -> Scenario:
    """The arm swings all its joints; a hand pushes at the tool for seven of ten seconds."""
    scenario = load_scenario("Default")
    scenario.robot, scenario.force_torque_sensor, scenario.duration = robot.name, None, 10.0
    hand = scenario.wrench[0]
    hand.duration, hand.force, hand.moment = 7.0, 3 * [15.0], 3 * [0.3]  # s; sd in N and N m
    return scenario


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    robot = Robot.load("ur10e")

    print("recording two excitation motions ...")
    fitted, held_out = record_motion(robot, seed=1), record_motion(robot, seed=2)

    print("identifying ...")
    config = IdentificationConfig(friction="coulomb-viscous-offset", cutoff=7.5)
    identified = identify([fitted], robot, [held_out], config)
    model = identified.model
    model.save(folder / "model.yaml")
    print("torque error on the second motion [N m]:", np.round(identified.validation[0].rmse, 2))

    print("pushing ...")
    pushed = simulate(pushed_scenario(robot), robot, model)

    print("estimating ...")
    log = pushed.recording()
    time_step = float(np.median(np.diff(log.t)))
    settings = WrenchEstimatorConfig()
    settings.observer.time_step = time_step
    estimator = WrenchEstimator(robot, model, settings)
    batch = estimator.run(estimator.initial_state(), log.q, log.v, log.current)
    force, sd = batch.wrench[:, 3:], batch.standard_deviation[:, 3:]
    true = pushed.wrench_true[:, 3:]
    valid = batch.valid
    print(f"{100 * valid.mean():.0f} % of {len(valid)} readings valid")
    if not valid.any():
        sys.exit("no reading is valid: the model says less of the force than is known beforehand")
    error = np.sqrt(np.mean((force - true)[valid] ** 2, axis=0))
    inside = np.mean(np.abs(force - true)[valid] < 1.96 * sd[valid], axis=0)
    for axis, rmse, share in zip(AXES, error, inside, strict=True):
        print(f"{axis}: RMSE {rmse:.2f} N, {100 * share:.0f} % inside the stated 95 % band")

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(3, 1, sharex=True, figsize=(8, 6), layout="constrained")
    for k, (axis, panel) in enumerate(zip(AXES, panels, strict=True)):
        low, high = force[:, k] - 1.96 * sd[:, k], force[:, k] + 1.96 * sd[:, k]
        panel.fill_between(log.t, low, high, alpha=0.25, lw=0, label="95 % band")
        panel.plot(log.t, force[:, k], lw=1.2, label="estimate")
        panel.plot(log.t, true[:, k], "k--", lw=1.0, label="true")
        panel.set_ylabel(f"{axis} [N]")
    panels[0].legend(loc="upper right", ncols=3)
    panels[-1].set_xlabel("time [s]")
    figure.suptitle("Force of the environment on the robot, at E in axes of W")
    figure.savefig(folder / "quickstart.png", dpi=120)
    print(f"wrote {folder / 'quickstart.png'} and {folder / 'model.yaml'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "quickstart"))
