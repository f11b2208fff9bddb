import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat

from wrenchsight.systems.wrench_arrows import (
    HEAD_LENGTH,
    MESHCAT_PATH,
    ArrowStyle,
    WrenchArrows,
    arrow_pose,
)

STYLES = {"force true": ArrowStyle((0, 0, 0)), "force estimated": ArrowStyle((0, 0, 1), 0.5)}


@pytest.mark.parametrize(
    "arrow", [[0, 0, 0.2], [0, 0, -0.2], [0.1, 0, 0], [0, -0.05, 0], [0.1, 0.2, -0.3], [0, 0.01, 0]]
)
def test_arrow_points_along_the_force_and_ends_at_its_length(arrow):
    arrow, p = np.array(arrow), np.array([0.3, 0.1, 0.5])
    X, shaft, head = arrow_pose(p, arrow)
    length = np.linalg.norm(arrow)
    np.testing.assert_allclose(X.translation(), p)
    np.testing.assert_allclose(X.rotation().col(2), arrow / length, atol=1e-12)
    assert shaft + head * HEAD_LENGTH == pytest.approx(length)
    assert 0 < head <= 1
    assert shaft > 0


def test_no_force_no_arrow():
    X, shaft, head = arrow_pose(np.ones(3), np.zeros(3))
    np.testing.assert_allclose(X.translation(), 1)
    assert shaft == 0
    assert head < 1e-3


@pytest.mark.parametrize("entry", [np.nan, np.inf, 1e300])
def test_a_force_that_is_no_number_has_no_arrow(entry):
    _, shaft, head = arrow_pose(np.ones(3), np.array([entry, 0.0, 1.0]))
    assert shaft == 0
    assert head < 1e-3


def test_a_place_that_is_not_known_leaves_the_arrows(sts):
    calls = Calls()
    block = WrenchArrows(calls, STYLES, fps=30.0, metres_per_newton=0.02)
    context = block.CreateDefaultContext()
    terms = sts.chain.terms(np.full(6, np.nan), np.zeros(6))
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    for name in STYLES:
        block.GetInputPort(name).FixValue(context, np.ones(6))
    block.ForcedPublish(context)
    assert not calls.set


@pytest.mark.parametrize("fps", [0.0, -30.0, np.nan, np.inf])
def test_frames_a_second_that_are_none_are_refused(fps):
    with pytest.raises(ValueError, match="fps must be positive"):
        WrenchArrows(Calls(), STYLES, fps=fps, metres_per_newton=0.02)


class Calls:
    """Stands for Meshcat, whose recording cannot be read back."""

    def __init__(self):
        self.objects, self.set = {}, {}

    def SetObject(self, path, shape, rgba):
        self.objects[path] = (shape, rgba)

    def SetTransform(self, path, X, time):
        self.set[path, "X"] = (X, time)

    def SetProperty(self, path, name, value, time):
        self.set[path, name] = (value, time)


def drawn(robot, force_true, force_estimated, metres_per_newton=0.02):
    calls = Calls()
    block = WrenchArrows(calls, STYLES, fps=30.0, metres_per_newton=metres_per_newton)
    context = block.CreateDefaultContext()
    terms = robot.chain.terms(robot.home, np.zeros(6))
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("force true").FixValue(context, [9.0, 9, 9, *force_true])
    block.GetInputPort("force estimated").FixValue(context, [9.0, 9, 9, *force_estimated])
    context.SetTime(1.5)
    block.ForcedPublish(context)
    return calls, terms


def test_ports():
    block = WrenchArrows(Calls(), STYLES, fps=30.0, metres_per_newton=0.01)
    names = [block.get_input_port(i).get_name() for i in range(block.num_input_ports())]
    assert names == ["terms", "force true", "force estimated"]


def test_draws_each_force_from_E_in_its_colour_at_its_time(sts):
    calls, terms = drawn(sts, [10.0, 0, 0], [0, 0, -5.0])
    for name, length, along in (
        ("force true", 0.2, [1, 0, 0]),
        ("force estimated", 0.1, [0, 0, -1]),
    ):
        X, time = calls.set[f"{MESHCAT_PATH}/{name}", "X"]
        assert time == 1.5
        np.testing.assert_allclose(X.translation(), terms.p_WE)
        np.testing.assert_allclose(X.rotation().col(2), along, atol=1e-12)
        scale, _ = calls.set[f"{MESHCAT_PATH}/{name}/shaft", "scale"]
        assert scale[2] == pytest.approx(length - HEAD_LENGTH)
        X_tip, _ = calls.set[f"{MESHCAT_PATH}/{name}/head", "X"]
        np.testing.assert_allclose(X_tip.translation(), [0, 0, length], atol=1e-12)
    _, rgba = calls.objects[f"{MESHCAT_PATH}/force estimated/shaft"]
    assert (rgba.b(), rgba.a()) == (1.0, 0.5)


def test_twice_the_scale_twice_the_arrow(sts):
    tips = [
        drawn(sts, [10.0, 0, 0], [0, 0, 0], scale)[0].set[f"{MESHCAT_PATH}/force true/head", "X"][0]
        for scale in (0.01, 0.02)
    ]
    np.testing.assert_allclose(tips[1].translation(), 2 * tips[0].translation())


def test_meshcat_takes_it():
    meshcat = Meshcat()
    WrenchArrows(meshcat, STYLES, fps=30.0, metres_per_newton=0.01)
    for name in STYLES:
        assert meshcat.HasPath(f"{MESHCAT_PATH}/{name}/shaft")
        assert meshcat.HasPath(f"{MESHCAT_PATH}/{name}/head")
