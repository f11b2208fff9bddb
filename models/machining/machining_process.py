"""Machining process: cutting resistance, unbalance and vibration of a rotating abrasive tool.

Contact with Coulomb friction is the simulator's. On top of it acts the resistance of the material
that is being removed, along the feed. By Preston's law the removal rate is proportional to normal
force and speed, Q = K_p F_n v (F. W. Preston, J. Soc. Glass Technology 11, 1927); with the
specific energy e of the material the power e Q = F_c v gives a resistance F_c = e K_p F_n in
proportion to the normal force, the grinding force ratio. The specific energy falls with the chip's
thickness, so that force grows with the feed less than in proportion, as in Werner's model of
grinding forces, F ~ v^(2 eps - 1) with eps between 0.5 and 1 (Malkin and Guo, Grinding Technology,
2nd ed., ch. 5):

    F_c = cutting_ratio F_n (|v| / reference_speed)^speed_exponent, against v

v is the feed, tangential to the surface. The zone of cutting follows it with a first-order lag
(`lag`), without which an explicit force would chatter at rest.

The spindle's unbalance turns with it, across its axis: F_u = unbalance omega^2.

While it touches, the tool vibrates along the surface's normal, far faster than anything that is
simulated: with the velocity's amplitude `vibration`, that an accelerometer on it shows. How far it
shakes the joints is in `wrenchsight.models.machining.tool_vibration`, what this does to their
friction in `wrenchsight.models.truth.joint_kernels`. No encoder and no current shows it, and its
force has the mean zero.

That is a steady process. `wrenchsight.models.machining.process_variations` says what makes it vary.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.process_variations import (
    CuttingSample,
    ProcessVariations,
    VariationsConfig,
    VariationTables,
    WorkpieceContact,
    check_variations,
    vary,
)
from wrenchsight.models.machining.tool_vibration import vibration_shares
from wrenchsight.models.numerics.arrays import Array, Record, record, record_type
from wrenchsight.models.numerics.kernel import in_kernels, kernel
from wrenchsight.models.signals.tool_contact import NormalContact

_REST_SPEED = 2e-3  # m/s, below which the direction of the feed fades
PROCESS_TYPE = record_type(
    cutting_ratio=(),
    speed_exponent=(),
    reference_speed=(),
    lag=(),
    omega=(),
    unbalance=(),
    vibration=(),
)
"""The constants of a process: those of ProcessConfig, and `omega` of its spindle, rad/s."""
_MIN_STATE_SIZE = 10  # of `process_parts` without the memory of chatter


class ProcessState(NamedTuple):
    """The state of a process.

    Attributes:
        normal_force: (1,) N.
        normal: (3,) unit normal of the surface, in W; of the last contact.
        feed: (3,) m/s, lagged, in W.
        force: (3,) N, on the tool besides contact, in W.
        chatter: (memory_size,) of ProcessVariations.
    """

    normal_force: Array
    normal: Array
    feed: Array
    force: Array
    chatter: Array


@in_kernels
def process_parts(state: Array) -> ProcessState:
    """The parts of a flat state, as views."""
    return ProcessState(
        normal_force=state[:1],
        normal=state[1:4],
        feed=state[4:7],
        force=state[7:_MIN_STATE_SIZE],
        chatter=state[_MIN_STATE_SIZE:],
    )


@dataclass
class ProcessConfig:
    """Polishing and grinding differ in these numbers alone."""

    cutting_ratio: float = 0.1
    """N per N of normal force, at reference_speed"""
    speed_exponent: float = 0.2
    """2 eps - 1: 0 to 1"""
    reference_speed: float = 0.018
    """m/s of feed"""
    lag: float = 0.01
    """s"""
    spindle_frequency: float = 50.0
    """Hz"""
    unbalance: float = 1e-5
    """kg m: mass times eccentricity"""
    vibration: float = 0.0
    """m/s, amplitude of the tool's velocity along the normal, in contact"""
    variations: VariationsConfig = field(default_factory=VariationsConfig)


class MachiningProcess:
    """The law of this module for one set of parameters.

    Attributes:
        constants: (1,) of PROCESS_TYPE, for the kernels of this module.
        variations: None where the process is steady.

    Args:
        config: the law's numbers.
        source: named in messages.
        contact: contact of the workpiece; without it the process is steady, whatever the
            configuration.
        time_step: s.

    Raises:
        InputError: a parameter out of range.
    """

    def __init__(
        self,
        config: ProcessConfig,
        source: str = "process",
        contact: WorkpieceContact | None = None,
        time_step: float = 1e-3,
    ) -> None:
        """Checks the settings, packs them for the kernels, and draws the variations, if any."""
        # The spindle's bound is below half the rate of 1 ms ticks, at which it would be seen at
        # another frequency; the others are wider than any tool and catch a wrong unit.
        for name, low, high in (
            ("cutting_ratio", 0.0, 10.0),
            ("speed_exponent", 0.0, 1.0),
            ("reference_speed", 1e-6, 10.0),
            ("lag", 1e-3, 1.0),
            ("spindle_frequency", 0.0, 450.0),
            ("unbalance", 0.0, 0.1),
            ("vibration", 0.0, 1.0),
        ):
            value = getattr(config, name)
            if not low <= value <= high:
                raise InputError(source, name, f"{value:g}, expected {low:g} to {high:g}")
        self.config = config
        self.constants = record(
            cutting_ratio=config.cutting_ratio,
            speed_exponent=config.speed_exponent,
            reference_speed=config.reference_speed,
            lag=config.lag,
            omega=2.0 * math.pi * config.spindle_frequency,
            unbalance=config.unbalance,
            vibration=config.vibration,
        )
        place = f"{source}.variations"
        check_variations(config.variations, config.spindle_frequency, time_step, place)
        self.variations: ProcessVariations | None = None
        if config.variations.enabled and contact is not None:
            self.variations = ProcessVariations(
                config.variations, contact, config.spindle_frequency, time_step, place
            )

    @property
    def initial_state(self) -> Array:
        """The flat state before the first contact, of `process_parts`."""
        memory = 0 if self.variations is None else self.variations.memory_size
        return np.zeros(_MIN_STATE_SIZE + memory)


class ProcessTick(NamedTuple):
    """A tick of the simulation, as a varying process reads it.

    Attributes:
        t: s, at the tick's start; the force acts from its end.
        time_step: s.
        pressed: normal force, and normal of the surface, zero without contact.
        V_WE: (6,) of the tool, rotation first.
        p_WE: (3,) m, place of the tool.
    """

    t: float
    time_step: float
    pressed: NormalContact
    V_WE: Array
    p_WE: Array


@kernel
def cutting_force(process: Record, normal_force: float, feed: Array, force: Array) -> None:
    """Writes the force (3,) N of the workpiece on the tool, against the feed.

    Args:
        process: MachiningProcess.constants.
        normal_force: N, between tool and workpiece.
        feed: (3,) m/s, tangential velocity of the tool, lagged.
    """
    speed = math.sqrt(feed[0] ** 2 + feed[1] ** 2 + feed[2] ** 2 + _REST_SPEED * _REST_SPEED)
    law = process[0]
    size = law.cutting_ratio * normal_force * (speed / law.reference_speed) ** law.speed_exponent
    for i in range(3):
        force[i] = -size * feed[i] / speed


@kernel
def advance_feed(process: Record, time_step: float, n: Array, v: Array, feed: Array) -> None:
    """Moves the lagged feed (3,) on by a tick, in place.

    Args:
        time_step: s.
        n: (3,) unit normal of the surface.
        v: (3,) m/s, velocity of the tool over the workpiece.
    """
    share = 1.0 - math.exp(-time_step / process[0].lag)
    along = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
    for i in range(3):
        feed[i] += share * (v[i] - along * n[i] - feed[i])
    # The surface turns below the tool: the feed stays in it.
    along = n[0] * feed[0] + n[1] * feed[1] + n[2] * feed[2]
    for i in range(3):
        feed[i] -= along * n[i]


@kernel
def advance_process(
    process: Record, time_step: float, pressed: NormalContact, V_WE: Array, state: Array
) -> None:
    """Moves the state of a steady process on by a tick; without contact the normal stays.

    Args:
        time_step: s.
        pressed: normal force, and normal of the surface, zero without contact.
        V_WE: (6,) of the tool, rotation first.
        state: flat, of `process_parts`, changed.
    """
    parts = process_parts(state)
    parts.normal_force[:] = pressed.force
    if np.any(pressed.normal != 0.0):
        parts.normal[:] = pressed.normal
    advance_feed(process, time_step, parts.normal, V_WE[3:], parts.feed)
    cutting_force(process, parts.normal_force[0], parts.feed, parts.force)


@kernel
def advance_varying_process(
    process: Record, variations: VariationTables, tick: ProcessTick, state: Array
) -> None:
    """Moves the state of a varying process on by a tick, as `advance_process`.

    Args:
        variations: variations of ProcessVariations.
        state: flat, of `process_parts`, changed.
    """
    advance_process(process, tick.time_step, tick.pressed, tick.V_WE, state)
    parts = process_parts(state)
    feed = parts.feed
    speed = math.sqrt(feed[0] ** 2 + feed[1] ** 2 + feed[2] ** 2 + _REST_SPEED * _REST_SPEED)
    sample = CuttingSample(
        t=tick.t + tick.time_step,
        normal_force=parts.normal_force[0],
        normal=parts.normal,
        direction=feed / speed,
        p_WE=tick.p_WE,
    )
    vary(variations, sample, parts.chatter, parts.force)


@kernel
def add_unbalance_force(process: Record, t: float, R_WE: Array, force: Array) -> None:
    """Adds to `force` (3,) N, axes of W, that of a spindle along E's z which turns evenly."""
    size = process[0].unbalance * process[0].omega ** 2
    c, s = size * math.cos(process[0].omega * t), size * math.sin(process[0].omega * t)
    for i in range(3):
        force[i] += c * R_WE[i, 0] + s * R_WE[i, 1]


@kernel
def joint_vibration(
    process: Record, M: Array, J: Array, normal_force: float, normal: Array, out: Array
) -> None:
    """Writes the amplitudes (n,) rad/s of the joints' velocity by a tool that vibrates; 0: none.

    Args:
        process: MachiningProcess.constants.
        M: (n, n) kg m^2.
        J: (6, n) at E, axes of W, rotation first.
        normal_force: N; without it nothing vibrates.
        normal: (3,) unit normal of the surface, W.
    """
    out[:] = 0.0
    if process[0].vibration > 0.0 and normal_force > 0.0:
        vibration_shares(M, J, normal, out)
        out *= process[0].vibration
