"""What makes the force of machining vary: surface, material, spindle, the path's ends, chatter.

All of it acts through the depth to which tool and workpiece press each other, and through what a
newton of normal force takes along the feed.

Contact. The simulator's contact knows the nominal surface. Tool and workpiece give way together by
delta under F = c delta^p: p = 1 at a point of a plate of stiffness c; p = 2 and c = pi E where a
ball of hydroelastic modulus E meets a rigid surface (its pressure E d / R at depth d, integrated
over the spherical cap; the simulator's ball is a coarse mesh, and softer: 12 kN/m instead of 71 at
40 N and 10 MPa). A surface that stands higher by h presses with

    F' = c max(0, delta + h)^p,   delta = (F / c)^(1/p)

and F' - F, at most F either way, is put on the tool along the normal. A slope of the real surface
turns the contact's force as well, by -F' grad h, so that waviness alone, like a spring's potential,
takes no work round a closed path.

Waviness and patches. A field over the workpiece's x and y is a sum of plane waves of random
direction and phase, their lengths spread evenly over the logarithm of a band (spectral
representation: M. Shinozuka and G. Deodatis, Appl. Mech. Rev. 44 (4), 1991). Waviness is h itself.
Patches of harder and softer material change the resistance to a unit of normal force, the friction
and the cutting, by a factor exp(s g - s^2 / 2) of mean 1, with g of unit variance: the specific
energy of a workpiece is not one number (S. Malkin and C. Guo, Grinding Technology, 2nd ed., ch. 5).

Run-out. The spindle's axial error motion moves the tool by a cos(omega t) along its axis, once a
turn (ISO 230-7); h gets as much.

Entry and exit. Stock to be removed begins and ends a margin inside the ends of the path, across it.
The tool's round contact zone runs into it, and only the share of the zone over stock cuts: a
circle's segment beyond a straight edge (immersion, as in milling: Y. Altintas, Manufacturing
Automation, 2nd ed., ch. 2).

Chatter. What a turn of the tool has left behind is met by the next. With y the tool's vibration out
of the surface, T a turn and m the overlap of two turns,

    h_c = r (m y(t - T) - y(t)),   r = cutting stiffness / contact stiffness

(Y. Altintas, ch. 4; J. Tlusty and M. Polacek, Proc. ASME Int. Research in Production Engineering,
1963; overlap in grinding: I. Inasaki, B. Karpuschewski, H.-S. Lee, CIRP Annals 50 (2), 2001). A
mode of damping ratio z whose spring is the contact chatters, for some speed of the spindle, where
r > 2 z (1 + z) (`chatter_limit`). The tool leaves the surface before a vibration grows without end:
F' is not negative (J. Tlusty and F. Ismail, CIRP Annals 30 (1), 1981).
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Record, record, record_type
from wrenchsight.models.numerics.kernel import kernel

NUM_WAVES = 24  # of a field

WAVE_TYPE = record_type(wave_x=(), wave_y=(), phase=(), amplitude=())
"""A plane wave amplitude cos(wave_x x + wave_y y + phase): 1/m, 1/m, rad, unit of its field."""
# Entries of the memory of `regenerated`: the trace goes on to its end.
_SLOWLY, _FILLED, _NEXT, _TRACE = range(4)


@dataclass
class WavinessConfig:
    """How far the real surface strays from the nominal one."""

    height: float = 1e-5
    """m, root mean square"""
    shortest: float = 0.008
    """m, wavelength"""
    longest: float = 0.06
    """m, wavelength"""


@dataclass
class PatchesConfig:
    """How much the resistance to a unit of normal force changes from place to place."""

    spread: float = 0.25
    """standard deviation of its logarithm"""
    shortest: float = 0.02
    """m, wavelength"""
    longest: float = 0.12
    """m, wavelength"""


@dataclass
class RunOutConfig:
    """Axial error motion of the spindle, once a turn."""

    amplitude: float = 2e-6
    """m"""


@dataclass
class EngagementConfig:
    """Where along the path there is stock to be removed."""

    zone: float = 0.004
    """m, radius of the tool's contact zone"""
    margin: float = 0.01
    """m, from an end of the path to the stock"""


@dataclass
class ChatterConfig:
    """Regeneration of the surface from turn to turn of the spindle; off by default."""

    ratio: float = 0.0
    """cutting stiffness over contact stiffness; 0: none"""
    overlap: float = 1.0
    """share of a turn's trace that the next one meets, 0 to 1"""
    corner: float = 5.0
    """Hz; slower motion is the feed's and the force control's, no vibration"""


@dataclass
class VariationsConfig:
    """What makes the force of machining vary; each part is off at zero."""

    enabled: bool = True
    """false: the steady process of the article"""
    seed: int = 1
    """of surface and material"""
    waviness: WavinessConfig = field(default_factory=WavinessConfig)
    patches: PatchesConfig = field(default_factory=PatchesConfig)
    run_out: RunOutConfig = field(default_factory=RunOutConfig)
    engagement: EngagementConfig = field(default_factory=EngagementConfig)
    chatter: ChatterConfig = field(default_factory=ChatterConfig)


@dataclass(frozen=True, eq=False)
class WorkpieceContact:
    """Contact and pose of the workpiece, as the law needs them.

    Attributes:
        stiffness: c of F = c delta^exponent, N/m^exponent.
        exponent: p, 1 or 2.
        friction: Coulomb's, of the simulator's contact.
        R_WP, p_WP: (3, 3) and (3,) m, pose of the workpiece's frame P.
        ends: (2, 3) m, where the path begins and ends, in W.
    """

    stiffness: float
    exponent: float
    friction: float
    R_WP: Array
    p_WP: Array
    ends: Array


VARIATION_TYPE = record_type(
    stiffness=(),
    exponent=(),
    friction=(),
    R_WP=(3, 3),
    p_WP=(3,),
    ends=(2, 3),
    spread=(),
    run_out=(),
    omega=(),
    zone=(),
    margin=(),
    chatter_ratio=(),
    overlap=(),
    slow_gain=(),
    turn_ticks=(),
)
"""The constants of ProcessVariations but its waves.

    stiffness, exponent, friction, R_WP, p_WP, ends  of WorkpieceContact
    spread         sd of the logarithm of the material's factor
    run_out        m
    omega          rad/s, of the spindle
    zone           m, radius of the tool's contact zone
    margin         m, from the path's ends to the stock
    chatter_ratio  of ChatterConfig
    overlap        of ChatterConfig
    slow_gain      per tick, of the low-pass that takes the tool's slow motion
    turn_ticks     ticks of a turn of the spindle
"""


class VariationTables(NamedTuple):
    """The constants of a ProcessVariations, as the kernels read them.

    Attributes:
        constants: (1,) of VARIATION_TYPE.
        waviness, patches: (NUM_WAVES,) of WAVE_TYPE: height of the surface, m; logarithm of the
            material's factor over its sd.
    """

    constants: Record
    waviness: Record
    patches: Record


NO_VARIATIONS = VariationTables(
    constants=np.zeros(0, VARIATION_TYPE),
    waviness=np.zeros(0, WAVE_TYPE),
    patches=np.zeros(0, WAVE_TYPE),
)
"""Of a steady process."""


class CuttingSample(NamedTuple):
    """The tool on the surface at one time.

    Attributes:
        t: s, when the force acts.
        normal_force: N, of the simulator's contact.
        normal: (3,) unit normal out of the surface.
        direction: (3,) of the feed, shorter than 1 where it hardly moves.
        p_WE: (3,) m, place of the tool.
    """

    t: float
    normal_force: float
    normal: Array
    direction: Array
    p_WE: Array


class ProcessVariations:
    """The law of this module for one workpiece.

    Attributes:
        tables: constants, for `vary`.
        memory_size: numbers that chatter remembers.

    Args:
        config: how much of each.
        contact: contact of the workpiece.
        spindle_frequency: Hz.
        time_step: s.
        source: named in messages.

    Raises:
        InputError: a parameter out of range.
    """

    def __init__(
        self,
        config: VariationsConfig,
        contact: WorkpieceContact,
        spindle_frequency: float,
        time_step: float,
        source: str = "variations",
    ) -> None:
        """Packs the constants, and draws the waves of surface and material.

        Args:
            config: of the variations.
            contact: stiffness, friction, pose and ends of the workpiece.
            spindle_frequency: Hz.
            time_step: s.
            source: place of the configuration, for error lines.

        Raises:
            InputError: as `check_variations`.
        """
        check_variations(config, spindle_frequency, time_step, source)
        chatter = config.chatter
        ticks_per_turn = 0.0  # not read without chatter; the spindle may then stand
        if chatter.ratio > 0.0:
            ticks_per_turn = 1.0 / (spindle_frequency * time_step)
        constants = record(
            stiffness=contact.stiffness,
            exponent=contact.exponent,
            friction=contact.friction,
            R_WP=contact.R_WP,
            p_WP=contact.p_WP,
            ends=contact.ends,
            spread=config.patches.spread,
            run_out=config.run_out.amplitude,
            omega=2.0 * math.pi * spindle_frequency,
            zone=config.engagement.zone,
            margin=config.engagement.margin,
            chatter_ratio=chatter.ratio,
            overlap=chatter.overlap,
            slow_gain=-math.expm1(-2.0 * math.pi * chatter.corner * time_step),
            turn_ticks=ticks_per_turn,
        )
        # Surface and material have random numbers of their own: one keeps its when the other's
        # settings change.
        surface, material = np.random.SeedSequence(config.seed).spawn(2)
        waviness, patches = config.waviness, config.patches
        self.tables = VariationTables(
            constants=constants,
            waviness=plane_waves(surface, waviness.height, waviness.shortest, waviness.longest),
            # Of unit variance: `vary` multiplies them by the spread.
            patches=plane_waves(material, 1.0, patches.shortest, patches.longest),
        )
        self.memory_size = 0
        if chatter.ratio > 0.0:
            # From this tick back to the last one before a turn, see `regenerated`.
            self.memory_size = _TRACE + math.floor(ticks_per_turn) + 1


def check_variations(
    config: VariationsConfig, spindle_frequency: float, time_step: float, source: str
) -> None:
    """Raises InputError, naming `source`, for a number out of range.

    Run-out and chatter turn with the spindle, so that the tick must be short enough to see it; with
    `enabled` off they count for nothing. The bounds are wider than anything that is machined; they
    catch a wrong unit.

    Args:
        config: of the variations; lengths in m, `chatter.corner` in Hz.
        spindle_frequency: Hz.
        time_step: s.
        source: place of the configuration, for error lines.
    """
    chatter, run_out = config.chatter, config.run_out
    for name, value, low, high in (
        ("waviness.height", config.waviness.height, 0.0, 1e-3),
        ("waviness.shortest", config.waviness.shortest, 1e-3, 10.0),
        ("waviness.longest", config.waviness.longest, config.waviness.shortest, 10.0),
        ("patches.spread", config.patches.spread, 0.0, 2.0),
        ("patches.shortest", config.patches.shortest, 1e-3, 10.0),
        ("patches.longest", config.patches.longest, config.patches.shortest, 10.0),
        ("run_out.amplitude", run_out.amplitude, 0.0, 1e-3),
        ("engagement.zone", config.engagement.zone, 1e-4, 1.0),
        ("engagement.margin", config.engagement.margin, 0.0, 1.0),
        ("chatter.ratio", chatter.ratio, 0.0, 10.0),
        ("chatter.overlap", chatter.overlap, 0.0, 1.0),
        ("chatter.corner", chatter.corner, 0.01, 100.0),
    ):
        if not low <= value <= high:
            raise InputError(source, name, f"{value:g}, expected {low:g} to {high:g}")
    if not 0 <= config.seed < 2**31:
        raise InputError(source, "seed", f"{config.seed}, expected 0 or more")
    follows_spindle = max(run_out.amplitude, chatter.ratio) > 0.0 and config.enabled
    if follows_spindle and spindle_frequency >= 0.5 / time_step:
        raise InputError(
            source,
            "spindle_frequency",
            f"{spindle_frequency:g} Hz is half the rate of a {time_step:g} s time_step or more: "
            "the run-out would be seen at another frequency",
            "take a shorter time_step, or neither run_out nor chatter",
        )
    if chatter.ratio > 0.0 and config.enabled and not spindle_frequency >= 1.0:
        raise InputError(
            source, "spindle_frequency", f"{spindle_frequency:g} Hz, and chatter needs 1 Hz or more"
        )


def plane_waves(
    seed: np.random.SeedSequence, rms: float, shortest: float, longest: float
) -> Record:
    """(NUM_WAVES,) of WAVE_TYPE, whose sum has the root mean square `rms` over the plane.

    Args:
        seed: seed of directions and phases, and of the lengths within their shares of the band.
        rms: root mean square of the field, in its own unit.
        shortest, longest: m, wavelengths.
    """
    rng = np.random.default_rng(seed)
    place = (np.arange(NUM_WAVES) + rng.uniform(size=NUM_WAVES)) / NUM_WAVES
    number = 2.0 * np.pi / (shortest * (longest / shortest) ** place)
    turn, phase = rng.uniform(0.0, 2.0 * np.pi, (2, NUM_WAVES))
    waves = np.zeros(NUM_WAVES, WAVE_TYPE)
    waves["wave_x"], waves["wave_y"] = number * np.cos(turn), number * np.sin(turn)
    waves["phase"], waves["amplitude"] = phase, rms * math.sqrt(2.0 / NUM_WAVES)
    return waves


def chatter_limit(damping_ratio: float) -> float:
    """The ratio of ChatterConfig up to which one mode is stable at any speed of the spindle.

    With full overlap: b_lim = -1 / (2 K min Re G), and -min Re G = 1 / (4 k z (1 + z)) of a mode of
    stiffness k (Altintas, ch. 4).
    """
    return 2.0 * damping_ratio * (1.0 + damping_ratio)


@kernel
def field_at(waves: Record, x: float, y: float) -> tuple[float, float, float]:
    """A sum of plane waves at x, y (m), and its derivatives in both."""
    value, along_x, along_y = 0.0, 0.0, 0.0
    for k in range(waves.shape[0]):
        wave = waves[k]
        angle = wave.wave_x * x + wave.wave_y * y + wave.phase
        slope = -wave.amplitude * math.sin(angle)
        value += wave.amplitude * math.cos(angle)
        along_x += slope * wave.wave_x
        along_y += slope * wave.wave_y
    return value, along_x, along_y


@kernel
def pressed(stiffness: float, exponent: float, force: float, height: float) -> float:
    """The force (N) of a contact whose surface stands higher by `height` (m): 0 to twice `force`.

    Args:
        stiffness, exponent: c and p of force = c depth^p.
        force: N, on the nominal surface.
    """
    if force <= 0.0:
        return 0.0
    depth = (force / stiffness) ** (1.0 / exponent) + height
    if depth <= 0.0:
        return 0.0
    return float(min(stiffness * depth**exponent, 2.0 * force))


@kernel
def share_over_edge(distance: float, radius: float) -> float:
    """Share of a disc's area beyond a straight edge, its centre `distance` beyond it (m)."""
    x = distance / radius
    if x >= 1.0:
        return 1.0
    if x <= -1.0:
        return 0.0
    return float(1.0 - (math.acos(x) - x * math.sqrt(1.0 - x * x)) / math.pi)


@kernel
def engagement(constants: Record, p: Array) -> float:
    """Share of the contact zone, its centre at p (3,) m, over stock: 0 to 1.

    Args:
        constants: (1,) of VARIATION_TYPE.
    """
    ends = constants[0].ends
    length = 0.0
    for i in range(3):
        length += (ends[1, i] - ends[0, i]) ** 2
    length = math.sqrt(length)
    if length < 1e-9:
        return 1.0
    along = 0.0
    for i in range(3):
        along += (p[i] - ends[0, i]) * (ends[1, i] - ends[0, i]) / length
    room = min(along, length - along) - constants[0].margin
    return float(share_over_edge(room, constants[0].zone))


@kernel
def regenerated(constants: Record, place: float, memory: Array) -> float:
    """Returns the height (m) that the last turn has left; stores the tool's place in the memory.

    Chatter: the tool's vibration one turn of the spindle ago has left waves, which it now meets.
    The slow part of its motion leaves none.

        height = ratio (overlap vibration(t - turn) - vibration(t)),  vibration = place - low-pass

    vibration(t - turn) is 0 until it has been stored.

    Args:
        constants: (1,) of VARIATION_TYPE.
        place: m, of the tool out of the surface, from any fixed origin.
        memory: (memory_size,), changed; zeros at the first contact, and again after it was lost.
            _SLOWLY: low-passed place, m; _FILLED: number of stored vibrations; _NEXT: where the
            next one goes; from _TRACE on the vibrations, m, in a ring.
    """
    if memory[_FILLED] == 0.0:
        memory[_SLOWLY] = place
    memory[_SLOWLY] += constants[0].slow_gain * (place - memory[_SLOWLY])
    vibration = place - memory[_SLOWLY]
    ring_size = len(memory) - _TRACE
    now = int(memory[_NEXT])
    memory[_TRACE + now] = vibration
    memory[_NEXT] = (now + 1) % ring_size
    memory[_FILLED] = min(memory[_FILLED] + 1.0, float(ring_size))
    # The force acts at the next tick. A turn before that lies between two stored ticks, once there
    # are so many. The vibration at the next tick is not known: the present one stands for it.
    ticks_back = constants[0].turn_ticks - 1.0  # ticks before this one
    whole_ticks = math.floor(ticks_back)
    last_turn = 0.0
    if ticks_back >= 0.0 and memory[_FILLED] > whole_ticks + 1:
        share = ticks_back - whole_ticks
        later = memory[_TRACE + (now - whole_ticks) % ring_size]
        last_turn = later + share * (memory[_TRACE + (now - whole_ticks - 1) % ring_size] - later)
    return float(constants[0].chatter_ratio * (constants[0].overlap * last_turn - vibration))


@kernel
def vary(tables: VariationTables, sample: CuttingSample, memory: Array, force: Array) -> None:
    """Turns the cutting force of a steady process into that of this place and time, in place.

    With F of the simulator's contact, F' of a surface that stands higher by h, the material's
    factor f and the share e of the tool's zone that is over stock,

        force = f e (F' / F) F_c - friction (f F' - F) direction + (F' - F) n - F' grad h

    F_c is the steady force. The simulator's contact acts with F and its friction already: the
    second and the third term are what it lacks. Without contact force and memory become 0.

    Args:
        tables: of ProcessVariations.
        sample: the tool, and the simulator's contact.
        memory: (memory_size,), changed by `regenerated`; of chatter, empty without it.
        force: (3,) N, steady cutting force in W; becomes all that acts besides the simulator's
            contact.
    """
    constants, R_WP, p_WP = tables.constants, tables.constants[0].R_WP, tables.constants[0].p_WP
    normal_force, n, p = sample.normal_force, sample.normal, sample.p_WE
    if normal_force <= 0.0:
        memory[:] = 0.0
        force[:] = 0.0
        return
    x, y = 0.0, 0.0  # of the tool, in P
    for i in range(3):
        x += (p[i] - p_WP[i]) * R_WP[i, 0]
        y += (p[i] - p_WP[i]) * R_WP[i, 1]
    height, slope_x, slope_y = field_at(tables.waviness, x, y)
    height += constants[0].run_out * math.cos(constants[0].omega * sample.t)
    if len(memory) > 0:
        place = p[0] * n[0] + p[1] * n[1] + p[2] * n[2]
        height += regenerated(constants, place, memory)  # stores what this turn leaves
    push = pressed(constants[0].stiffness, constants[0].exponent, normal_force, height)
    spread = constants[0].spread
    factor = math.exp(spread * field_at(tables.patches, x, y)[0] - 0.5 * spread * spread)
    cutting = factor * engagement(constants, p) * push / normal_force
    rubbing = constants[0].friction * (factor * push - normal_force)
    along = 0.0  # the slope's part along the normal; it is taken off, as grad h is tangential
    for i in range(3):
        along += n[i] * (slope_x * R_WP[i, 0] + slope_y * R_WP[i, 1])
    for i in range(3):
        slope = slope_x * R_WP[i, 0] + slope_y * R_WP[i, 1] - along * n[i]
        force[i] = (
            cutting * force[i]
            - rubbing * sample.direction[i]
            + (push - normal_force) * n[i]
            - push * slope
        )
