"""Writes fitted_robot.urdf: this arm's kinematics, and masses that give the controller's torque.

    python examples/recordings/neura_lara8/fit_robot.py OUT.urdf

The maker's description of the arm has no licence and is not here. Lengths are the thesis' (upper
arm 0.60 m, see SOURCE.md); the flange's poses in the recordings hold them to 0.01 mm. Masses are
fitted: those of a physical arm whose rigid-body torque is the controller's, `tau_model`, over all
recordings here. Where the recordings tell nothing, they stay near tubes of an assumed mass.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from wrenchsight.models.friction.friction_structure import FrictionStructure
from wrenchsight.models.identification.physical_consistency import fit_consistent
from wrenchsight.models.identification.torque_regression import parameter_prior, split_terms
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

FOLDER = Path(__file__).parent
# Axis of each joint, and how far above the one before it lies with all joints at zero, m.
JOINTS = (("0 0 1", 0.0), ("0 1 0", 0.26), ("0 1 0", 0.60), ("0 0 1", 0.0), ("0 1 0", 0.70))
JOINTS = (*JOINTS, ("0 0 1", 0.0))
FLANGE = 0.1735  # m above joint 6
MASSES = (10.0, 10.0, 8.0, 5.0, 3.0, 1.0)  # kg, assumed
LENGTHS = (0.2, 0.6, 0.2, 0.6, 0.1, 0.1)  # m of tubes, assumed
RADIUS = 0.07  # m of tubes, assumed
SD = 1.0  # N m, how far off the controller's torque may be
OUTLIER = 3.0  # N m: in the first samples of a motion tau_model has spikes


def tubes() -> np.ndarray:
    """(6, 10) the assumed links: m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the joint."""
    m, length = np.array(MASSES), np.array(LENGTHS)
    across, along = m * (RADIUS**2 / 2 + length**2 / 3), m * RADIUS**2
    zero = np.zeros(len(m))
    return np.column_stack([m, zero, zero, m * length / 2, across, zero, across, zero, zero, along])


def urdf(inertial: np.ndarray) -> str:
    """The description with these masses. Limits are wide: they are not the maker's."""
    lines = ["<!-- Made by fit_robot.py. -->", '<robot name="lara8">', '  <link name="root_link"/>']
    parent = "root_link"
    for number, (axis, height) in enumerate(JOINTS, start=1):
        m, *moment = inertial[number - 1][:4]
        xx, xy, yy, xz, yz, zz = inertial[number - 1][4:]
        c = np.array(moment) / m
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        about = about - m * (c @ c * np.eye(3) - np.outer(c, c))
        lines += [
            f'  <joint name="joint{number}" type="revolute">',
            f'    <origin xyz="0 0 {height:g}"/>',
            f'    <axis xyz="{axis}"/>',
            '    <limit effort="300" lower="-3.15" upper="3.15" velocity="4"/>',
            f'    <parent link="{parent}"/>',
            f'    <child link="link{number}"/>',
            "  </joint>",
            f'  <link name="link{number}">',
            "    <inertial>",
            f'      <mass value="{m:.5f}"/>',
            f'      <origin xyz="{c[0]:.6f} {c[1]:.6f} {c[2]:.6f}"/>',
            f'      <inertia ixx="{about[0, 0]:.6f}" iyy="{about[1, 1]:.6f}" '
            f'izz="{about[2, 2]:.6f}" ixy="{about[0, 1]:.6f}" ixz="{about[0, 2]:.6f}" '
            f'iyz="{about[1, 2]:.6f}"/>',
            "    </inertial>",
            "  </link>",
        ]
        parent = f"link{number}"
    lines += [
        '  <joint name="flange_joint" type="fixed">',
        f'    <origin xyz="0 0 {FLANGE:g}"/>',
        '    <parent link="link6"/>',
        '    <child link="flange"/>',
        "  </joint>",
        '  <link name="flange"/>',
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def fitted() -> str:
    """The URDF with the fitted masses."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "fitted_robot.urdf").write_text(urdf(tubes()))
        description = (FOLDER / "fitted_robot.yaml").read_text()
        (Path(folder) / "robot.yaml").write_text(description)
        robot = Robot.load(Path(folder) / "robot.yaml")
    n = robot.num_joints
    rows, right = [], []
    for path in sorted(FOLDER.glob("*.parquet")):
        log = read_recording(path, "neura-lara8")
        v, a, tau = (log.extra[key] for key in ("v_target", "a_target", "tau_model"))
        Y = robot.chain.regressor(log.q, v, a)
        rows.append(np.concatenate([Y, a[:, None, :] * np.eye(n)], axis=2).reshape(-1, 11 * n))
        right.append(tau.ravel())
    A, b = np.concatenate(rows), np.concatenate(right)
    prior, spread = parameter_prior(robot, [0] * n)
    spread[10 * n :] *= 1e-9  # rotors are those of fitted_robot.yaml
    structure = FrictionStructure(((),) * n, np.zeros(n), np.ones(n))
    keep = np.ones(len(b), bool)
    for _ in range(3):
        fit = fit_consistent(
            A[keep] / SD, b[keep] / SD, prior, spread, structure, robot.velocity_limit
        )
        error = A @ fit.x - b
        keep = np.abs(error) < OUTLIER
    rms = np.sqrt(np.mean(np.where(keep, error, 0.0).reshape(-1, n) ** 2, axis=0))
    print("N m of tau_model left, by joint:", np.round(rms, 2), f"{keep.mean():.1%} of the rows")
    inertial, rotor, _ = split_terms(fit.x, [0] * n)
    print("kg:", np.round(inertial[:, 0], 2), "rotors, kg m^2:", np.round(rotor, 2))
    return urdf(inertial)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    Path(sys.argv[1]).write_text(fitted())
