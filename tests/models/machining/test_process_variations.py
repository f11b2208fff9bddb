import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erf

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.process_variations import (
    ChatterConfig,
    CuttingSample,
    EngagementConfig,
    PatchesConfig,
    ProcessVariations,
    RunOutConfig,
    VariationsConfig,
    WavinessConfig,
    WorkpieceContact,
    chatter_limit,
    engagement,
    field_at,
    plane_waves,
    pressed,
    regenerated,
    share_over_edge,
    vary,
)

T = 1e-3
STIFFNESS = 2e5
UP = np.array([0.0, 0.0, 1.0])
NOTHING = VariationsConfig(
    waviness=WavinessConfig(height=0.0),
    patches=PatchesConfig(spread=0.0),
    run_out=RunOutConfig(amplitude=0.0),
    engagement=EngagementConfig(zone=1e-4, margin=0.0),
)
FAR = np.array([[-100.0, 0.0, 0.0], [100.0, 0.0, 0.0]])


def law(config=NOTHING, ends=FAR, R_WP=None, p_WP=(0.0, 0.0, 0.0), friction=0.2, **more):
    R_WP = np.eye(3) if R_WP is None else R_WP
    contact = WorkpieceContact(STIFFNESS, 1.0, friction, R_WP, np.array(p_WP), ends)
    return ProcessVariations(
        config, contact, **({"spindle_frequency": 50.0, "time_step": T} | more)
    )


def varied(of, p, steady, t=0.0, normal_force=40.0, direction=(1.0, 0.0, 0.0), n=UP, memory=None):
    force = np.array(steady, float)
    memory = np.zeros(of.memory_size) if memory is None else memory
    sample = CuttingSample(t, normal_force, n, np.array(direction), np.array(p, float))
    vary(of.tables, sample, memory, force)
    return force


def test_without_variations_the_steady_force_stays():
    steady = [-4.0, 0.5, 0.0]
    np.testing.assert_allclose(varied(law(), [0.1, 0.2, 0.0], steady), steady, atol=1e-12)


def test_without_contact_nothing_acts():
    of = law(VariationsConfig(chatter=ChatterConfig(ratio=0.1)))
    memory = np.ones(of.memory_size)
    force = varied(of, [0.0, 0.0, 0.0], [1.0, 1.0, 1.0], normal_force=0.0, memory=memory)
    np.testing.assert_array_equal(force, 0.0)
    np.testing.assert_array_equal(memory, 0.0)


def test_a_field_has_its_root_mean_square_and_its_wavelengths():
    waves = plane_waves(np.random.SeedSequence(3), 2.0, 0.01, 0.08)
    rng = np.random.default_rng(0)
    places = rng.uniform(-50.0, 50.0, (40_000, 2))  # thousands of the longest wave
    values = np.array([field_at(waves, *place)[0] for place in places])
    # 40,000 draws of variance 4: the standard error of the rms is .35 %.
    assert np.sqrt(np.mean(values**2)) == pytest.approx(2.0, rel=0.015)
    lengths = 2.0 * np.pi / np.hypot(waves["wave_x"], waves["wave_y"])
    assert 0.01 <= lengths.min() < 0.012 and 0.065 < lengths.max() <= 0.08
    # Spread evenly over the logarithm: as many below the geometric mean as above.
    assert np.sum(lengths < math.sqrt(0.01 * 0.08)) == len(lengths) // 2


def test_a_slope_is_the_derivative_of_the_height():
    waves = plane_waves(np.random.SeedSequence(1), 1e-5, 0.008, 0.06)
    step = 1e-6
    for x, y in ((0.0, 0.0), (0.03, -0.11)):
        _, along_x, along_y = field_at(waves, x, y)
        for slope, dx, dy in ((along_x, step, 0.0), (along_y, 0.0, step)):
            expected = field_at(waves, x + dx, y + dy)[0] - field_at(waves, x - dx, y - dy)[0]
            assert slope == pytest.approx(expected / (2.0 * step), rel=1e-6)


def test_another_seed_is_another_workpiece():
    surfaces = [law(VariationsConfig(seed=k)).tables.waviness for k in (1, 1, 2)]
    heights = [field_at(waves, 0.02, 0.03)[0] for waves in surfaces]
    assert heights[0] == heights[1] != heights[2]
    # Surface and material are independent draws.
    of = law(VariationsConfig())
    assert abs(np.corrcoef(of.tables.waviness["phase"], of.tables.patches["phase"])[0, 1]) < 0.6


@pytest.mark.parametrize(("stiffness", "exponent"), [(2e5, 1.0), (math.pi * 1e7, 2.0)])
def test_a_higher_surface_presses_as_the_contact_law_says(stiffness, exponent):
    depth, height = 5e-4, 3e-5
    force = stiffness * depth**exponent
    for h in (height, -height):
        expected = stiffness * (depth + h) ** exponent
        assert pressed(stiffness, exponent, force, h) == pytest.approx(expected, rel=1e-12)
    assert pressed(stiffness, exponent, force, -2.0 * depth) == 0.0
    assert pressed(stiffness, exponent, force, 100.0 * depth) == 2.0 * force
    assert pressed(stiffness, exponent, 0.0, height) == 0.0


def test_a_ball_presses_by_its_pressure_over_the_cap():
    """The hydroelastic law of a ball: pressure E d / R over the plane that cuts it."""
    R, E, depth = 0.02, 1e7, 2e-4
    edge = math.sqrt(2.0 * R * depth)

    def pressure(r):
        return E / R * (depth - 0.5 * r * r / R) * 2.0 * math.pi * r

    assert quad(pressure, 0.0, edge)[0] == pytest.approx(math.pi * E * depth**2, rel=1e-9)


def test_waviness_alone_takes_no_work_round_a_closed_path():
    """Contact on a wavy surface is a spring: force and slope together have a potential."""
    of = law(replace(NOTHING, waviness=WavinessConfig(height=2e-5)), friction=0.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 4001)[:-1]
    path = np.column_stack(
        [0.03 * np.cos(angle), 0.02 * np.sin(angle), 1e-4 * np.sin(3 * angle) - 4e-4]
    )
    along = np.column_stack([-0.03 * np.sin(angle), 0.02 * np.cos(angle), 3e-4 * np.cos(3 * angle)])
    power = []
    for p, d in zip(path, along, strict=True):
        push = -STIFFNESS * p[2]
        force = varied(of, p, np.zeros(3), normal_force=push) + push * UP
        power.append(force @ d)
    work, scale = np.mean(power), np.mean(np.abs(power))
    assert scale > 1e-3
    assert abs(work) < 1e-9 * scale  # periodic and smooth: the sum converges beyond all powers
    # Without the slope it would not close.
    assert abs(np.mean(np.array(power) - slope_power(of, path, along))) > 1e-4 * scale


def slope_power(of, path, along):
    out = []
    for p, d in zip(path, along, strict=True):
        height, gx, gy = field_at(of.tables.waviness, p[0], p[1])
        push = pressed(STIFFNESS, 1.0, -STIFFNESS * p[2], height)
        out.append(-push * (gx * d[0] + gy * d[1]))
    return np.array(out)


def test_patches_scale_friction_and_cutting_alike():
    of = law(replace(NOTHING, patches=PatchesConfig(spread=0.4)))
    p, steady = [0.02, 0.05, 0.0], np.array([-6.0, 0.0, 0.0])
    factor = math.exp(0.4 * field_at(of.tables.patches, p[0], p[1])[0] - 0.08)
    assert abs(factor - 1.0) > 0.05
    # Besides the simulator's own friction of .2 x 40 N.
    expected = factor * steady
    expected[0] -= (factor - 1.0) * 0.2 * 40.0
    np.testing.assert_allclose(varied(of, p, steady), expected, atol=1e-12)
    mean = np.mean(
        [
            math.exp(0.4 * field_at(of.tables.patches, x, y)[0] - 0.08)
            for x, y in np.random.default_rng(1).uniform(-50.0, 50.0, (20_000, 2))
        ]
    )
    assert mean == pytest.approx(1.0, abs=0.02)


def test_patches_are_the_workpieces_own():
    """Turned and moved workpiece, tool with it: the same force, turned."""
    c, s = math.cos(0.7), math.sin(0.7)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]
    )
    move = np.array([0.3, -0.2, 0.5])
    config = VariationsConfig()
    plain, turned = law(config), law(config, ends=FAR @ R.T + move, R_WP=R, p_WP=move)
    p, steady, d = np.array([0.02, 0.05, 0.0]), np.array([-4.0, 1.0, 0.0]), np.array([0.9, 0.1, 0])
    first = varied(plain, p, steady, t=0.004, direction=d)
    then = varied(turned, R @ p + move, R @ steady, t=0.004, direction=R @ d, n=R @ UP)
    np.testing.assert_allclose(then, R @ first, atol=1e-9)


def test_run_out_presses_once_a_turn():
    of = law(replace(NOTHING, run_out=RunOutConfig(amplitude=3e-6)), friction=0.0)
    heights = [varied(of, np.zeros(3), np.zeros(3), t=t)[2] for t in (0.0, 0.005, 0.01, 0.02)]
    np.testing.assert_allclose(heights, [0.6, 0.0, -0.6, 0.6], atol=1e-9)  # 2e5 N/m, 50 Hz


def test_a_zone_runs_over_an_edge_by_its_circles_segment():
    assert share_over_edge(0.0, 0.004) == pytest.approx(0.5)
    assert share_over_edge(-0.004, 0.004) == 0.0 and share_over_edge(0.004, 0.004) == 1.0
    inside = 0.3

    def half(x):
        return 2.0 * math.sqrt(1.0 - x * x)

    expected = quad(half, -inside, 1.0)[0] / math.pi
    assert share_over_edge(inside * 0.004, 0.004) == pytest.approx(expected, rel=1e-9)


def test_cutting_begins_and_ends_a_margin_inside_the_path():
    ends = np.array([[0.1, 0.0, 0.0], [0.1, 0.4, 0.0]])
    config = replace(NOTHING, engagement=EngagementConfig(zone=0.004, margin=0.01))
    of = law(config, ends=ends)
    for y, share in ((0.0, 0.0), (0.01, 0.5), (0.2, 1.0), (0.39, 0.5), (0.4, 0.0)):
        p = np.array([0.1, y, 0.0])
        assert engagement(of.tables.constants, p) == pytest.approx(share, abs=1e-9)
        force = varied(of, p, [0.0, -4.0, 0.0], direction=(0.0, 1.0, 0.0))
        np.testing.assert_allclose(force, [0.0, -4.0 * share, 0.0], atol=1e-9)


def test_a_bump_acts_again_one_turn_later():
    """A bump of one tick, felt at once and, turned round, two thirds of it, a turn later."""
    config = replace(NOTHING, chatter=ChatterConfig(ratio=0.5, overlap=2.0 / 3.0, corner=0.01))
    of = law(config, spindle_frequency=100.0)
    memory = np.zeros(of.memory_size)
    heights = [regenerated(of.tables.constants, 1e-5 if k == 5 else 0.0, memory) for k in range(40)]
    expected = np.zeros(40)
    expected[5] = -0.5e-5  # acts at tick 6
    expected[14] = 0.5e-5 * 2.0 / 3.0  # acts at tick 15: ten ticks after the bump itself
    np.testing.assert_allclose(heights, expected, atol=1e-8)


def test_the_memory_reaches_just_over_a_turn():
    """A turn of 10.4 ticks ends between two ticks, of which the farther one is the last kept."""
    config = replace(NOTHING, chatter=ChatterConfig(ratio=0.5, overlap=1.0, corner=0.01))
    of = law(config, spindle_frequency=1000.0 / 10.4)
    memory = np.zeros(of.memory_size)
    heights = [regenerated(of.tables.constants, 1e-5 if k == 5 else 0.0, memory) for k in range(60)]
    expected = np.zeros(60)
    expected[5] = -0.5e-5
    expected[14], expected[15] = 0.6 * 0.5e-5, 0.4 * 0.5e-5  # of ticks 15 and 16, less 10.4
    np.testing.assert_allclose(heights, expected, atol=1e-8)


def vibration(ratio, z, spindle, n=60_000, dt=2e-5):
    """Growth of a mode k, z under its own regenerated force: log of late over early amplitude."""
    k, omega = STIFFNESS, 2.0 * math.pi * 40.0
    m = k / omega**2
    config = replace(NOTHING, chatter=ChatterConfig(ratio=ratio, corner=0.01))
    of = law(config, spindle_frequency=spindle, time_step=dt)
    memory, y, v, size = np.zeros(of.memory_size), 1e-7, 0.0, np.empty(n)
    for i in range(n):
        force = k * regenerated(of.tables.constants, y, memory)
        v += dt * (force - k * y - 2.0 * z * math.sqrt(k * m) * v) / m
        y += dt * v
        size[i] = abs(y)
    part = n // 4
    return math.log(size[-part:].max() / size[part : 2 * part].max())


@pytest.mark.parametrize(("share", "grows"), [(0.85, False), (1.2, True)])
def test_chatter_grows_above_the_limit_of_a_mode(share, grows):
    """Tlusty's limit, at the speed of the spindle that is worst for this mode."""
    z = 0.1
    ratio = share * chatter_limit(z)
    # The worst frequency is that of the least real part of the compliance, omega sqrt(1 + 2 z);
    # there a turn holds k + 3/4 + ... waves: e = 2 pi - 2 atan(Re / Im) (Altintas, eq. 4.22).
    x = math.sqrt(1.0 + 2.0 * z)
    compliance = 1.0 / (1.0 - x * x + 2j * z * x)
    wave = 3.0 * math.pi + 2.0 * math.atan2(compliance.imag, compliance.real)
    spindle = 40.0 * x * 2.0 * math.pi / (wave % (2.0 * math.pi) + 2.0 * math.pi)
    assert (vibration(ratio, z, spindle) > 0.0) == grows


@pytest.mark.parametrize(
    ("config", "frequency", "place"),
    [
        (VariationsConfig(waviness=WavinessConfig(height=-1.0)), 50.0, "waviness.height"),
        (VariationsConfig(waviness=WavinessConfig(longest=0.001)), 50.0, "waviness.longest"),
        (VariationsConfig(patches=PatchesConfig(spread=math.nan)), 50.0, "patches.spread"),
        (VariationsConfig(chatter=ChatterConfig(overlap=1.5)), 50.0, "chatter.overlap"),
        (VariationsConfig(chatter=ChatterConfig(ratio=0.1)), 0.0, "spindle_frequency"),
        (VariationsConfig(), 500.0, "another frequency"),
        (VariationsConfig(seed=-1), 50.0, "seed"),
    ],
)
def test_bad_parameters_are_named(config, frequency, place):
    with pytest.raises(InputError, match=place):
        law(config, spindle_frequency=frequency)


def test_a_steady_process_may_turn_at_any_frequency():
    law(replace(NOTHING, enabled=False), spindle_frequency=500.0)


def test_the_default_height_is_a_few_newtons():
    """Gaussian to a good part: within one standard deviation as often as erf says."""
    waves = law(VariationsConfig()).tables.waviness
    places = np.random.default_rng(2).uniform(-20.0, 20.0, (20_000, 2))
    push = np.array([pressed(STIFFNESS, 1.0, 40.0, field_at(waves, *place)[0]) for place in places])
    assert np.std(push) == pytest.approx(2e5 * 1e-5, rel=0.03)
    inside = np.mean(np.abs(push - 40.0) < 2.0)
    assert inside == pytest.approx(erf(1.0 / math.sqrt(2.0)), abs=0.02)
