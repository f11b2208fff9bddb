"""Condition number over the workspace: statistics of random configurations, and a slice.

The article draws half a million configurations at random (section 4.2), and so does this. The slice
has, at each point of a plane, the best condition number over all directions of the tool within a
cone and over all branches within the joint limits.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.jcn_map.jcn_map_settings import (
    JcnMapSettings,
    SliceConfig,
)
from wrenchsight.analyses.output.axes import log_scale
from wrenchsight.analyses.output.figures import (
    COLOUR,
    SERIES,
    legend_on_top,
    new_figure,
    save_figure,
)
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.diagrams.pages.cloud_page import write_cloud_page
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.ties import first_of_least
from wrenchsight.models.planning.motion.branches import is_closed_form
from wrenchsight.models.planning.motion.posture_cost import ConditionNumber, check_joints
from wrenchsight.models.planning.motion.posture_map import PostureMap, ToolCone, best_postures
from wrenchsight.models.planning.motion.surface_path import frame_about
from wrenchsight.models.robot.robot import Robot

GOOD_CONDITION_NUMBER = 11.0  # the article's figure of a good configuration
MOST_SAMPLES = 10_000_000  # of q alone 0.6 GB
_NUM_CHECKED = 1000  # configurations that are checked for collisions: their share to 1.5 %
_CHUNK_SAMPLES = 250_000  # samples between two reports of progress
_COLOUR_RANGE = (9.0, 100.0)  # of the colours
_CLOUD_POINTS, _SCATTER_POINTS = 40_000, 20_000  # points that a picture shows
_CELLS_ACROSS, _MIN_CELL_SAMPLES = 70, 5  # of the picture of medians: fewer samples show no median
_HIT_GREY = "#b8b8b8"  # in the legend: about that of 1.0 in the map, which goes to 2.5
_PLANES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Samples:
    """Random configurations: q (N, n) rad, jcn (N,), p_WE (N, 3) m."""

    q: Array
    jcn: Array
    p_WE: Array

    def metrics(self) -> dict[str, Any]:
        """Mean, median, smallest, share above GOOD_CONDITION_NUMBER; infinite ones count as
        `singular`.
        """
        finite = self.jcn[np.isfinite(self.jcn)]
        return {
            "mean": float(np.mean(finite)),
            "median": float(np.median(self.jcn)),
            "min": float(np.min(self.jcn)),
            "above_11_pct": 100.0 * float(np.mean(self.jcn > GOOD_CONDITION_NUMBER)),
            "samples": len(self.jcn),
            "singular": int(len(self.jcn) - len(finite)),
        }


@dataclass(frozen=True)
class Slice:
    """The best condition number over a plane: u, v (G,) m along its axes, and G^2 postures."""

    config: SliceConfig
    axes: tuple[str, str]
    u: Array
    v: Array
    postures: PostureMap

    @property
    def jcn(self) -> Array:
        """(G, G) rows along v, NaN out of reach."""
        return self.postures.best.reshape(len(self.v), len(self.u))

    def best_point(self) -> int:
        """Index of the best point that is reached; of equal ones the first."""
        best = self.postures.best
        return int(first_of_least(np.where(np.isfinite(best), best, np.inf)))

    def metrics(self) -> dict[str, Any]:
        """The best place, and the share of the plane that is good."""
        best = self.postures.best
        reached = np.isfinite(best)
        metrics: dict[str, Any] = {
            "points": best.size,
            "reached_pct": 100.0 * float(np.mean(reached)),
            "in_collision_pct": 100.0 * float(np.mean(self.postures.hits)),
        }
        if np.any(reached):
            i = self.best_point()
            metrics |= {
                "min": float(best[i]),
                "median": float(np.median(best[reached])),
                "best_place_m": self.postures.p_WE[i].tolist(),
                "best_direction": self.postures.direction_W[i].tolist(),
                "below_11_m2": float(np.count_nonzero(best[reached] < GOOD_CONDITION_NUMBER))
                * float((self.u[1] - self.u[0]) * (self.v[1] - self.v[0])),
            }
        return metrics


def sample(
    robot: Robot,
    num_samples: int,
    seed: int,
    *,
    within_limits: bool = False,
    progress: ProgressCallback = lambda fraction, message: None,
) -> Samples:
    """Draws configurations evenly over full turns of all joints, or over the joint limits.

    Args:
        seed: of the random numbers.
        within_limits: whether over the limits; a joint without one turns fully there, too. A
            prismatic joint always keeps to its limits.
        progress: called with the share done and a message.

    Raises:
        InputError: the arm has fewer than six joints, or num_samples is out of range.
    """
    if not 1 <= num_samples <= MOST_SAMPLES:
        raise InputError("--samples", "", f"{num_samples}, expected 1 to {MOST_SAMPLES}")
    chain = robot.chain
    check_joints(chain, robot.name)
    is_limited = chain.prismatic | within_limits
    has_lower = is_limited & np.isfinite(robot.position_lower)
    has_upper = is_limited & np.isfinite(robot.position_upper)
    lower = np.where(has_lower, robot.position_lower, -math.pi)
    upper = np.where(has_upper, robot.position_upper, math.pi)
    rng = np.random.default_rng(seed)
    q = rng.uniform(lower, upper, (num_samples, robot.num_joints))
    jcn, p_WE = np.empty(num_samples), np.empty((num_samples, 3))
    for start in range(0, num_samples, _CHUNK_SAMPLES):
        rows = slice(start, start + _CHUNK_SAMPLES)
        jcn[rows] = chain.condition_number(q[rows])
        p_WE[rows] = chain.pose(q[rows])[1]
        progress(min(1.0, (start + _CHUNK_SAMPLES) / num_samples), "condition numbers")
    return Samples(q, jcn, p_WE)


def slice_plane(
    robot: Robot,
    config: SliceConfig,
    reach: Array,
    progress: ProgressCallback = lambda fraction, message: None,
    is_free: Callable[[Array], bool] | None = None,
) -> Slice:
    """The best condition number at each point of a plane.

    Args:
        reach: (3,) largest |x|, |y| and |z| of E, m; sets the square where the configuration does
            not.
        is_free: whether the arm hits nothing at q (n,); without it all postures count.

    Raises:
        InputError: a plane, cone or grid that makes no sense.
    """
    _check_slice(config)
    i, j = (axis for axis in range(3) if axis != _PLANES[config.axis])  # the plane's axes in W
    extent = config.extent
    if extent is None:
        extent = math.ceil(10.0 * max(reach[i], reach[j])) / 10.0  # m, up to whole decimetres
    u = np.linspace(-extent, extent, config.num_points)  # along both axes: a square
    # (G, G, 3): v changes from row to row, u along a row, as in `Slice.jcn`.
    points = np.empty((config.num_points, config.num_points, 3))
    points[..., _PLANES[config.axis]] = config.value
    points[..., i], points[..., j] = np.meshgrid(u, u)
    postures = best_postures(
        robot,
        ConditionNumber(robot.chain),
        points.reshape(-1, 3),
        ToolCone(config.cone_axis, math.radians(config.cone_deg)),
        progress=lambda fraction: progress(fraction, "slice"),
        is_free=is_free,
    )
    axes = ("xyz"[i], "xyz"[j])
    return Slice(config=config, axes=axes, u=u, v=u, postures=postures)  # v: a square


def _check_slice(config: SliceConfig) -> None:
    if config.axis not in _PLANES:
        raise InputError("--slice", "", f'"{config.axis}", expected x, y or z', "write z=0.3")
    if not (math.isfinite(config.value) and 2 <= config.num_points <= 401):
        raise InputError("--slice", "", "expected a place in m, and a grid of 2 to 401 points")
    if not 0.0 <= config.cone_deg <= 180.0:
        raise InputError("--cone-deg", "", f"{config.cone_deg:g}, expected 0 to 180")
    if len(config.cone_axis) != 3:
        raise InputError("--cone-axis", "", f"{len(config.cone_axis)} numbers, expected three")
    if not all(abs(value) <= 1e6 for value in (config.value, *config.cone_axis)):
        raise InputError("--slice", "", "a place or a direction is beyond any robot's")
    if config.extent is not None and not 0.0 < config.extent <= 1e3:
        raise InputError("--config", "slice.extent", f"{config.extent:g} m, expected 0 to 1000 m")
    frame_about(np.array(config.cone_axis), "cone_axis")


@dataclass(frozen=True)
class JcnMapResult:
    """The result of the command; notices are sentences for the user."""

    samples: Samples
    plane: Slice | None
    metrics: dict[str, Any]
    notices: tuple[str, ...]


def jcn_map(
    settings: JcnMapSettings,
    out: Path,
    progress: ProgressCallback = lambda fraction, message: None,
) -> JcnMapResult:
    """The command `jcn-map`: writes samples.npz (q, jcn, p_WE), metrics.json, config.yaml, figures
    and recording.html into `out`; with a plane also slice.npz (p_WE, jcn, direction_W, q).

    Raises:
        InputError: see `sample` and `slice_plane`; or `out` cannot be written to.
    """
    with result_folder(out, "jcn-map") as folder:
        return _map_into(folder, settings, progress)


def _map_into(
    folder: OutputFolder, settings: JcnMapSettings, progress: ProgressCallback
) -> JcnMapResult:
    """Draws the samples, maps the slice and writes all files.

    The metrics are those of the samples, with `free` where the arm has shapes to collide with, and
    `slice` where the settings ask for one; each sub-result says what its own hold.
    """
    robot, config = Robot.load(settings.robot), settings.slice
    seed, within_limits = settings.seed, settings.within_limits
    if config is not None:
        _check_slice(config)  # before the samples, which take time
    samples = sample(
        robot,
        settings.num_samples,
        seed,
        within_limits=within_limits,
        progress=lambda fraction, message: progress(0.2 * fraction, message),
    )
    metrics: dict[str, Any] = {**samples.metrics(), "seed": seed, "within_limits": within_limits}
    clearance, notices = _clearance(robot)
    if clearance is not None:
        metrics["free"] = free_figures(samples, clearance)
    _write_samples(folder, robot, samples)
    plane = None
    if config is not None:
        if not is_closed_form(robot):
            notices.append(
                f"{robot.name} has no known analytic inverse kinematics: postures of the slice are "
                "searched numerically, and better ones may be missed"
            )
        plane = slice_plane(
            robot,
            config,
            # How far the samples went: the square holds what the arm reaches, nearly.
            reach=np.max(np.abs(samples.p_WE), axis=0),
            progress=lambda fraction, message: progress(0.2 + 0.8 * fraction, message),
            is_free=None if clearance is None else clearance.is_free,
        )
        metrics["slice"] = plane.metrics()
        if plane.postures.hits.any():
            notices.append(
                f"{np.count_nonzero(plane.postures.hits)} of {plane.postures.best.size} points of "
                "the slice have no collision-free posture; grey in the map"
            )
        _write_slice(folder, plane)
    folder.write_json("metrics.json", {**metrics, "notices": notices})
    folder.write_settings("config.yaml", settings)
    return JcnMapResult(samples, plane, metrics, tuple(notices))


def _write_samples(folder: OutputFolder, robot: Robot, samples: Samples) -> None:
    with folder.atomic("samples.npz") as partial, partial.open("wb") as file:
        np.savez(file, q=samples.q, jcn=samples.jcn, p_WE=samples.p_WE)
    draw_cloud(samples, folder / "figures" / "workspace.png")
    draw_distribution(samples, folder / "figures" / "distribution.png")
    record(robot, samples, folder / "recording.html")


def _write_slice(folder: OutputFolder, plane: Slice) -> None:
    postures = plane.postures
    with folder.atomic("slice.npz") as partial, partial.open("wb") as file:
        np.savez(
            file,
            p_WE=postures.p_WE,
            jcn=postures.best,
            direction_W=postures.direction_W,
            q=postures.q,
            in_collision=postures.hits,
        )
    draw_slice(plane, folder / "figures" / "slice.png")


def _clearance(robot: Robot) -> tuple[Clearance | None, list[str]]:
    """Distances of the arm, None where they cannot be checked; and sentences on what is not."""
    if robot.unusable_collisions:
        links = ", ".join(robot.unusable_collisions)
        return None, [f"no usable collision shape for {links}: collisions are not checked"]
    clearance = Clearance(robot, 0.0, robot.floor)
    if not clearance.has_shapes:
        return None, [f"{robot.name} has no collision shapes: collisions are not checked"]
    overlapping = [
        f"{pair} overlap at home: contact between them is not checked"
        for pair in clearance.overlapping
    ]
    return clearance, [*overlapping, *clearance.coarse_notes()]


def free_figures(samples: Samples, clearance: Clearance) -> dict[str, Any]:
    """Share of the first 1000 configurations that hit arm or floor; the best that hits nothing."""
    hits = np.array([not clearance.is_free(q) for q in samples.q[:_NUM_CHECKED]])
    order = np.argsort(samples.jcn, kind="stable")[:_NUM_CHECKED]
    best = (k for k in order if clearance.is_free(samples.q[k]))
    k = next(best, None)
    return {
        "looked_at": len(hits),
        "in_collision_pct": 100.0 * float(hits.mean()),
        "min": None if k is None else float(samples.jcn[k]),
    }


def record(robot: Robot, samples: Samples, path: Path) -> None:
    """Writes the point cloud with the arm in it: the half behind the arm, so that both are seen."""
    behind = np.flatnonzero(samples.p_WE[:, 1] > 0.0)[:_CLOUD_POINTS]
    low, high = _COLOUR_RANGE
    write_cloud_page(
        robot,
        samples.p_WE[behind],
        np.minimum(samples.jcn[behind], high),
        path,
        f"Condition number over the workspace of {robot.name} (half of it)",
        low=low,
        high=high,
    )


def draw_cloud(samples: Samples, path: Path) -> None:
    """Draws where the samples are and what they attain, in space and by distance and height."""
    from matplotlib.colors import LogNorm

    # For its style: its two panels give way to ours, of which one is in space.
    figure, _ = new_figure(1, 2, height=4.0)
    figure.clear()
    norm = LogNorm(*_COLOUR_RANGE)
    ax = figure.add_subplot(1, 2, 1, projection="3d")
    shown = slice(0, _SCATTER_POINTS)
    p = samples.p_WE[shown]
    # Good ones last, so that they are not covered by the many that are not.
    order = np.argsort(-samples.jcn[shown], kind="stable")
    ax.scatter(*p[order].T, c=samples.jcn[shown][order], norm=norm, cmap="viridis", s=1.0, lw=0)
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")
    ax.set_zlabel("z [m]")
    ax.set_aspect("equal")
    ax.tick_params(labelsize=7)
    ax.set_title("configurations")
    ax = figure.add_subplot(1, 2, 2)
    radius = np.hypot(samples.p_WE[:, 0], samples.p_WE[:, 1])
    cells = ax.hexbin(
        radius,
        samples.p_WE[:, 2],
        C=samples.jcn,
        reduce_C_function=np.median,
        gridsize=_CELLS_ACROSS,
        norm=norm,
        cmap="viridis",
        mincnt=_MIN_CELL_SAMPLES,
        linewidths=0.1,
    )
    ax.set_aspect("equal")
    ax.set_xlabel("distance from the base's axis [m]")
    ax.set_ylabel("z [m]")
    ax.set_title("median of each cell")
    bar = figure.colorbar(cells, ax=ax, label="condition number of J", extend="max")
    bar.set_ticks([10, 20, 50, 100], labels=["10", "20", "50", "100"])
    save_figure(figure, path)


def draw_distribution(samples: Samples, path: Path) -> None:
    """Draws how often each condition number occurs."""
    figure, axes = new_figure(1, 1, height=3.2)
    ax = axes[0, 0]
    finite = samples.jcn[np.isfinite(samples.jcn)]
    edges = np.geomspace(5.0, 1e4, 100)
    ax.hist(np.clip(finite, 5.0, 9.999e3), edges, color=COLOUR["estimate"])
    for value, name, style in (
        (GOOD_CONDITION_NUMBER, f"{GOOD_CONDITION_NUMBER:g}, good in the article", ":"),
        (float(np.median(samples.jcn)), f"median {np.median(samples.jcn):.1f}", "-"),
        (float(np.mean(finite)), f"mean {np.mean(finite):.0f}", "--"),
    ):
        ax.axvline(value, color=COLOUR["truth"], linestyle=style, linewidth=1.0, label=name)
    log_scale(ax, "x")
    ax.set_xlabel("condition number of J (last bar: above 10 000)")
    ax.set_ylabel("configurations")
    legend_on_top(figure, ax, ncols=3)
    save_figure(figure, path)


def draw_slice(plane: Slice, path: Path) -> None:
    """Draws the best condition number over a plane.

    Grey: all postures there hit something; nothing is drawn out of reach. A white line is drawn at
    GOOD_CONDITION_NUMBER where the plane has both sides of it, a dot at the best point.
    """
    from matplotlib.colors import LogNorm

    figure, axes = new_figure(1, 1, height=5.2, width=6.4)
    ax = axes[0, 0]
    cells = ax.pcolormesh(
        plane.u, plane.v, plane.jcn, norm=LogNorm(*_COLOUR_RANGE), cmap="viridis", shading="nearest"
    )
    if plane.postures.hits.any():
        hit = np.where(plane.postures.hits.reshape(plane.jcn.shape), 1.0, np.nan)  # NaN: not drawn
        ax.pcolormesh(plane.u, plane.v, hit, cmap="Greys", vmin=0.0, vmax=2.5, shading="nearest")
        ax.plot([], [], "s", color=_HIT_GREY, label="no collision-free posture")
    least = np.nanmin(plane.jcn, initial=np.inf)  # of the points within reach, if any
    largest = np.nanmax(plane.jcn, initial=-np.inf)
    if least < GOOD_CONDITION_NUMBER < largest:
        ax.contour(
            plane.u,
            plane.v,
            plane.jcn,
            levels=[GOOD_CONDITION_NUMBER],
            colors="white",
            linewidths=1.2,
        )
    if np.any(np.isfinite(plane.postures.best)):
        p = plane.postures.p_WE[plane.best_point()]
        i, j = ("xyz".index(name) for name in plane.axes)
        ax.plot(p[i], p[j], "o", color=SERIES[1], label=f"best: {least:.2f}")
    if ax.get_legend_handles_labels()[0]:
        legend_on_top(figure, ax, ncols=1)
    ax.set_aspect("equal")
    ax.set_xlabel(f"{plane.axes[0]} [m]")
    ax.set_ylabel(f"{plane.axes[1]} [m]")
    ax.set_title(
        f"plane {plane.config.axis} = {plane.config.value:g} m, tool within "
        f"{plane.config.cone_deg:g} deg of {list(plane.config.cone_axis)}"
    )
    bar = figure.colorbar(cells, ax=ax, label="best condition number of J", extend="max")
    bar.set_ticks([10, 20, 50, 100], labels=["10", "20", "50", "100"])
    save_figure(figure, path)
