"""What the tests share: the robots, and the folder of recordings.

Robots are immutable once loaded, so that one of each serves all tests of a process.
"""

import gc
import os
import signal
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
import yaml

import wrenchsight.analyses  # noqa: F401  (chooses the number of BLAS threads, before numpy is imported)
from wrenchsight.analyses.data_sets.advice import how_to_get
from wrenchsight.analyses.data_sets.places import CACHE_VARIABLE, find_data_set
from wrenchsight.analyses.data_sets.registry import DATA_SETS
from wrenchsight.models.numerics.kernel import one_thread
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.truth.true_robot import PLAIN_TRUTH_FILE, plain_truth

ROOT = Path(__file__).parents[1]
ROBOTS = Path(__file__).parent / "robots"

# Of the example-robot-data wheel: URDF, base link, flange and locked joints.
_WHEEL: dict[str, tuple[str, str, str, dict[str, float]]] = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "base_link", "tool0", {}),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "base_link", "ee_link", {}),
    "panda": (
        "panda_description/urdf/panda.urdf",
        "panda_link0",
        "panda_hand_tcp",
        {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.01},
    ),
}


# Two workers take them in turn: one the estimator, the other until then what has none, from the
# true arm to machining. A file that runs estimators would compile the same at the same time.
_COMPILING = (
    "models/estimation/test_estimator.py",
    "models/truth/test_free_arm.py",
    "models/detection/test_contact_detector.py",
    "models/rigid_body/test_serial_chain.py",
    "models/planning/motion/test_posture_cost.py",
    "diagrams/placement/test_placement_program.py",
    "systems/test_impedance_controller.py",
    "models/control/test_impedance.py",
    "models/machining/test_machining_reference.py",
    "models/planning/motion/test_redundancy.py",
    "models/machining/test_machining_phases.py",
    "test_extensions.py",
    "diagrams/test_observers_everywhere.py",
    "analyses/methods/simulate/test_simulation.py",
    "diagrams/test_fused_estimator.py",
    "analyses/test_tilted_arm.py",
    "models/estimation/test_smoothing.py",
)


@pytest.hookimpl(trylast=True)  # of the tests that were not deselected
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sets the order of the files, which workers take from the front.

    First those that compile the most kernels, so that neither worker compiles what the other does.
    Then those with long tests, so that no worker begins one when the others are about to end.
    """
    long = {
        item.path
        for item in items
        if any(item.get_closest_marker(name) is not None for name in ("long", "slow"))
    }
    first = {ROOT / "tests" / file: place for place, file in enumerate(_COMPILING)}
    items.sort(key=lambda item: (first.get(item.path, len(first)), item.path not in long))


def pytest_collection_finish() -> None:
    """Spares the garbage collector the looks at what stays, which take a tenth of a compilation:
    at what was imported, and at each step of a compilation anew.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


# Shared work --------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def common_work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for `sharing_in`: what several experiments identify is identified once.

    It serves all workers of a run, and no other run. Within it an experiment runs as in a study.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:  # whose folders lie in one of the whole run
        folder = folder.parent
    folder = folder / "common-work"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(name="one_thread")
def _one_thread() -> Iterator[None]:
    """Numba's loops in this thread, as in the process that reads samples one by one."""
    with one_thread():
        yield


# Recordings ---------------------------------------------------------------------------------------


@pytest.fixture(scope="session", autouse=True)
def recordings_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with links to the recordings of who runs the tests, wherever they are.

    What tests run sees an empty cache: what somebody has fetched must not change a test.
    """
    linked = tmp_path_factory.mktemp("recordings")
    for name, one in DATA_SETS.items():
        place = find_data_set(name, ROOT.parent / "shared" / "data")
        if place is not None:
            folder = linked / (one.part_of or name)
            folder.mkdir(exist_ok=True)
            for file in place.folder.iterdir():
                if not (folder / file.name).exists():
                    (folder / file.name).symlink_to(file)
    os.environ[CACHE_VARIABLE] = str(tmp_path_factory.mktemp("cache"))
    return linked


@pytest.fixture(scope="session")
def data_holding(recordings_folder: Path) -> Callable[..., Path]:
    """Finds the folder of recordings for who takes them from it: `data_holding("ur10e/a.csv")`.

    The test is skipped where a file that it names is missing. Files are named, never taken as they
    lie there: another recording beside them must not change a test. A recording that the
    repository holds as Parquet is there as CSV, too.
    """

    def find(*names: str) -> Path:
        for name in names:
            path = recordings_folder / name
            if path.suffix == ".csv" and path.with_suffix(".parquet").is_file():
                if not path.exists():
                    pa_csv.write_csv(pq.read_table(path.with_suffix(".parquet")), path)
            elif not path.is_file():
                pytest.skip(f"no recording {name}: {how_to_get(_set_of(name))}")
        return recordings_folder

    return find


def _set_of(name: str) -> str:
    """The set of recordings that a file `set/file` is of."""
    folder, _, file = name.partition("/")
    for part in DATA_SETS.values():
        if part.part_of == folder and file in {one.name for one in part.converted}:
            return part.name
    return folder


@pytest.fixture(scope="session")
def some_data(
    data_holding: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Path]:
    """Makes a folder of links to the recordings that are named, and to no others."""

    def link(*names: str) -> Path:
        root, folder = data_holding(*names), tmp_path_factory.mktemp("data")
        for name in names:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).symlink_to(root / name)
        return folder

    return link


@pytest.fixture(scope="session")
def data(data_holding: Callable[..., Path]) -> Callable[[str], Path]:
    """Finds a recording: `data("ur10e/a.csv")`; the test is skipped where it is not there."""
    return lambda name: data_holding(name) / name


# Bundled robots -----------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def sts() -> Robot:
    """The article's arm, its truth the plain one.

    Blocks and methods are held against closed forms, which know of no creep, bent gear or
    wandering friction. What the arm's own truth does to a loop is tested in tests/models/truth,
    tests/diagrams/test_real_joints.py and with the tasks (`Robot.load`).
    """
    return plain_truth(Robot.load("sts_sre4_600"))


@pytest.fixture(scope="session")
def ur10e() -> Robot:
    return Robot.load("ur10e")


@pytest.fixture(scope="session", params=["sts", "ur10e"])
def bundled_arm(request: pytest.FixtureRequest) -> Robot:
    """Each bundled robot in turn."""
    robot: Robot = request.getfixturevalue(request.param)
    return robot


@pytest.fixture(scope="session")
def sts_reversed(sts: Robot, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """The article's arm, three of whose drives count their current the other way.

    Whatever is read from its currents is what is read from the plain arm's.
    """
    config = _plain_config(sts)
    for drive in config["drives"][::2]:
        drive["current_sign"] = -1
    return _written(tmp_path_factory, config)


@pytest.fixture(scope="session")
def ur10e_turned(ur10e: Robot, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """The UR10e with a tool that is turned on its flange, and a first joint of unequal ranges."""
    config = yaml.safe_load(ur10e.source.read_text(encoding="utf-8"))
    urdf = ur10e.source.with_name(config["urdf"]).read_text(encoding="utf-8")
    config["tool_frame"] = {"xyz": [0.05, -0.04, 0.12], "rpy": [0.5, -0.4, 0.9]}
    for drive in config["drives"][::2]:
        drive["current_sign"] = -1
    joint = urdf.index('name="shoulder_pan_joint"')
    limit = 'lower="-6.283185307179586" upper="6.283185307179586"'
    assert limit in urdf[joint:]
    urdf = urdf[:joint] + urdf[joint:].replace(limit, 'lower="-0.6" upper="2.8"', 1)
    return _written(tmp_path_factory, config, urdf)


@pytest.fixture(scope="session")
def coupled_wrist(sts: Robot, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """The article's arm with a wrist whose motors turn each other's joints, one counting back."""
    config = _plain_config(sts)
    config["drives"][4]["current_sign"] = -1
    rows = [[float(i == k) for k in range(6)] for i in range(6)]
    rows[4][3], rows[5][4] = 0.5, -1.0
    config["coupling"] = rows
    return _written(tmp_path_factory, config)


def _plain_config(robot: Robot) -> dict[str, Any]:
    """What the robot's file says, but for its truth: the plain one beside it."""
    config: dict[str, Any] = yaml.safe_load(robot.source.read_text(encoding="utf-8"))
    config["urdf"] = str(robot.source.with_name(config["urdf"]))
    config["simulated_truth"] = yaml.safe_load(
        robot.source.with_name(PLAIN_TRUTH_FILE).read_text("utf-8")
    )
    return config


# Robots of other people, and of nobody ------------------------------------------------------------


@pytest.fixture(scope="session")
def wheel_robots() -> Path:
    """The robots' folder of the example-robot-data wheel."""
    wheel = metadata.distribution("example-robot-data")
    return Path(str(wheel.locate_file("cmeel.prefix/share/example-robot-data/robots")))


@pytest.fixture(scope="session")
def wheel_robot(
    tmp_path_factory: pytest.TempPathFactory, wheel_robots: Path
) -> Callable[[str], Robot]:
    """Loads "ur5", "ur10" or "panda" of the example-robot-data wheel, with drives made up."""

    def load(name: str) -> Robot:
        robots = wheel_robots
        urdf, base, flange, locked = _WHEEL[name]
        moving = [
            joint.get("name")
            for joint in ET.parse(robots / urdf).getroot().findall("joint")
            if joint.get("type") != "fixed" and joint.get("name") not in locked
        ]
        drive = {"torque_per_ampere": 10.0, "rotor_inertia": 0.1, "rotor_inertia_side": "joint"}
        config = {
            "name": name,
            "urdf": str(robots / urdf),
            "base_link": base,
            "flange": flange,
            "locked_joints": locked,
            "payload": 3.0,
            "home": [0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0][: len(moving)],
            "drives": [{"joint": joint, **drive} for joint in moving],
        }
        return _written(tmp_path_factory, config)

    return load


@pytest.fixture(scope="session")
def panda(wheel_robot: Callable[[str], Robot]) -> Robot:
    """Seven joints, fingers locked."""
    return wheel_robot("panda")


@pytest.fixture(scope="session")
def serial_robot(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Robot]:
    """Makes robots whose links are balls of 1 kg.

    `joints` are (kind, axis, xyz of the joint in its parent); each travels `limit` either way.
    """

    def make(joints: Sequence[tuple[str, str, str]], limit: float = 3.0, **changes: Any) -> Robot:
        parts = ['<robot name="chain"><link name="l0"/>']
        for i, (kind, axis, xyz) in enumerate(joints):
            parts.append(
                f'<link name="l{i + 1}"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" '
                'izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
                f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
                f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
                f'<limit lower="-{limit}" upper="{limit}" velocity="1" effort="10"/></joint>'
            )
        config = {
            "name": "chain",
            "urdf": "robot.urdf",
            "base_link": "l0",
            "flange": f"l{len(joints)}",
            "payload": 1.0,
            "tool_frame": {"xyz": [0.0, 0.0, 0.1]},
            "home": [0.1 * (-1) ** i for i in range(len(joints))],
            "drives": [
                {"joint": f"j{i}", "torque_per_ampere": 1.0, "rotor_inertia": 0.0}
                for i in range(len(joints))
            ],
        }
        return _written(tmp_path_factory, config | changes, "".join(parts) + "</robot>")

    return make


@pytest.fixture(scope="session")
def seven(serial_robot: Callable[..., Robot]) -> Robot:
    """A seven-joint arm: shoulder, elbow and wrist of three, one and three axes, 3 rad each way."""
    joints = [
        ("revolute", "0 0 1", "0 0 0.3"),
        ("revolute", "0 1 0", "0 0 0"),
        ("revolute", "0 0 1", "0 0 0"),
        ("revolute", "0 1 0", "0 0 0.4"),
        ("revolute", "0 0 1", "0 0 0.35"),
        ("revolute", "0 1 0", "0 0 0"),
        ("revolute", "0 0 1", "0.05 0 0"),
    ]
    return serial_robot(
        joints,
        name="seven",
        tool_frame={"xyz": [0.0, 0.0, 0.15]},
        home=[0.1, 0.6, 0.1, 1.2, 0.1, 0.8, 0.1],
    )


@pytest.fixture(scope="session")
def tilted_arm_file() -> Path:
    """Of an arm of three joints, unlike the bundled ones wherever it can be: see its files."""
    return ROBOTS / "tilted_arm" / "robot.yaml"


@pytest.fixture(scope="session")
def tilted_arm(tilted_arm_file: Path) -> Robot:
    return Robot.load(tilted_arm_file)


@pytest.fixture(autouse=True, scope="session")
def signals_as_in_a_terminal() -> Iterator[None]:
    """Tests that were started by nohup, or in a script's background, inherit signals that are
    ignored, and so do the commands that they start.
    """
    usual: dict[int, Any] = {
        signal.SIGINT: signal.default_int_handler,
        signal.SIGTERM: signal.SIG_DFL,
        signal.SIGHUP: signal.SIG_DFL,
    }
    before = {number: signal.getsignal(number) for number in usual}
    for number, handler in usual.items():
        if before[number] == signal.SIG_IGN:
            signal.signal(number, handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def _written(
    tmp_path_factory: pytest.TempPathFactory, config: dict[str, Any], urdf: str | None = None
) -> Robot:
    """The robot of a robot.yaml that holds `config`, with robot.urdf beside it."""
    folder = tmp_path_factory.mktemp(str(config["name"]))
    if urdf is not None:
        (folder / "robot.urdf").write_text(urdf, encoding="utf-8")
    (folder / "robot.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    return Robot.load(folder / "robot.yaml")
