"""Paths on a surface: points with normals, on a parametric workpiece or from a CAM file.

At each sample the tool's position and working direction are given; the angle psi about the normal
is free. The orientations at psi = 0 turn as little as possible from sample to sample (they are
parallel along the path), so that a constant psi turns the tool as little as possible.
"""

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import read_limited
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.workpieces import Surface

COLUMNS = ("x", "y", "z", "nx", "ny", "nz")
# how far from 1 the length of a normal may be: CAM prints four digits or more
_NORMAL_TOLERANCE = 1e-3
MOST_SAMPLES = 10_000  # of a path
LARGEST_FILE = 1 << 24  # bytes of a CAM file
_MIN_DISTANCE = 1e-9  # m, of two neighbours; nearer ones give the path no direction
_MAX_COORDINATE = 1e3  # m, of a point; no workpiece reaches as far
_EVALUATIONS_PER_SAMPLE = 40  # evaluations of the surface per sample, to space the samples evenly


@dataclass(frozen=True)
class SurfacePath:
    """N points of a surface and its outward unit normals there.

    Attributes:
        p_WS: (N, 3) points, m.
        n_W: (N, 3) outward normals; made unit vectors.
        source: a file or the workpiece, for error lines.

    Raises:
        InputError: fewer than two samples, a number that is not finite, two neighbours at one
            point, a normal that is no unit vector, or one that points the other way than the one
            before it. The line names the first such sample.
    """

    p_WS: Array
    n_W: Array
    source: str = "surface path"

    def __post_init__(self) -> None:
        p = np.array(self.p_WS, dtype=np.float64)
        n = np.array(self.n_W, dtype=np.float64)
        if p.ndim != 2 or p.shape[1:] != (3,) or n.shape != p.shape:
            raise InputError(self.source, "", "points and normals must both be (N, 3)")
        _check(self.source, p, n, [f"sample {i}" for i in range(len(p))])
        object.__setattr__(self, "p_WS", p)
        object.__setattr__(self, "n_W", n / np.linalg.norm(n, axis=1, keepdims=True))

    @property
    def num_samples(self) -> int:
        """Number of samples, N."""
        return len(self.p_WS)

    @property
    def distance(self) -> Array:
        """(N,) distance along the polyline through the points, m."""
        steps = np.linalg.norm(np.diff(self.p_WS, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @classmethod
    def on_surface(
        cls,
        surface: Surface,
        start: tuple[float, float],
        end: tuple[float, float],
        num_samples: int,
        R_WP: ArrayLike | None = None,
        p_WP: ArrayLike | None = None,
        source: str = "surface path",
    ) -> "SurfacePath":
        """A path that is straight in (u, v), its samples evenly spaced along it.

        Args:
            surface: in the workpiece's frame P.
            start, end: (u, v) of its ends; beyond [0, 1] a periodic u goes on round.
            num_samples: N.
            R_WP, p_WP: pose of P in W; p in m; None: W itself.
            source: named in messages.

        Raises:
            InputError: as the class; or an end beyond the surface.
        """
        if not 2 <= num_samples <= MOST_SAMPLES:
            problem = f"{num_samples}, expected two or more, {MOST_SAMPLES} at most"
            raise InputError(source, "num_samples", problem)
        ends = np.array([start, end], dtype=np.float64)
        is_inside = (ends >= 0.0) & (ends <= 1.0)
        if surface.periodic_u:
            is_inside[:, 0] = True
        if not np.all(np.isfinite(ends)) or not np.all(is_inside):
            raise InputError(
                source, "start, end", f"{ends.tolist()} leaves the surface, (u, v) in [0, 1]"
            )
        # Even in (u, v) is not even in length: s where the length along the path is even.
        s = np.linspace(0.0, 1.0, _EVALUATIONS_PER_SAMPLE * num_samples)
        u, v = ends[0][:, np.newaxis] + np.outer(ends[1] - ends[0], s)
        dense = surface.at(u, v)
        steps = np.linalg.norm(np.diff(dense.p, axis=0), axis=1)
        length = np.concatenate([[0.0], np.cumsum(steps)])
        if not length[-1] > 0.0:
            raise InputError(source, "start, end", "the path has no length")
        even_s = np.interp(np.linspace(0.0, length[-1], num_samples), length, s)
        u, v = ends[0][:, np.newaxis] + np.outer(ends[1] - ends[0], even_s)
        patch = surface.at(u, v)
        R = np.eye(3) if R_WP is None else np.asarray(R_WP, dtype=np.float64)
        p = np.zeros(3) if p_WP is None else np.asarray(p_WP, dtype=np.float64)
        return cls(patch.p @ R.T + p, patch.n @ R.T, source)

    @classmethod
    def read_csv(
        cls, path: str | Path, R_WP: ArrayLike | None = None, p_WP: ArrayLike | None = None
    ) -> "SurfacePath":
        """Reads x, y, z (m) and nx, ny, nz of each sample, in the workpiece's frame, from a CSV.

        The first line names the columns; others than these six are left out.

        Raises:
            InputError: no such file, a missing column, a cell that is no number, or what the class
                refuses; the line names the line of the file.
        """
        path = Path(path)
        rows, lines = _read_rows(path)
        values = np.array(rows, dtype=np.float64).reshape(-1, 6)
        _check(str(path), values[:, :3], values[:, 3:], [f"line {line}" for line in lines])
        R = np.eye(3) if R_WP is None else np.asarray(R_WP, dtype=np.float64)
        p = np.zeros(3) if p_WP is None else np.asarray(p_WP, dtype=np.float64)
        return cls(values[:, :3] @ R.T + p, values[:, 3:] @ R.T, str(path))

    def frames(self, tool_axis_E: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
        """Orientations R_WE (N, 3, 3) of E at psi = 0, parallel along the path.

        The tool's working direction points into the surface: R_WE tool_axis_E = -n_W. At the first
        sample the tool's second axis lies along the path as far as the normal lets it.

        Args:
            tool_axis_E: (3,) working direction of the tool in E; made a unit vector.
        """
        R_ET = frame_about(np.asarray(tool_axis_E, dtype=np.float64))
        R_WT = np.empty((self.num_samples, 3, 3))
        along = self.p_WS[1] - self.p_WS[0]
        x = along - self.n_W[0] * float(self.n_W[0] @ along)
        if np.linalg.norm(x) < 1e-6 * np.linalg.norm(along):
            x = frame_about(self.n_W[0])[:, 0]
        for i in range(self.num_samples):
            z = -self.n_W[i]
            if i > 0:
                x = minimal_rotation(self.n_W[i - 1], self.n_W[i]) @ x
            x = x - z * float(z @ x)
            x = x / np.linalg.norm(x)
            R_WT[i] = np.stack([x, np.cross(z, x), z], axis=1)
        return R_WT @ R_ET.T

    def orientations(self, psi: ArrayLike, tool_axis_E: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
        """R_WE (..., N, 3, 3) for angles psi (..., N) about the outward normal, rad."""
        return np.asarray(rotation_about(self.n_W, psi) @ self.frames(tool_axis_E))


def frame_about(z: Array, name: str = "tool_axis_E") -> Array:
    """(3, 3) rotation whose third column is the unit vector along z (3,).

    Raises:
        InputError: z, called `name`, has no direction.
    """
    length = float(np.linalg.norm(z))
    if not (math.isfinite(length) and length > 1e-9):
        raise InputError(name, "", f"{z.tolist()} has no direction")
    z = z / length
    axis = np.eye(3)[int(np.argmin(np.abs(z)))]
    # Of the two axes across z the first continues the coordinate axes, so that z gives identity.
    y = np.cross(z, axis) if abs(z[2]) < 0.5 else np.array([0.0, 1.0, 0.0])
    x = np.cross(y, z)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Rotations (..., 3, 3) by angles (...) about unit vectors (..., 3) (Rodrigues)."""
    a, t = np.asarray(axis, dtype=np.float64), np.asarray(angle, dtype=np.float64)
    t = t[..., np.newaxis, np.newaxis]
    a = np.broadcast_to(a, (*t.shape[:-2], 3))
    cross = np.zeros((*a.shape[:-1], 3, 3))
    cross[..., 0, 1], cross[..., 0, 2] = -a[..., 2], a[..., 1]
    cross[..., 1, 0], cross[..., 1, 2] = a[..., 2], -a[..., 0]
    cross[..., 2, 0], cross[..., 2, 1] = -a[..., 1], a[..., 0]
    return np.asarray(np.eye(3) + np.sin(t) * cross + (1.0 - np.cos(t)) * (cross @ cross))


def minimal_rotation(a: Array, b: Array) -> Array:
    """(3, 3) the smallest rotation that takes the unit vector a to b, not its opposite."""
    axis = np.cross(a, b)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + float(a @ b)))


def _check(source: str, p: Array, n: Array, locations: list[str]) -> None:
    """Raises InputError for the first sample that is none of a path on a surface.

    Args:
        source: the file or the workpiece, for error lines.
        p, n: (N, 3) points in m and unit normals, as read.
        locations: of the samples in it, for error lines.
    """
    if len(p) < 2:
        raise InputError(source, "", f"{len(p)} samples, expected two or more")
    not_finite = np.flatnonzero(~np.all(np.isfinite(p), axis=1) | ~np.all(np.isfinite(n), axis=1))
    if not_finite.size:
        raise InputError(source, locations[not_finite[0]], "a coordinate is not a finite number")
    far = np.flatnonzero(np.any(np.abs(p) > _MAX_COORDINATE, axis=1))
    if far.size:
        farthest = np.abs(p[far[0]]).max()
        problem = f"a coordinate of {farthest:g} m, expected {_MAX_COORDINATE:g} at most"
        raise InputError(source, locations[far[0]], problem, "write metres")
    with np.errstate(over="ignore"):
        length = np.linalg.norm(n, axis=1)
    not_unit = np.flatnonzero(np.abs(length - 1.0) > _NORMAL_TOLERANCE)
    if not_unit.size:
        raise InputError(
            source,
            locations[not_unit[0]],
            f"the normal has length {length[not_unit[0]]:.4g}, expected 1",
            "export unit normals",
        )
    reversed_normals = np.flatnonzero(np.sum(n[1:] * n[:-1], axis=1) < 0.0) + 1
    if reversed_normals.size:
        raise InputError(
            source,
            locations[reversed_normals[0]],
            "the normal points to the other side than the one before it",
            "let all normals point out of the workpiece, and sample edges more finely",
        )
    repeated = np.flatnonzero(np.linalg.norm(np.diff(p, axis=0), axis=1) < _MIN_DISTANCE) + 1
    if repeated.size:
        raise InputError(source, locations[repeated[0]], "the point is that of the line before it")


def _read_rows(path: Path) -> tuple[list[list[float]], list[int]]:
    """Rows of x, y, z (m), nx, ny, nz, and the line of the file that each stands in.

    Raises:
        InputError: no CSV, a missing column, a cell that is no number, or too many points.
    """
    data = read_limited(path, LARGEST_FILE, "a CSV of points and normals")
    try:
        with io.StringIO(data.decode("utf-8-sig"), newline="") as file:
            reader = csv.reader(file)
            header = [name.strip().lower() for name in next(reader, [])]
            missing = [name for name in COLUMNS if name not in header]
            if missing:
                raise InputError(
                    path,
                    "line 1",
                    f"lacks the columns {', '.join(missing)}",
                    f"name the columns {','.join(COLUMNS)} (m and unit normals)",
                )
            columns = [header.index(name) for name in COLUMNS]
            rows, lines = list[list[float]](), list[int]()
            for cells in reader:
                if not any(cell.strip() for cell in cells):
                    continue
                if len(rows) == MOST_SAMPLES:
                    raise InputError(path, "", f"holds more than {MOST_SAMPLES} points")
                lines.append(reader.line_num)
                rows.append(_numbers(path, reader.line_num, cells, columns))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, "", "is no text file", "expected a CSV in UTF-8") from error
    return rows, lines


def _numbers(path: Path, line: int, cells: list[str], columns: list[int]) -> list[float]:
    numbers = []
    for name, column in zip(COLUMNS, columns, strict=True):
        try:
            numbers.append(float(cells[column]))
        except (ValueError, IndexError):
            cell_text = f'"{cells[column]}"' if column < len(cells) else "nothing"
            raise InputError(
                path, f"line {line}, column {name}", f"expected a number, found {cell_text}"
            ) from None
    return numbers
