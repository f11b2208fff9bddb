"""Rigid-body kernels of a serial chain, read from the MultibodyPlant that Drake simulates.

Everything is written with screws in the axes of W about W's origin, so that a sum over the bodies
that a joint carries is a plain sum. With S_j the screw of joint j, V_j the spatial velocity of its
body, and H_j, h_j, m_j the spatial momentum, first mass moment and mass of all that it carries:

    momentum_j = S_j . H_j + reflected_inertia_j v_j
    CTv_j      = -H_j . (S_j x V_j)                     (the gradient of the kinetic energy)
    G_j        = -S_j . [h_j x g; m_j g]

M comes from the composite inertias (Featherstone, Rigid Body Dynamics Algorithms, 2008, section
6.2), C v and the inverse dynamics from the recursive Newton-Euler equations (section 5.3).

One numba kernel serves one sample, and the loops over many samples call that same kernel. It uses
no fast-math reordering, so that one sample and a row of a million agree bit for bit.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    Frame,
    Joint,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    WeldJoint,
)

from models.files.input_error import InputError
from models.rigid_body.conditioning import condition_numbers_of

Array = NDArray[np.float64]

# Columns of SerialChain.table, one row per joint; the last row holds E and gravity. The kernels
# spell the columns of vectors as numbers: 0-8 R_PJ row by row, 9-11 p_PJ, 12-14 axis, 15 prismatic
# or not, 16-25 inertial parameters, 26 reflected inertia; last row: R_LE, p_LE, gravity in 12-14.
TABLE_COLUMNS = 32
_PRISMATIC = 15
_REFLECTED = 26

# Columns of the scratch array, one row per joint, everything in axes of W: 0-8 R_WJ, 9-11 p_WJ;
# then, about W's origin: 12-17 screw of the joint [angular; linear], 18-23 velocity of the body,
# 24 its mass, 25-27 first moment, 28-33 inertia (xx xy yy xz yz zz), 34-39 acceleration - gravity.
SCRATCH_COLUMNS = 40

# Starting threads costs some microseconds, as much as a few samples.
_PARALLEL_FROM = 64
_BLOCK = 128


@njit(cache=True, error_model="numpy")
def _place(table, q, scratch):  # type: ignore[no-untyped-def]
    """Pose and screw of every joint."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    px, py, pz = 0.0, 0.0, 0.0
    for i in range(q.shape[0]):
        x, y, z = table[i, 9], table[i, 10], table[i, 11]
        px += r00 * x + r01 * y + r02 * z
        py += r10 * x + r11 * y + r12 * z
        pz += r20 * x + r21 * y + r22 * z
        b00, b01, b02 = table[i, 0], table[i, 1], table[i, 2]
        b10, b11, b12 = table[i, 3], table[i, 4], table[i, 5]
        b20, b21, b22 = table[i, 6], table[i, 7], table[i, 8]
        a00 = r00 * b00 + r01 * b10 + r02 * b20
        a01 = r00 * b01 + r01 * b11 + r02 * b21
        a02 = r00 * b02 + r01 * b12 + r02 * b22
        a10 = r10 * b00 + r11 * b10 + r12 * b20
        a11 = r10 * b01 + r11 * b11 + r12 * b21
        a12 = r10 * b02 + r11 * b12 + r12 * b22
        a20 = r20 * b00 + r21 * b10 + r22 * b20
        a21 = r20 * b01 + r21 * b11 + r22 * b21
        a22 = r20 * b02 + r21 * b12 + r22 * b22
        x, y, z = table[i, 12], table[i, 13], table[i, 14]
        ux = a00 * x + a01 * y + a02 * z
        uy = a10 * x + a11 * y + a12 * z
        uz = a20 * x + a21 * y + a22 * z
        if table[i, _PRISMATIC] != 0.0:
            px += ux * q[i]
            py += uy * q[i]
            pz += uz * q[i]
            r00, r01, r02 = a00, a01, a02
            r10, r11, r12 = a10, a11, a12
            r20, r21, r22 = a20, a21, a22
            scratch[i, 12] = 0.0
            scratch[i, 13] = 0.0
            scratch[i, 14] = 0.0
            scratch[i, 15] = ux
            scratch[i, 16] = uy
            scratch[i, 17] = uz
        else:
            c = math.cos(q[i])
            s = math.sin(q[i])
            d = 1.0 - c
            b00 = c + d * x * x
            b11 = c + d * y * y
            b22 = c + d * z * z
            b01 = d * x * y - s * z
            b10 = d * x * y + s * z
            b02 = d * x * z + s * y
            b20 = d * x * z - s * y
            b12 = d * y * z - s * x
            b21 = d * y * z + s * x
            r00 = a00 * b00 + a01 * b10 + a02 * b20
            r01 = a00 * b01 + a01 * b11 + a02 * b21
            r02 = a00 * b02 + a01 * b12 + a02 * b22
            r10 = a10 * b00 + a11 * b10 + a12 * b20
            r11 = a10 * b01 + a11 * b11 + a12 * b21
            r12 = a10 * b02 + a11 * b12 + a12 * b22
            r20 = a20 * b00 + a21 * b10 + a22 * b20
            r21 = a20 * b01 + a21 * b11 + a22 * b21
            r22 = a20 * b02 + a21 * b12 + a22 * b22
            scratch[i, 12] = ux
            scratch[i, 13] = uy
            scratch[i, 14] = uz
            scratch[i, 15] = py * uz - pz * uy
            scratch[i, 16] = pz * ux - px * uz
            scratch[i, 17] = px * uy - py * ux
        scratch[i, 0] = r00
        scratch[i, 1] = r01
        scratch[i, 2] = r02
        scratch[i, 3] = r10
        scratch[i, 4] = r11
        scratch[i, 5] = r12
        scratch[i, 6] = r20
        scratch[i, 7] = r21
        scratch[i, 8] = r22
        scratch[i, 9] = px
        scratch[i, 10] = py
        scratch[i, 11] = pz


@njit(cache=True, error_model="numpy")
def _tool_pose(table, scratch, R_WE, p_WE):  # type: ignore[no-untyped-def]
    """Pose of E; needs _place."""
    n = table.shape[0] - 1
    for r in range(3):
        x = scratch[n - 1, 3 * r]
        y = scratch[n - 1, 3 * r + 1]
        z = scratch[n - 1, 3 * r + 2]
        for c in range(3):
            R_WE[r, c] = x * table[n, c] + y * table[n, 3 + c] + z * table[n, 6 + c]
        p_WE[r] = scratch[n - 1, 9 + r] + (x * table[n, 9] + y * table[n, 10] + z * table[n, 11])


@njit(cache=True, error_model="numpy")
def _tool_jacobian(scratch, p_WE, J):  # type: ignore[no-untyped-def]
    """Jacobian [angular; linear] at E; needs _place and _tool_pose."""
    x, y, z = p_WE[0], p_WE[1], p_WE[2]
    for i in range(J.shape[1]):
        sx, sy, sz = scratch[i, 12], scratch[i, 13], scratch[i, 14]
        J[0, i] = sx
        J[1, i] = sy
        J[2, i] = sz
        J[3, i] = scratch[i, 15] + (sy * z - sz * y)
        J[4, i] = scratch[i, 16] + (sz * x - sx * z)
        J[5, i] = scratch[i, 17] + (sx * y - sy * x)


@njit(cache=True, error_model="numpy")
def _place_inertia(table, scratch):  # type: ignore[no-untyped-def]
    """Inertia of every body about W's origin; needs _place."""
    for i in range(table.shape[0] - 1):
        r00, r01, r02 = scratch[i, 0], scratch[i, 1], scratch[i, 2]
        r10, r11, r12 = scratch[i, 3], scratch[i, 4], scratch[i, 5]
        r20, r21, r22 = scratch[i, 6], scratch[i, 7], scratch[i, 8]
        px, py, pz = scratch[i, 9], scratch[i, 10], scratch[i, 11]
        m = table[i, 16]
        x, y, z = table[i, 17], table[i, 18], table[i, 19]
        hx = r00 * x + r01 * y + r02 * z
        hy = r10 * x + r11 * y + r12 * z
        hz = r20 * x + r21 * y + r22 * z
        xx, xy, yy = table[i, 20], table[i, 21], table[i, 22]
        xz, yz, zz = table[i, 23], table[i, 24], table[i, 25]
        a00 = r00 * xx + r01 * xy + r02 * xz
        a01 = r00 * xy + r01 * yy + r02 * yz
        a02 = r00 * xz + r01 * yz + r02 * zz
        a10 = r10 * xx + r11 * xy + r12 * xz
        a11 = r10 * xy + r11 * yy + r12 * yz
        a12 = r10 * xz + r11 * yz + r12 * zz
        a20 = r20 * xx + r21 * xy + r22 * xz
        a21 = r20 * xy + r21 * yy + r22 * yz
        a22 = r20 * xz + r21 * yz + r22 * zz
        # The shift by p, linear in (m, h, I): with e = h + m p, the first moment about W's origin,
        # I_W = I + (p.e + p.h) 1 - (p e^T + h p^T).
        ex = hx + m * px
        ey = hy + m * py
        ez = hz + m * pz
        dx = px * (ex + hx)
        dy = py * (ey + hy)
        dz = pz * (ez + hz)
        scratch[i, 24] = m
        scratch[i, 25] = ex
        scratch[i, 26] = ey
        scratch[i, 27] = ez
        scratch[i, 28] = a00 * r00 + a01 * r01 + a02 * r02 + (dy + dz)
        scratch[i, 29] = a00 * r10 + a01 * r11 + a02 * r12 - (px * ey + hx * py)
        scratch[i, 30] = a10 * r10 + a11 * r11 + a12 * r12 + (dx + dz)
        scratch[i, 31] = a00 * r20 + a01 * r21 + a02 * r22 - (px * ez + hx * pz)
        scratch[i, 32] = a10 * r20 + a11 * r21 + a12 * r22 - (py * ez + hy * pz)
        scratch[i, 33] = a20 * r20 + a21 * r21 + a22 * r22 + (dx + dy)


@njit(cache=True, error_model="numpy")
def _times_inertia(scratch, i, wx, wy, wz, vx, vy, vz):  # type: ignore[no-untyped-def]
    """Inertia of body i times the motion vector [w; v]."""
    m = scratch[i, 24]
    hx, hy, hz = scratch[i, 25], scratch[i, 26], scratch[i, 27]
    xx, xy, yy = scratch[i, 28], scratch[i, 29], scratch[i, 30]
    xz, yz, zz = scratch[i, 31], scratch[i, 32], scratch[i, 33]
    return (
        xx * wx + xy * wy + xz * wz + (hy * vz - hz * vy),
        xy * wx + yy * wy + yz * wz + (hz * vx - hx * vz),
        xz * wx + yz * wy + zz * wz + (hx * vy - hy * vx),
        m * vx + (wy * hz - wz * hy),
        m * vy + (wz * hx - wx * hz),
        m * vz + (wx * hy - wy * hx),
    )


@njit(cache=True, error_model="numpy")
def _velocities(v, scratch):  # type: ignore[no-untyped-def]
    """Spatial velocity of every body; needs _place."""
    wx, wy, wz, vx, vy, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(v.shape[0]):
        u = v[i]
        wx += scratch[i, 12] * u
        wy += scratch[i, 13] * u
        wz += scratch[i, 14] * u
        vx += scratch[i, 15] * u
        vy += scratch[i, 16] * u
        vz += scratch[i, 17] * u
        scratch[i, 18] = wx
        scratch[i, 19] = wy
        scratch[i, 20] = wz
        scratch[i, 21] = vx
        scratch[i, 22] = vy
        scratch[i, 23] = vz


@njit(cache=True, error_model="numpy")
def _momentum_terms(table, v, momentum, CTv, G, scratch):  # type: ignore[no-untyped-def]
    """M v, C^T v and G; needs _place, _place_inertia and _velocities."""
    n = v.shape[0]
    gx, gy, gz = table[n, 12], table[n, 13], table[n, 14]
    kx, ky, kz, lx, ly, lz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # H: angular, linear
    m, hx, hy, hz = 0.0, 0.0, 0.0, 0.0
    for j in range(n - 1, -1, -1):
        wx, wy, wz = scratch[j, 18], scratch[j, 19], scratch[j, 20]
        vx, vy, vz = scratch[j, 21], scratch[j, 22], scratch[j, 23]
        d0, d1, d2, d3, d4, d5 = _times_inertia(scratch, j, wx, wy, wz, vx, vy, vz)
        kx += d0
        ky += d1
        kz += d2
        lx += d3
        ly += d4
        lz += d5
        m += scratch[j, 24]
        hx += scratch[j, 25]
        hy += scratch[j, 26]
        hz += scratch[j, 27]
        sx, sy, sz = scratch[j, 12], scratch[j, 13], scratch[j, 14]
        tx, ty, tz = scratch[j, 15], scratch[j, 16], scratch[j, 17]
        momentum[j] = (
            (sx * kx + sy * ky + sz * kz)
            + (tx * lx + ty * ly + tz * lz)
            + table[j, _REFLECTED] * v[j]
        )
        # S x V = [s x w; s x v + t x w]
        CTv[j] = -(
            kx * (sy * wz - sz * wy)
            + ky * (sz * wx - sx * wz)
            + kz * (sx * wy - sy * wx)
            + lx * ((sy * vz - sz * vy) + (ty * wz - tz * wy))
            + ly * ((sz * vx - sx * vz) + (tz * wx - tx * wz))
            + lz * ((sx * vy - sy * vx) + (tx * wy - ty * wx))
        )
        G[j] = -(
            sx * (hy * gz - hz * gy)
            + sy * (hz * gx - hx * gz)
            + sz * (hx * gy - hy * gx)
            + m * (tx * gx + ty * gy + tz * gz)
        )


@njit(cache=True, error_model="numpy")
def _gravity_torque(table, G, scratch):  # type: ignore[no-untyped-def]
    """G; needs _place only, since first moments need no inertia."""
    n = G.shape[0]
    gx, gy, gz = table[n, 12], table[n, 13], table[n, 14]
    m, hx, hy, hz = 0.0, 0.0, 0.0, 0.0
    for j in range(n - 1, -1, -1):
        mass, x, y, z = table[j, 16], table[j, 17], table[j, 18], table[j, 19]
        m += mass
        hx += (scratch[j, 0] * x + scratch[j, 1] * y + scratch[j, 2] * z) + mass * scratch[j, 9]
        hy += (scratch[j, 3] * x + scratch[j, 4] * y + scratch[j, 5] * z) + mass * scratch[j, 10]
        hz += (scratch[j, 6] * x + scratch[j, 7] * y + scratch[j, 8] * z) + mass * scratch[j, 11]
        sx, sy, sz = scratch[j, 12], scratch[j, 13], scratch[j, 14]
        tx, ty, tz = scratch[j, 15], scratch[j, 16], scratch[j, 17]
        G[j] = -(
            sx * (hy * gz - hz * gy)
            + sy * (hz * gx - hx * gz)
            + sz * (hx * gy - hy * gx)
            + m * (tx * gx + ty * gy + tz * gz)
        )


@njit(cache=True, error_model="numpy")
def _mass_matrix(table, M, scratch):  # type: ignore[no-untyped-def]
    """M from the composite inertias; needs _place and _place_inertia."""
    m, hx, hy, hz = 0.0, 0.0, 0.0, 0.0
    xx, xy, yy, xz, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(M.shape[0] - 1, -1, -1):
        m += scratch[j, 24]
        hx += scratch[j, 25]
        hy += scratch[j, 26]
        hz += scratch[j, 27]
        xx += scratch[j, 28]
        xy += scratch[j, 29]
        yy += scratch[j, 30]
        xz += scratch[j, 31]
        yz += scratch[j, 32]
        zz += scratch[j, 33]
        sx, sy, sz = scratch[j, 12], scratch[j, 13], scratch[j, 14]
        tx, ty, tz = scratch[j, 15], scratch[j, 16], scratch[j, 17]
        kx = xx * sx + xy * sy + xz * sz + (hy * tz - hz * ty)
        ky = xy * sx + yy * sy + yz * sz + (hz * tx - hx * tz)
        kz = xz * sx + yz * sy + zz * sz + (hx * ty - hy * tx)
        lx = m * tx + (sy * hz - sz * hy)
        ly = m * ty + (sz * hx - sx * hz)
        lz = m * tz + (sx * hy - sy * hx)
        for i in range(j + 1):
            value = (scratch[i, 12] * kx + scratch[i, 13] * ky + scratch[i, 14] * kz) + (
                scratch[i, 15] * lx + scratch[i, 16] * ly + scratch[i, 17] * lz
            )
            M[i, j] = value
            M[j, i] = value
        M[j, j] += table[j, _REFLECTED]


@njit(cache=True, error_model="numpy")
def _accelerations(v, vdot, gx, gy, gz, scratch):  # type: ignore[no-untyped-def]
    """Spatial acceleration of every body, minus gravity; needs _velocities."""
    ax, ay, az, bx, by, bz = 0.0, 0.0, 0.0, -gx, -gy, -gz
    for i in range(v.shape[0]):
        u = v[i]
        udot = vdot[i]
        wx, wy, wz = scratch[i, 18], scratch[i, 19], scratch[i, 20]
        vx, vy, vz = scratch[i, 21], scratch[i, 22], scratch[i, 23]
        sx, sy, sz = scratch[i, 12], scratch[i, 13], scratch[i, 14]
        tx, ty, tz = scratch[i, 15], scratch[i, 16], scratch[i, 17]
        # S udot + (V x S) u
        ax += sx * udot + (wy * sz - wz * sy) * u
        ay += sy * udot + (wz * sx - wx * sz) * u
        az += sz * udot + (wx * sy - wy * sx) * u
        bx += tx * udot + ((wy * tz - wz * ty) + (vy * sz - vz * sy)) * u
        by += ty * udot + ((wz * tx - wx * tz) + (vz * sx - vx * sz)) * u
        bz += tz * udot + ((wx * ty - wy * tx) + (vx * sy - vy * sx)) * u
        scratch[i, 34] = ax
        scratch[i, 35] = ay
        scratch[i, 36] = az
        scratch[i, 37] = bx
        scratch[i, 38] = by
        scratch[i, 39] = bz


@njit(cache=True, error_model="numpy")
def _newton_euler(table, vdot, tau, scratch):  # type: ignore[no-untyped-def]
    """Torques that cause the accelerations; needs _place_inertia and _accelerations."""
    fx, fy, fz, lx, ly, lz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # moment about W's origin, force
    for j in range(tau.shape[0] - 1, -1, -1):
        wx, wy, wz = scratch[j, 18], scratch[j, 19], scratch[j, 20]
        vx, vy, vz = scratch[j, 21], scratch[j, 22], scratch[j, 23]
        ax, ay, az = scratch[j, 34], scratch[j, 35], scratch[j, 36]
        bx, by, bz = scratch[j, 37], scratch[j, 38], scratch[j, 39]
        k0, k1, k2, k3, k4, k5 = _times_inertia(scratch, j, wx, wy, wz, vx, vy, vz)
        d0, d1, d2, d3, d4, d5 = _times_inertia(scratch, j, ax, ay, az, bx, by, bz)
        fx += d0 + ((wy * k2 - wz * k1) + (vy * k5 - vz * k4))
        fy += d1 + ((wz * k0 - wx * k2) + (vz * k3 - vx * k5))
        fz += d2 + ((wx * k1 - wy * k0) + (vx * k4 - vy * k3))
        lx += d3 + (wy * k5 - wz * k4)
        ly += d4 + (wz * k3 - wx * k5)
        lz += d5 + (wx * k4 - wy * k3)
        tau[j] = (
            (scratch[j, 12] * fx + scratch[j, 13] * fy + scratch[j, 14] * fz)
            + (scratch[j, 15] * lx + scratch[j, 16] * ly + scratch[j, 17] * lz)
            + table[j, _REFLECTED] * vdot[j]
        )


@njit(cache=True, error_model="numpy")
def _coriolis(table, v, Cv, scratch):  # type: ignore[no-untyped-def]
    """C v; needs _place_inertia and _velocities."""
    for i in range(v.shape[0]):
        Cv[i] = 0.0  # stands in for vdot: every entry is read before it is written
    _accelerations(v, Cv, 0.0, 0.0, 0.0, scratch)
    _newton_euler(table, Cv, Cv, scratch)


@njit(cache=True, error_model="numpy")
def _regressor(Y, scratch):  # type: ignore[no-untyped-def]
    """Regressor of the inertial parameters; needs _accelerations.

    The force and moment on body i, about and in axes of its joint frame, with w and a its angular
    velocity and the acceleration of the frame's origin minus gravity:

        f = m a + wdot x h + w x (w x h)
        n = I wdot + w x (I w) + h x a

    Joint j <= i, whose screw there is [s; t], feels t.f + s.n, sorted here by parameter.
    """
    count = Y.shape[0]
    for i in range(count):
        r00, r01, r02 = scratch[i, 0], scratch[i, 1], scratch[i, 2]
        r10, r11, r12 = scratch[i, 3], scratch[i, 4], scratch[i, 5]
        r20, r21, r22 = scratch[i, 6], scratch[i, 7], scratch[i, 8]
        px, py, pz = scratch[i, 9], scratch[i, 10], scratch[i, 11]
        x, y, z = scratch[i, 18], scratch[i, 19], scratch[i, 20]
        ux = scratch[i, 21] + (y * pz - z * py)
        uy = scratch[i, 22] + (z * px - x * pz)
        uz = scratch[i, 23] + (x * py - y * px)
        dx, dy, dz = scratch[i, 34], scratch[i, 35], scratch[i, 36]
        bx = scratch[i, 37] + (dy * pz - dz * py) + (y * uz - z * uy)
        by = scratch[i, 38] + (dz * px - dx * pz) + (z * ux - x * uz)
        bz = scratch[i, 39] + (dx * py - dy * px) + (x * uy - y * ux)
        wx = r00 * x + r10 * y + r20 * z
        wy = r01 * x + r11 * y + r21 * z
        wz = r02 * x + r12 * y + r22 * z
        ex = r00 * dx + r10 * dy + r20 * dz
        ey = r01 * dx + r11 * dy + r21 * dz
        ez = r02 * dx + r12 * dy + r22 * dz
        ax = r00 * bx + r10 * by + r20 * bz
        ay = r01 * bx + r11 * by + r21 * bz
        az = r02 * bx + r12 * by + r22 * bz
        # wdot x h + w x (w x h) = B h
        b00 = -(wy * wy + wz * wz)
        b11 = -(wx * wx + wz * wz)
        b22 = -(wx * wx + wy * wy)
        b01 = wx * wy - ez
        b10 = wx * wy + ez
        b02 = wx * wz + ey
        b20 = wx * wz - ey
        b12 = wy * wz - ex
        b21 = wy * wz + ex
        c = 10 * i
        for j in range(i + 1):
            x, y, z = scratch[j, 12], scratch[j, 13], scratch[j, 14]
            ux = scratch[j, 15] + (y * pz - z * py)
            uy = scratch[j, 16] + (z * px - x * pz)
            uz = scratch[j, 17] + (x * py - y * px)
            sx = r00 * x + r10 * y + r20 * z
            sy = r01 * x + r11 * y + r21 * z
            sz = r02 * x + r12 * y + r22 * z
            tx = r00 * ux + r10 * uy + r20 * uz
            ty = r01 * ux + r11 * uy + r21 * uz
            tz = r02 * ux + r12 * uy + r22 * uz
            # s.(w x I w) = (s x w).I w
            vx = sy * wz - sz * wy
            vy = sz * wx - sx * wz
            vz = sx * wy - sy * wx
            Y[j, c] = tx * ax + ty * ay + tz * az
            Y[j, c + 1] = (tx * b00 + ty * b10 + tz * b20) + (ay * sz - az * sy)
            Y[j, c + 2] = (tx * b01 + ty * b11 + tz * b21) + (az * sx - ax * sz)
            Y[j, c + 3] = (tx * b02 + ty * b12 + tz * b22) + (ax * sy - ay * sx)
            Y[j, c + 4] = sx * ex + vx * wx
            Y[j, c + 5] = (sx * ey + sy * ex) + (vx * wy + vy * wx)
            Y[j, c + 6] = sy * ey + vy * wy
            Y[j, c + 7] = (sx * ez + sz * ex) + (vx * wz + vz * wx)
            Y[j, c + 8] = (sy * ez + sz * ey) + (vy * wz + vz * wy)
            Y[j, c + 9] = sz * ez + vz * wz
        for j in range(i + 1, count):
            for k in range(c, c + 10):
                Y[j, k] = 0.0


@njit(cache=True, error_model="numpy")
def observer_terms(table, q, v, momentum, CTv, G, J, R_WE, p_WE, scratch):  # type: ignore[no-untyped-def]
    """What a momentum observer and a wrench reading need of one sample, for other kernels.

    Args:
        table: SerialChain.table, (n + 1, TABLE_COLUMNS).
        q, v: (n,) joint positions and velocities.
        momentum, CTv, G, J, R_WE, p_WE: written; (n,), (n,), (n,), (6, n), (3, 3), (3,).
        scratch: written; (n, SCRATCH_COLUMNS).
    """
    _place(table, q, scratch)
    _place_inertia(table, scratch)
    _velocities(v, scratch)
    _momentum_terms(table, v, momentum, CTv, G, scratch)
    _tool_pose(table, scratch, R_WE, p_WE)
    _tool_jacobian(scratch, p_WE, J)


@njit(cache=True, error_model="numpy")
def all_terms(table, q, v, momentum, CTv, Cv, G, M, J, R_WE, p_WE, V_WE, scratch):  # type: ignore[no-untyped-def]
    """All of RigidBodyTerms for one sample; arguments as in observer_terms."""
    n = q.shape[0]
    observer_terms(table, q, v, momentum, CTv, G, J, R_WE, p_WE, scratch)
    _mass_matrix(table, M, scratch)
    _coriolis(table, v, Cv, scratch)
    for i in range(3):
        V_WE[i] = scratch[n - 1, 18 + i]
    x, y, z = V_WE[0], V_WE[1], V_WE[2]
    V_WE[3] = scratch[n - 1, 21] + (y * p_WE[2] - z * p_WE[1])
    V_WE[4] = scratch[n - 1, 22] + (z * p_WE[0] - x * p_WE[2])
    V_WE[5] = scratch[n - 1, 23] + (x * p_WE[1] - y * p_WE[0])


@njit(cache=True, error_model="numpy")
def pose_and_jacobian(table, q, R_WE, p_WE, J, scratch):  # type: ignore[no-untyped-def]
    """Pose of E in W and Jacobian [angular; linear] of one sample, for other kernels.

    Args:
        table: SerialChain.table, (n + 1, TABLE_COLUMNS).
        q: (n,) joint positions.
        R_WE, p_WE, J: written; (3, 3), (3,), (6, n).
        scratch: written; (n, SCRATCH_COLUMNS).
    """
    _place(table, q, scratch)
    _tool_pose(table, scratch, R_WE, p_WE)
    _tool_jacobian(scratch, p_WE, J)


# Loops over samples. Each `_rows` runs its kernel row by row; each `_batch` hands blocks of rows to
# threads, with scratch memory of their own, so that the outputs are the only large arrays.


@njit(cache=True, error_model="numpy")
def _pose_rows(table, q, R_WE, p_WE, scratch):  # type: ignore[no-untyped-def]
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _tool_pose(table, scratch, R_WE[k], p_WE[k])


@njit(cache=True, error_model="numpy", parallel=True)
def _pose_batch(table, q, R_WE, p_WE):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _pose_rows(table, q[rows], R_WE[rows], p_WE[rows], scratch)


@njit(cache=True, error_model="numpy")
def _jacobian_rows(table, q, J, scratch):  # type: ignore[no-untyped-def]
    R_WE = np.empty((3, 3))
    p_WE = np.empty(3)
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _tool_pose(table, scratch, R_WE, p_WE)
        _tool_jacobian(scratch, p_WE, J[k])


@njit(cache=True, error_model="numpy", parallel=True)
def _jacobian_batch(table, q, J):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _jacobian_rows(table, q[rows], J[rows], scratch)


@njit(cache=True, error_model="numpy")
def _condition_number_rows(table, q, out, scratch):  # type: ignore[no-untyped-def]
    J = np.empty((q.shape[0], 6, q.shape[1]))  # of a block of rows
    _jacobian_rows(table, q, J, scratch)
    condition_numbers_of(J, out)


@njit(cache=True, error_model="numpy", parallel=True)
def _condition_number_batch(table, q, out):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _condition_number_rows(table, q[rows], out[rows], scratch)


@njit(cache=True, error_model="numpy")
def _mass_matrix_rows(table, q, M, scratch):  # type: ignore[no-untyped-def]
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _place_inertia(table, scratch)
        _mass_matrix(table, M[k], scratch)


@njit(cache=True, error_model="numpy", parallel=True)
def _mass_matrix_batch(table, q, M):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _mass_matrix_rows(table, q[rows], M[rows], scratch)


@njit(cache=True, error_model="numpy")
def _gravity_torque_rows(table, q, G, scratch):  # type: ignore[no-untyped-def]
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _gravity_torque(table, G[k], scratch)


@njit(cache=True, error_model="numpy", parallel=True)
def _gravity_torque_batch(table, q, G):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _gravity_torque_rows(table, q[rows], G[rows], scratch)


@njit(cache=True, error_model="numpy")
def _momentum_terms_rows(table, q, v, momentum, CTv, G, scratch):  # type: ignore[no-untyped-def]
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _place_inertia(table, scratch)
        _velocities(v[k], scratch)
        _momentum_terms(table, v[k], momentum[k], CTv[k], G[k], scratch)


@njit(cache=True, error_model="numpy", parallel=True)
def _momentum_terms_batch(table, q, v, momentum, CTv, G):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _momentum_terms_rows(table, q[rows], v[rows], momentum[rows], CTv[rows], G[rows], scratch)


@njit(cache=True, error_model="numpy")
def _momentum_rows(table, q, v, momentum, scratch):  # type: ignore[no-untyped-def]
    unused = np.empty(q.shape[1])
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _place_inertia(table, scratch)
        _velocities(v[k], scratch)
        _momentum_terms(table, v[k], momentum[k], unused, unused, scratch)


@njit(cache=True, error_model="numpy", parallel=True)
def _momentum_batch(table, q, v, momentum):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _momentum_rows(table, q[rows], v[rows], momentum[rows], scratch)


@njit(cache=True, error_model="numpy")
def _coriolis_transpose_rows(table, q, v, CTv, scratch):  # type: ignore[no-untyped-def]
    unused = np.empty(q.shape[1])
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _place_inertia(table, scratch)
        _velocities(v[k], scratch)
        _momentum_terms(table, v[k], unused, CTv[k], unused, scratch)


@njit(cache=True, error_model="numpy", parallel=True)
def _coriolis_transpose_batch(table, q, v, CTv):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _coriolis_transpose_rows(table, q[rows], v[rows], CTv[rows], scratch)


@njit(cache=True, error_model="numpy")
def _kinetic_energy_rows(table, q, v, energy, scratch):  # type: ignore[no-untyped-def]
    momentum = np.empty(q.shape[1])
    unused = np.empty(q.shape[1])
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _place_inertia(table, scratch)
        _velocities(v[k], scratch)
        _momentum_terms(table, v[k], momentum, unused, unused, scratch)
        twice = 0.0
        for i in range(q.shape[1]):
            twice += momentum[i] * v[k, i]
        energy[k] = 0.5 * twice


@njit(cache=True, error_model="numpy", parallel=True)
def _kinetic_energy_batch(table, q, v, energy):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _kinetic_energy_rows(table, q[rows], v[rows], energy[rows], scratch)


@njit(cache=True, error_model="numpy")
def _inverse_dynamics_rows(table, q, v, vdot, tau, scratch):  # type: ignore[no-untyped-def]
    n = q.shape[1]
    gx, gy, gz = table[n, 12], table[n, 13], table[n, 14]
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _place_inertia(table, scratch)
        _velocities(v[k], scratch)
        _accelerations(v[k], vdot[k], gx, gy, gz, scratch)
        _newton_euler(table, vdot[k], tau[k], scratch)


@njit(cache=True, error_model="numpy", parallel=True)
def _inverse_dynamics_batch(table, q, v, vdot, tau):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _inverse_dynamics_rows(table, q[rows], v[rows], vdot[rows], tau[rows], scratch)


@njit(cache=True, error_model="numpy")
def _coriolis_rows(table, q, v, Cv, scratch):  # type: ignore[no-untyped-def]
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _place_inertia(table, scratch)
        _velocities(v[k], scratch)
        _coriolis(table, v[k], Cv[k], scratch)


@njit(cache=True, error_model="numpy", parallel=True)
def _coriolis_batch(table, q, v, Cv):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _coriolis_rows(table, q[rows], v[rows], Cv[rows], scratch)


@njit(cache=True, error_model="numpy")
def _regressor_rows(table, q, v, vdot, Y, scratch):  # type: ignore[no-untyped-def]
    n = q.shape[1]
    gx, gy, gz = table[n, 12], table[n, 13], table[n, 14]
    for k in range(q.shape[0]):
        _place(table, q[k], scratch)
        _velocities(v[k], scratch)
        _accelerations(v[k], vdot[k], gx, gy, gz, scratch)
        _regressor(Y[k], scratch)


@njit(cache=True, error_model="numpy", parallel=True)
def _regressor_batch(table, q, v, vdot, Y):  # type: ignore[no-untyped-def]
    for b in prange((q.shape[0] + _BLOCK - 1) // _BLOCK):
        rows = slice(b * _BLOCK, (b + 1) * _BLOCK)
        scratch = np.empty((q.shape[1], SCRATCH_COLUMNS))
        _regressor_rows(table, q[rows], v[rows], vdot[rows], Y[rows], scratch)


@dataclass(slots=True)
class RigidBodyTerms:
    """Every term of the equation of motion at one sample; see SerialChain.

    Attributes:
        momentum: (n,) M v, kg m^2/s.
        CTv: (n,) gradient of the kinetic energy, N m.
        Cv: (n,) Coriolis and centrifugal torque, N m.
        G: (n,) torque that holds the arm against gravity, N m.
        M: (n, n) kg m^2, rotor inertia included.
        J: (6, n) Jacobian [angular; linear] at E in axes of W.
        R_WE: (3, 3) orientation of E in W.
        p_WE: (3,) m.
        V_WE: (6,) velocity of E in W [angular; linear], rad/s and m/s.
        q: (n,) rad (m for a prismatic joint), v: (n,) its rate.
    """

    momentum: Array
    CTv: Array
    Cv: Array
    G: Array
    M: Array
    J: Array
    R_WE: Array
    p_WE: Array
    V_WE: Array
    q: Array
    v: Array


@dataclass(frozen=True, eq=False)
class SerialChain:
    """A robot from W to E: one moving body a joint, everything that is fixed to it merged.

        M(q) vdot + C(q, v) v + G(q) = tau

    W is the plant's world. A joint frame is the joint's frame on its child body (the child link's
    frame of a URDF). Methods take q (n,) or (N, n), v and vdot alike, in rad and s (m for a
    prismatic joint), and keep the leading shape. The arrays are read only: make a changed chain
    with `with_inertial_parameters` and `with_tool_frame`.

    Attributes:
        joint_names: from base to E.
        prismatic: (n,) bool.
        R_PJ, p_PJ: (n, 3, 3), (n, 3) pose of joint frame i at q_i = 0 in joint frame i-1 (W for
            the first).
        axis: (n, 3) unit axis in the joint frame.
        inertial_parameters: (n, 10) of moving body i about the origin and in axes of its joint
            frame: m, m cx, m cy, m cz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
        reflected_inertia: (n,) rotor inertia on the joint side, kg m^2 (kg).
        gravity: (3,) in W, m/s^2.
        R_LE, p_LE: pose of E in the last joint frame.
        table: (n + 1, TABLE_COLUMNS) the same numbers, packed for the kernels.
    """

    joint_names: tuple[str, ...]
    prismatic: NDArray[np.bool_]
    R_PJ: Array
    p_PJ: Array
    axis: Array
    inertial_parameters: Array
    reflected_inertia: Array
    gravity: Array
    R_LE: Array
    p_LE: Array
    table: Array = field(init=False, repr=False)
    _scratch: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Checks the shapes and packs the table."""
        n = len(self.joint_names)
        shapes = {
            "R_PJ": (n, 3, 3),
            "p_PJ": (n, 3),
            "axis": (n, 3),
            "inertial_parameters": (n, 10),
            "reflected_inertia": (n,),
            "gravity": (3,),
            "R_LE": (3, 3),
            "p_LE": (3,),
        }
        for name, shape in shapes.items():
            value = np.array(getattr(self, name), dtype=np.float64, order="C")
            if value.shape != shape:
                raise ValueError(f"SerialChain.{name}: shape {value.shape}, expected {shape}")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        prismatic = np.array(self.prismatic, dtype=np.bool_)
        if n == 0 or prismatic.shape != (n,):
            raise ValueError(
                f"SerialChain.prismatic: shape {prismatic.shape}, expected ({n},), n > 0"
            )
        prismatic.flags.writeable = False
        object.__setattr__(self, "prismatic", prismatic)
        table = np.zeros((n + 1, TABLE_COLUMNS))
        table[:n, 0:9] = self.R_PJ.reshape(n, 9)
        table[:n, 9:12] = self.p_PJ
        table[:n, 12:15] = self.axis
        table[:n, _PRISMATIC] = self.prismatic
        table[:n, 16:26] = self.inertial_parameters
        table[:n, _REFLECTED] = self.reflected_inertia
        table[n, 0:9] = self.R_LE.reshape(9)
        table[n, 9:12] = self.p_LE
        table[n, 12:15] = self.gravity
        object.__setattr__(self, "table", table)
        # One for all calls from Python: the kernels hold the interpreter lock and keep nothing.
        object.__setattr__(self, "_scratch", np.empty((n, SCRATCH_COLUMNS)))

    @property
    def num_joints(self) -> int:
        """n."""
        return len(self.joint_names)

    @classmethod
    def from_plant(
        cls, plant: MultibodyPlant, model_instance: ModelInstanceIndex, frame_E: Frame
    ) -> Self:
        """Reads the chain from world to frame_E as Drake simulates it.

        Bodies welded to a moving body, at any depth and of any model instance, count as part of
        it. Where a joint has several actuators, the last one's rotor inertia is the joint's, as in
        Drake.

        Args:
            plant: finalized, with the robot's base welded to the world.
            model_instance: the robot's.
            frame_E: a frame fixed to the last moving body or to something welded to it.

        Raises:
            InputError: plant not finalized; base not welded; no joint, or a joint that is neither
                revolute nor prismatic, between world and E; a moving joint off the chain.
        """
        name = plant.GetModelInstanceName(model_instance)
        if not plant.is_finalized():
            raise InputError(name, "", "its plant is not finalized", "call Finalize() first")
        inboard: dict[BodyIndex, Joint] = {}
        for joint_index in plant.GetJointIndices():
            joint = plant.get_joint(joint_index)
            inboard[joint.child_body().index()] = joint

        chain: list[Joint] = []
        body = frame_E.body()
        while body.index() != plant.world_body().index():
            joint = inboard.get(body.index())
            if joint is None:
                problem = f"body {body.name()!r} is not connected to the world"
                raise InputError(name, "", problem, "weld the robot's base to the world")
            if not isinstance(joint, WeldJoint):
                if not isinstance(joint, RevoluteJoint | PrismaticJoint):
                    raise InputError(
                        name,
                        f"joint {joint.name()!r}",
                        f"type {joint.type_name()} between the world and {frame_E.name()!r}; "
                        "expected revolute, continuous, prismatic or fixed",
                        "lock it, or weld the base to the world",
                    )
                chain.append(joint)
            body = joint.parent_body()
        chain.reverse()
        if not chain:
            problem = f"no moving joint between the world and frame {frame_E.name()!r}"
            raise InputError(name, "", problem, "choose a frame at the arm's end")

        def anchor(frame: Frame) -> tuple[Joint | None, RigidTransform]:
            """The joint that moves a frame (None: the world), and the frame's pose in its frame."""
            X = frame.GetFixedPoseInBodyFrame()
            body = frame.body()
            while body.index() != plant.world_body().index():
                joint = inboard[body.index()]
                X = joint.frame_on_child().GetFixedPoseInBodyFrame().inverse() @ X
                if not isinstance(joint, WeldJoint):
                    return joint, X
                X = joint.frame_on_parent().GetFixedPoseInBodyFrame() @ joint.X_FM() @ X
                body = joint.parent_body()
            return None, X

        n = len(chain)
        position = {joint.index(): i for i, joint in enumerate(chain)}
        parameters = np.zeros((n, 10))
        for index in range(1, plant.num_bodies()):
            body = plant.get_body(BodyIndex(index))
            inertia = body.default_spatial_inertia()
            joint, X = anchor(body.body_frame())
            if joint is None:
                continue
            if joint.index() not in position:
                inner = joint
                while inner is not None and inner.index() not in position:
                    inner = anchor(inner.frame_on_parent())[0]
                if inner is None and joint.model_instance() != model_instance:
                    continue  # something else in the same plant: a workpiece
                raise InputError(
                    name,
                    f"joint {joint.name()!r}",
                    f"it moves, and is not between the world and {frame_E.name()!r}",
                    "lock it",
                )
            if inertia.get_mass() == 0.0:
                continue
            parameters[position[joint.index()]] += _moved_parameters(
                inertia.get_mass(),
                inertia.get_com(),
                inertia.CalcRotationalInertia().CopyToFullMatrix3(),
                X,
            )

        reflected_inertia = np.zeros(n)
        for actuator_index in plant.GetJointActuatorIndices():
            actuator = plant.get_joint_actuator(actuator_index)
            if actuator.joint().index() in position:
                i = position[actuator.joint().index()]
                reflected_inertia[i] = actuator.default_reflected_inertia()

        poses = [anchor(joint.frame_on_parent())[1] for joint in chain]
        axes = [
            joint.revolute_axis() if isinstance(joint, RevoluteJoint) else joint.translation_axis()
            for joint in chain
        ]
        _, X_LE = anchor(frame_E)
        enabled = plant.is_gravity_enabled(model_instance)
        return cls(
            joint_names=tuple(joint.name() for joint in chain),
            prismatic=np.array([isinstance(joint, PrismaticJoint) for joint in chain]),
            R_PJ=np.array([X.rotation().matrix() for X in poses]),
            p_PJ=np.array([X.translation() for X in poses]),
            axis=np.array(axes),
            inertial_parameters=parameters,
            reflected_inertia=reflected_inertia,
            gravity=plant.gravity_field().gravity_vector() if enabled else np.zeros(3),
            R_LE=X_LE.rotation().matrix(),
            p_LE=X_LE.translation(),
        )

    def with_inertial_parameters(
        self, inertial_parameters: ArrayLike, reflected_inertia: ArrayLike | None = None
    ) -> "SerialChain":
        """The same kinematics with other inertias: (n, 10), and (n,) or None for unchanged.

        The parameters need not be physically consistent: every kernel is linear in them.
        """
        reflected = self.reflected_inertia if reflected_inertia is None else reflected_inertia
        return replace(
            self,
            inertial_parameters=np.asarray(inertial_parameters, dtype=np.float64),
            reflected_inertia=np.asarray(reflected, dtype=np.float64),
        )

    def with_tool_frame(self, R_LE: ArrayLike, p_LE: ArrayLike) -> "SerialChain":
        """The same chain read at another E: (3, 3) and (3,) m in the last joint frame."""
        return replace(
            self,
            R_LE=np.asarray(R_LE, dtype=np.float64),
            p_LE=np.asarray(p_LE, dtype=np.float64),
        )

    def pose(self, q: ArrayLike) -> tuple[Array, Array]:
        """Pose of E in W: R_WE (..., 3, 3) and p_WE (..., 3) in m."""
        shape, rows = self._rows(q)
        R_WE = np.empty((len(rows[0]), 3, 3))
        p_WE = np.empty((len(rows[0]), 3))
        self._run(_pose_rows, _pose_batch, *rows, R_WE, p_WE)
        return R_WE.reshape(*shape, 3, 3), p_WE.reshape(*shape, 3)

    def jacobian(self, q: ArrayLike) -> Array:
        """Jacobian [angular; linear] of E in axes of W, (..., 6, n): V_WE = J v."""
        shape, rows = self._rows(q)
        J = np.empty((len(rows[0]), 6, self.num_joints))
        self._run(_jacobian_rows, _jacobian_batch, *rows, J)
        return J.reshape(*shape, 6, self.num_joints)

    def condition_number(self, q: ArrayLike) -> Array:
        """Condition number (...) of the Jacobian at q, which is not kept: for many samples."""
        shape, rows = self._rows(q)
        out = np.empty(len(rows[0]))
        self._run(_condition_number_rows, _condition_number_batch, *rows, out)
        return out.reshape(shape)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """M (..., n, n) in kg m^2, rotor inertia on its diagonal included."""
        shape, rows = self._rows(q)
        n = self.num_joints
        M = np.empty((len(rows[0]), n, n))
        self._run(_mass_matrix_rows, _mass_matrix_batch, *rows, M)
        return M.reshape(*shape, n, n)

    def momentum_terms(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array, Array]:
        """M v, C^T v and G in one pass; each (..., n)."""
        shape, rows = self._rows(q, v)
        momentum, CTv, G = (np.empty_like(rows[0]) for _ in range(3))
        self._run(_momentum_terms_rows, _momentum_terms_batch, *rows, momentum, CTv, G)
        n = self.num_joints
        return momentum.reshape(*shape, n), CTv.reshape(*shape, n), G.reshape(*shape, n)

    def momentum(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Generalized momentum M v (..., n) in kg m^2/s."""
        shape, rows = self._rows(q, v)
        momentum = np.empty_like(rows[0])
        self._run(_momentum_rows, _momentum_batch, *rows, momentum)
        return momentum.reshape(*shape, self.num_joints)

    def coriolis_transpose(self, q: ArrayLike, v: ArrayLike) -> Array:
        """C^T v (..., n) in N m: the gradient of the kinetic energy, d/dq (v^T M v / 2)."""
        shape, rows = self._rows(q, v)
        CTv = np.empty_like(rows[0])
        self._run(_coriolis_transpose_rows, _coriolis_transpose_batch, *rows, CTv)
        return CTv.reshape(*shape, self.num_joints)

    def coriolis(self, q: ArrayLike, v: ArrayLike) -> Array:
        """C v (..., n) in N m, Coriolis and centrifugal torque."""
        shape, rows = self._rows(q, v)
        Cv = np.empty_like(rows[0])
        self._run(_coriolis_rows, _coriolis_batch, *rows, Cv)
        return Cv.reshape(*shape, self.num_joints)

    def gravity_torque(self, q: ArrayLike) -> Array:
        """G (..., n) in N m: the torque that holds the arm (minus Drake's gravity forces)."""
        shape, rows = self._rows(q)
        G = np.empty_like(rows[0])
        self._run(_gravity_torque_rows, _gravity_torque_batch, *rows, G)
        return G.reshape(*shape, self.num_joints)

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, vdot: ArrayLike) -> Array:
        """M vdot + C v + G (..., n) in N m, rotor inertia included."""
        shape, rows = self._rows(q, v, vdot)
        tau = np.empty_like(rows[0])
        self._run(_inverse_dynamics_rows, _inverse_dynamics_batch, *rows, tau)
        return tau.reshape(*shape, self.num_joints)

    def kinetic_energy(self, q: ArrayLike, v: ArrayLike) -> Array:
        """v^T M v / 2 (...) in J, rotors' included."""
        shape, rows = self._rows(q, v)
        energy = np.empty(len(rows[0]))
        self._run(_kinetic_energy_rows, _kinetic_energy_batch, *rows, energy)
        return energy.reshape(shape)

    def regressor(self, q: ArrayLike, v: ArrayLike, vdot: ArrayLike) -> Array:
        """Y (..., n, 10 n) with Y @ inertial_parameters.ravel() = M vdot + C v + G less rotors.

        The rotors' part is reflected_inertia * vdot.
        """
        shape, rows = self._rows(q, v, vdot)
        n = self.num_joints
        Y = np.empty((len(rows[0]), n, 10 * n))
        self._run(_regressor_rows, _regressor_batch, *rows, Y)
        return Y.reshape(*shape, n, 10 * n)

    def terms(self, q: ArrayLike, v: ArrayLike) -> RigidBodyTerms:
        """Every term at one sample, q and v (n,), in one pass."""
        q = np.array(q, dtype=np.float64)
        v = np.array(v, dtype=np.float64)
        n = len(self.joint_names)
        if q.shape != (n,) or v.shape != (n,):
            raise ValueError(f"terms: q and v of shapes {q.shape} and {v.shape}, expected ({n},)")
        result = RigidBodyTerms(
            np.empty(n),
            np.empty(n),
            np.empty(n),
            np.empty(n),
            np.empty((n, n)),
            np.empty((6, n)),
            np.empty((3, 3)),
            np.empty(3),
            np.empty(6),
            q,
            v,
        )
        all_terms(
            self.table,
            q,
            v,
            result.momentum,
            result.CTv,
            result.Cv,
            result.G,
            result.M,
            result.J,
            result.R_WE,
            result.p_WE,
            result.V_WE,
            self._scratch,
        )
        return result

    def _rows(self, *signals: ArrayLike) -> tuple[tuple[int, ...], list[Array]]:
        """The leading shape, and each signal as a contiguous (N, n) array."""
        n = self.num_joints
        arrays = [np.asarray(signal, dtype=np.float64) for signal in signals]
        shape = arrays[0].shape
        for array in arrays:
            if array.ndim == 0 or array.shape[-1] != n or array.shape != shape:
                shapes = ", ".join(str(array.shape) for array in arrays)
                raise ValueError(
                    f"expected equal shapes (..., {n}), one column a joint; got {shapes}"
                )
        return shape[:-1], [np.ascontiguousarray(array).reshape(-1, n) for array in arrays]

    def _run(
        self, rows: Callable[..., None], batch: Callable[..., None], q: Array, *arrays: Array
    ) -> None:
        if len(q) < _PARALLEL_FROM:
            rows(self.table, q, *arrays, self._scratch)
        else:
            batch(self.table, q, *arrays)


def kernels_are_compiled(*kernels: Any) -> bool:
    """Whether the kernels run at once: compiled in this process, or a fresh copy on disk.

    False announces a wait of some seconds at the first call. Without arguments, this module's
    `all_terms` and `momentum_terms` over many samples.
    """
    return all(_is_compiled(kernel) for kernel in kernels or (all_terms, _momentum_terms_batch))


def _is_compiled(kernel: Any) -> bool:
    if kernel.signatures:
        return True
    function = kernel.py_func
    source = Path(function.__code__.co_filename)
    # numba's index file: <module>.<function>-<line>.<python>.nbi, beside or in a cache folder.
    pattern = f"{source.stem}.{function.__qualname__}-{function.__code__.co_firstlineno}.*.nbi"
    written = [file.stat().st_mtime for file in Path(kernel.stats.cache_path).glob(pattern)]
    return bool(written) and max(written) >= source.stat().st_mtime


def _moved_parameters(m: float, com: Array, inertia: Array, X: RigidTransform) -> Array:
    """Ten parameters in a frame where the body's frame has pose X, about that frame's origin."""
    R = X.rotation().matrix()
    p = X.translation()
    h = R @ (m * np.asarray(com))
    e = h + m * p
    rotated = R @ inertia @ R.T + (p @ e + p @ h) * np.eye(3) - np.outer(p, e) - np.outer(h, p)
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = rotated
    return np.array([m, *e, xx, xy, yy, xz, yz, zz])
