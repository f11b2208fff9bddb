"""The model file: bit-exact round trip, and one clear line for everything wrong with it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.contact_noise import ContactNoise
from wrenchsight.models.identification.identified_model import (
    BaseParameterTable,
    IdentifiedModel,
    LogSource,
    Provenance,
    Validity,
)
from wrenchsight.models.identification.torque_error_model import TorqueErrorModel
from wrenchsight.models.signals.exceedance_tail import ExceedanceTail


@pytest.fixture(scope="module")
def model(sts):
    """A model whose every number uses all its bits, with networks."""
    rng = np.random.default_rng(0)
    n = sts.num_joints
    A = rng.normal(size=(n, n))
    matrices = {key: rng.normal(size=(n, 10)) for key in ("W1", "b1", "W2")}
    networks = FrictionNetworks(
        **matrices, b2=rng.normal(size=n) * 1e-17, v_scale=rng.uniform(0.1, 1.0, n)
    )
    law = CoulombViscous(*rng.normal(size=(3, n)))
    return IdentifiedModel(
        robot=sts.name,
        joint_names=sts.joint_names,
        kinematics_digest=sts.kinematics_digest,
        inertial_parameters=rng.normal(size=(n, 10)) * 10.0 ** rng.integers(-20, 5, (n, 10)),
        reflected_inertia=rng.uniform(size=n),
        friction=SemiParametricFriction(law, networks, rng.uniform(size=n), "literal"),
        residual_covariance=A @ A.T + np.eye(n),
        base_parameters=BaseParameterTable(["a + 2 b", "c"], [1 / 3, 1e-300], [0.1, 0.2], ["d"]),
        condition_number=1 / 7,
        validity=Validity([-1 / 3] * n, [1 / 3] * n, [2 / 3] * n, [1.0] * n, [1e3] * n),
        provenance=Provenance(
            method="test",
            logs=[LogSource("a.csv", "00ff", 2, 9, 1 / 3)],
            time_step=0.001,
            cutoff=5.0,
            filter_order=5,
            residual="made up",
        ),
    )


def saved(model, folder) -> Path:
    path = folder / "model.yaml"
    model.save(path)
    return path


def test_round_trip_is_bit_exact(model, sts, tmp_path):
    loaded = IdentifiedModel.load(saved(model, tmp_path), sts)
    for key in ("inertial_parameters", "reflected_inertia", "residual_covariance"):
        np.testing.assert_array_equal(getattr(loaded, key), getattr(model, key))
    for key in ("robot", "joint_names", "kinematics_digest", "condition_number"):
        assert getattr(loaded, key) == getattr(model, key)
    for key in ("base_parameters", "validity", "provenance"):
        assert getattr(loaded, key) == getattr(model, key)
    np.testing.assert_array_equal(loaded.friction.v_crit, model.friction.v_crit)
    assert loaded.friction.handover == "literal"
    np.testing.assert_array_equal(loaded.friction.table, model.friction.table)


def test_same_model_gives_the_same_bytes(model, tmp_path):
    content = saved(model, tmp_path).read_bytes()
    assert saved(model, tmp_path).read_bytes() == content


def test_a_failed_save_leaves_the_old_file(model, sts, tmp_path):
    path = saved(model, tmp_path)
    content = path.read_bytes()
    with pytest.raises(Exception, match="object"):
        replace(model, provenance=object()).save(path)
    assert path.read_bytes() == content
    assert [p.name for p in tmp_path.iterdir()] == ["model.yaml"]


def test_nominal_model_is_the_robot_file(sts, tmp_path):
    nominal = IdentifiedModel.nominal(sts)
    rng = np.random.default_rng(1)
    q, v, vdot = rng.normal(size=(3, 5, sts.num_joints))
    np.testing.assert_array_equal(
        nominal.chain(sts).inverse_dynamics(q, v, vdot),
        sts.chain.inverse_dynamics(q, v, vdot),
    )
    np.testing.assert_array_equal(nominal.friction.torque(v), np.zeros_like(v))
    IdentifiedModel.load(saved(nominal, tmp_path), sts)


def test_chain_carries_the_models_inertias(model, sts):
    chain = model.chain(sts)
    np.testing.assert_array_equal(chain.inertial_parameters, model.inertial_parameters)
    np.testing.assert_array_equal(chain.reflected_inertia, model.reflected_inertia)
    np.testing.assert_array_equal(chain.p_PJ, sts.chain.p_PJ)


def refusal(path, robot) -> str:
    with pytest.raises(InputError) as error:
        IdentifiedModel.load(path, robot)
    line = str(error.value)
    assert "\n" not in line
    assert str(path) in line
    return line


def edited(model, folder, edit) -> Path:
    path = saved(model, folder)
    content = yaml.safe_load(path.read_text())
    edit(content)
    path.write_text(yaml.safe_dump(content))
    return path


def put(*keys, value):
    def edit(content):
        for key in keys[:-1]:
            content = content[key]
        content[keys[-1]] = value

    return edit


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (put("robot", value="other_arm"), "of robot 'other_arm'"),
        (put("kinematics_digest", value="0123456789abcdef"), "other kinematics"),
        (put("joint_names", 0, value="elbow"), "has joints elbow"),
        (put("version", value=2), "version 2"),
        (put("format", value="something"), "something"),
        (put("reflected_inertia", 2, value=float("inf")), "reflected_inertia"),
        (put("inertial_parameters", 1, 3, value=float("nan")), "inertial_parameters[1][3]"),
        (put("reflected_inertia", value=[1.0]), "expected 6 numbers, found 1"),
        (put("reflected_inertia", 2, value=1e308), "reflected_inertia"),  # overflows where squared
        (put("inertial_parameters", 0, value=[1.0]), "rows of unequal length"),
        (put("residual_covariance", 0, 0, value=-1.0), "positive definite"),
        (put("residual_covariance", 0, 1, value=50.0), "symmetric"),
        (put("friction", "handover", value="jump"), "continuous or literal"),
        (put("friction", "v_crit", 0, value=-1.0), "friction.v_crit"),
        (put("friction", "coulomb", value=[1.0]), "friction.coulomb"),
        (put("friction", "networks", "v_scale", 0, value=0.0), "v_scale"),
        (put("friction", "networks", "b1", value=[[1.0]]), "friction.networks.b1"),
        (put("base_parameters", "values", value=[1.0]), "base_parameters.values"),
        (put("validity", "q_min", value=[1.0]), "validity.q_min"),
        (put("inertial_paramters", value=[]), "inertial_parameters"),  # misspelt: the nearest key
        (lambda content: content.pop("friction"), "friction"),
        (put("reflected_inertia", 0, value="much"), "much"),
    ],
)
def test_wrong_content_gets_one_line(model, sts, tmp_path, edit, expected):
    assert expected in refusal(edited(model, tmp_path, edit), sts)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99, 0.999])
def test_a_truncated_file_is_refused(model, sts, tmp_path, share):
    path = saved(model, tmp_path)
    text = path.read_text()
    # At a line's end: the YAML may well be whole, only keys or rows are missing.
    path.write_text("\n".join(text.splitlines()[: int(share * text.count("\n"))]))
    refusal(path, sts)


def test_no_file_a_folder_and_a_binary_file_are_refused(model, sts, tmp_path):
    refusal(tmp_path / "none.yaml", sts)
    refusal(tmp_path, sts)
    binary = tmp_path / "model.yaml"
    binary.write_bytes(bytes(range(256)))
    refusal(binary, sts)


def test_the_model_of_another_robot_has_no_chain_here(ur10e, model):
    with pytest.raises(InputError, match="of robot 'sts_sre4_600', not of 'ur10e'"):
        model.chain(ur10e)


def with_memory(model):
    n = len(model.joint_names)
    rng = np.random.default_rng(8)
    near_zero = SemiParametricFriction(
        CoulombViscous(np.zeros(n), *rng.normal(size=(2, n))),
        model.friction.networks,
        rng.uniform(size=n),
    )
    weight = rng.uniform(0.1, 0.9, n)
    friction = PreslidingFriction(
        near_zero,
        coulomb=rng.uniform(size=n),
        stribeck=rng.normal(size=n),
        stribeck_velocity=rng.uniform(0.1, 1.0, n),
        load=rng.uniform(size=n),
        cubic=rng.normal(size=n),
        weight=np.stack([weight, 1.0 - weight], axis=1),
        displacement=rng.uniform(size=(n, 2)) * 1e-3,
    )
    return replace(model, friction=friction)


@pytest.mark.parametrize("networks", [True, False])
def test_a_law_with_memory_makes_the_round_trip(model, sts, tmp_path, networks):
    remembering = with_memory(model)
    if not networks:
        near_zero = replace(remembering.friction.velocity_law, networks=None)
        law = replace(remembering.friction, velocity_law=near_zero)
        remembering = replace(remembering, friction=law)
    loaded = IdentifiedModel.load(saved(remembering, tmp_path), sts).friction
    assert isinstance(loaded, PreslidingFriction)
    np.testing.assert_array_equal(loaded.slip_table, remembering.friction.slip_table)
    np.testing.assert_array_equal(
        loaded.velocity_law.table, remembering.friction.velocity_law.table
    )


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("load", 1.5, "load must be in"),
        ("stribeck_velocity", 0.0, "must be positive"),
        ("displacement", None, "presliding.displacement"),
    ],
)
def test_a_broken_law_with_memory_is_one_clear_line(model, sts, tmp_path, key, value, message):
    path = saved(with_memory(model), tmp_path)
    content = yaml.safe_load(path.read_text())
    block = content["friction"]["presliding"]
    if value is None:
        block[key] = block[key][:-1]
    else:
        block[key][0] = value
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=message) as error:
        IdentifiedModel.load(path, sts)
    assert "\n" not in str(error.value)


def with_torque_error(model):
    n = len(model.joint_names)
    rng = np.random.default_rng(5)
    constants = {
        key: rng.uniform(0.1, 1.0, n)
        for key in (
            "constant",
            "speed",
            "load",
            "acceleration",
            "reversal",
            "correlation_time",
            "lasting",
            "fitted_speed",
            "fitted_load",
            "K_0",
            "resolution",
        )
    }
    correlation = np.full((n, n), 0.1) + 0.9 * np.eye(n)
    error = TorqueErrorModel(**constants, correlation=correlation, drift=1.0 / 3.0)
    return replace(model, torque_error=error)


def test_a_file_without_the_drift_of_a_log_loads(model, sts, tmp_path):
    original = with_torque_error(model)
    shown = replace(original.torque_error, drift_shown=np.linspace(0.0, 0.5, 6))
    path = saved(replace(original, torque_error=shown), tmp_path)
    loaded = IdentifiedModel.load(path, sts).torque_error
    np.testing.assert_array_equal(loaded.drift_shown, shown.drift_shown)
    content = yaml.safe_load(path.read_text())
    del content["torque_error"]["drift_shown"]
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    assert not IdentifiedModel.load(path, sts).torque_error.drift_shown.any()


def test_a_file_without_the_spread_of_gravity_loads(model, sts, tmp_path):
    original = with_torque_error(model)
    spread = np.linspace(-1.0, 1.0, 60).reshape(2, 6, 5)
    with_spread = replace(
        original.torque_error, spread=spread, fitted_spread=np.linspace(0.0, 0.5, 6)
    )
    path = saved(replace(original, torque_error=with_spread), tmp_path)
    loaded = IdentifiedModel.load(path, sts).torque_error
    np.testing.assert_array_equal(loaded.spread, spread)
    np.testing.assert_array_equal(loaded.fitted_spread, with_spread.fitted_spread)
    content = yaml.safe_load(path.read_text())
    content["torque_error"]["spread"][0].pop()
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(InputError, match=r"torque_error\.spread: expected any x 6 x 5 num"):
        IdentifiedModel.load(path, sts)
    del content["torque_error"]["spread"], content["torque_error"]["fitted_spread"]
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    assert IdentifiedModel.load(path, sts).torque_error.spread.shape == (0, 6, 5)


def test_the_torque_error_makes_the_round_trip(model, sts, tmp_path):
    original = with_torque_error(model)
    loaded = IdentifiedModel.load(saved(original, tmp_path), sts)
    assert loaded.torque_error.to_dict() == original.torque_error.to_dict()


def test_a_file_without_the_torque_error_loads(model, sts, tmp_path):
    path = saved(with_torque_error(model), tmp_path)
    content = yaml.safe_load(path.read_text())
    del content["torque_error"]
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    assert IdentifiedModel.load(path, sts).torque_error is None


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("constant", -1.0, "torque_error.constant: expected zero or more"),
        ("reversal", float("nan"), "torque_error.reversal"),
        ("load", None, "torque_error.load"),
    ],
)
def test_a_broken_torque_error_is_one_clear_line(model, sts, tmp_path, key, value, message):
    path = saved(with_torque_error(model), tmp_path)
    content = yaml.safe_load(path.read_text())
    block = content["torque_error"]
    if value is None:
        block[key] = block[key][:-1]
    else:
        block[key][0] = value
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(InputError, match=message) as error:
        IdentifiedModel.load(path, sts)
    assert "\n" not in str(error.value)


def test_the_fitted_speed_of_a_law_makes_the_round_trip(model, sts, tmp_path):
    original = with_memory(model)
    limit = np.linspace(0.5, 1.5, len(model.joint_names))
    bounded = replace(original, friction=replace(original.friction, speed_limit=limit))
    loaded = IdentifiedModel.load(saved(bounded, tmp_path), sts).friction
    np.testing.assert_array_equal(loaded.speed_limit, limit)
    free = IdentifiedModel.load(saved(original, tmp_path), sts).friction
    assert np.isinf(free.speed_limit).all()


def with_contact_noise(model):
    tail = ExceedanceTail(level=3.7, rate_per_hour=1175.7, scale=1.0 / 3.0, shape=0.025)
    change = {"change_sd": [[0.1, *([0.0] * 6)]] * 6, "change": tail}
    noise = ContactNoise([0.1] * 6, [0.7] * 6, 0.01, 0.034, sample=tail, mean=tail, **change)
    return replace(model, contact_noise=noise)


def test_the_contact_noise_makes_the_round_trip(model, sts, tmp_path):
    original = with_contact_noise(model)
    assert (
        IdentifiedModel.load(saved(original, tmp_path), sts).contact_noise == original.contact_noise
    )


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        ("mean_scale", [0.7] * 5, r"contact_noise\.mean_scale: expected 6 numbers"),
        ("usual_jolt", [-1.0] * 6, r"contact_noise\.usual_jolt: expected 6 numbers, 0 or more"),
        ("change_sd", [[0.1] * 6] * 6, r"contact_noise\.change_sd: expected 6 rows of 7 numbers"),
        ("change_sd", [[0.0] * 7] * 6, r"contact_noise\.change_sd: .*not all zero"),
        ("hours", 0.0, r"contact_noise\.hours: expected a number above zero"),
        (
            "sample",
            {"level": 1.0, "rate_per_hour": 1.0, "scale": 0.0, "shape": 0.0},
            r"contact_noise\.sample: expected numbers of zero or more, scale above zero",
        ),
    ],
)
def test_a_contact_noise_that_cannot_be_is_one_line(model, sts, tmp_path, key, value, problem):
    path = saved(with_contact_noise(model), tmp_path)
    content = yaml.safe_load(path.read_text())
    content["contact_noise"][key] = value
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=problem):
        IdentifiedModel.load(path, sts)
