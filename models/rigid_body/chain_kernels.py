"""Rigid-body kernels of a serial chain: one sample at a time.

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
from typing import NamedTuple

from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import plain

# Columns of SerialChain.table, one row per joint; the last row holds E and gravity. The kernels
# spell the columns of vectors as numbers: 0-8 R_PJ row by row, 9-11 p_PJ, 12-14 axis, 15 prismatic
# or not, 16-25 inertial parameters, 26 reflected inertia; last row: R_LE, p_LE, gravity in 12-14.
# Where motors move several joints, n columns more: the rotors' part of M, row by row, and 26 is 0.
TABLE_COLUMNS = 32
PRISMATIC = 15
REFLECTED = 26

# Columns of the scratch array, one row per joint, everything in axes of W: 0-8 R_WJ, 9-11 p_WJ;
# then, about W's origin: 12-17 screw of the joint [angular; linear], 18-23 velocity of the body,
# 24 its mass, 25-27 first moment, 28-33 inertia (xx xy yy xz yz zz), 34-39 acceleration - gravity.
SCRATCH_COLUMNS = 40


@kernel
def place_links(table: Array, q: Array, scratch: Array) -> None:
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
        if table[i, PRISMATIC] != 0.0:
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


@kernel
def tool_pose(table: Array, scratch: Array, R_WE: Array, p_WE: Array) -> None:
    """Pose of E; needs place_links."""
    n = table.shape[0] - 1
    for r in range(3):
        x = scratch[n - 1, 3 * r]
        y = scratch[n - 1, 3 * r + 1]
        z = scratch[n - 1, 3 * r + 2]
        for c in range(3):
            R_WE[r, c] = x * table[n, c] + y * table[n, 3 + c] + z * table[n, 6 + c]
        p_WE[r] = scratch[n - 1, 9 + r] + (x * table[n, 9] + y * table[n, 10] + z * table[n, 11])


@kernel
def tool_jacobian(scratch: Array, p_WE: Array, J: Array) -> None:
    """Jacobian [angular; linear] at E; needs place_links and tool_pose."""
    x, y, z = p_WE[0], p_WE[1], p_WE[2]
    for i in range(J.shape[1]):
        sx, sy, sz = scratch[i, 12], scratch[i, 13], scratch[i, 14]
        J[0, i] = sx
        J[1, i] = sy
        J[2, i] = sz
        J[3, i] = scratch[i, 15] + (sy * z - sz * y)
        J[4, i] = scratch[i, 16] + (sz * x - sx * z)
        J[5, i] = scratch[i, 17] + (sx * y - sy * x)


@kernel
def place_inertia(table: Array, scratch: Array) -> None:
    """Inertia of every body about W's origin; needs place_links."""
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


@kernel
def times_inertia(
    scratch: Array, i: int, wx: float, wy: float, wz: float, vx: float, vy: float, vz: float
) -> tuple[float, float, float, float, float, float]:
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


@kernel
def link_velocities(v: Array, scratch: Array) -> None:
    """Spatial velocity of every body; needs place_links."""
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


@kernel
def momentum_and_forces(
    table: Array, v: Array, momentum: Array, CTv: Array, G: Array, scratch: Array
) -> None:
    """M v, C^T v and G; needs place_links, place_inertia and link_velocities."""
    n = v.shape[0]
    gx, gy, gz = table[n, 12], table[n, 13], table[n, 14]
    kx, ky, kz, lx, ly, lz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # H: angular, linear
    m, hx, hy, hz = 0.0, 0.0, 0.0, 0.0
    for j in range(n - 1, -1, -1):
        wx, wy, wz = scratch[j, 18], scratch[j, 19], scratch[j, 20]
        vx, vy, vz = scratch[j, 21], scratch[j, 22], scratch[j, 23]
        d0, d1, d2, d3, d4, d5 = times_inertia(scratch, j, wx, wy, wz, vx, vy, vz)
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
            + table[j, REFLECTED] * v[j]
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
    add_coupled_rotors(table, v, momentum)


@kernel
def add_coupled_rotors(table: Array, rate: Array, out: Array) -> None:
    """Adds the rotors' part of M times `rate` (n,), where motors move several joints."""
    if table.shape[1] == TABLE_COLUMNS:
        return
    for j in range(rate.shape[0]):
        for k in range(rate.shape[0]):
            out[j] += table[j, TABLE_COLUMNS + k] * rate[k]


@kernel
def gravity_terms(table: Array, G: Array, scratch: Array) -> None:
    """G; needs place_links only, since first moments need no inertia."""
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


@kernel
def composite_mass_matrix(table: Array, M: Array, scratch: Array) -> None:
    """M from the composite inertias; needs place_links and place_inertia."""
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
        M[j, j] += table[j, REFLECTED]
        for k in range(table.shape[1] - TABLE_COLUMNS):
            M[j, k] += table[j, TABLE_COLUMNS + k]


@kernel
def link_accelerations(
    v: Array, vdot: Array, gx: float, gy: float, gz: float, scratch: Array
) -> None:
    """Spatial acceleration of every body, minus gravity; needs link_velocities."""
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


@kernel
def newton_euler(table: Array, vdot: Array, tau: Array, scratch: Array) -> None:
    """Torques that cause the accelerations; needs place_inertia and link_accelerations.

    Of rotors that move several joints nothing: `add_coupled_rotors` adds it.
    """
    fx, fy, fz, lx, ly, lz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # moment about W's origin, force
    for j in range(tau.shape[0] - 1, -1, -1):
        wx, wy, wz = scratch[j, 18], scratch[j, 19], scratch[j, 20]
        vx, vy, vz = scratch[j, 21], scratch[j, 22], scratch[j, 23]
        ax, ay, az = scratch[j, 34], scratch[j, 35], scratch[j, 36]
        bx, by, bz = scratch[j, 37], scratch[j, 38], scratch[j, 39]
        k0, k1, k2, k3, k4, k5 = times_inertia(scratch, j, wx, wy, wz, vx, vy, vz)
        d0, d1, d2, d3, d4, d5 = times_inertia(scratch, j, ax, ay, az, bx, by, bz)
        fx += d0 + ((wy * k2 - wz * k1) + (vy * k5 - vz * k4))
        fy += d1 + ((wz * k0 - wx * k2) + (vz * k3 - vx * k5))
        fz += d2 + ((wx * k1 - wy * k0) + (vx * k4 - vy * k3))
        lx += d3 + (wy * k5 - wz * k4)
        ly += d4 + (wz * k3 - wx * k5)
        lz += d5 + (wx * k4 - wy * k3)
        tau[j] = (
            (scratch[j, 12] * fx + scratch[j, 13] * fy + scratch[j, 14] * fz)
            + (scratch[j, 15] * lx + scratch[j, 16] * ly + scratch[j, 17] * lz)
            + table[j, REFLECTED] * vdot[j]
        )


@kernel
def coriolis_torque(table: Array, v: Array, Cv: Array, scratch: Array) -> None:
    """C v; needs place_inertia and link_velocities."""
    for i in range(v.shape[0]):
        Cv[i] = 0.0  # stands in for vdot: every entry is read before it is written
    link_accelerations(v, Cv, 0.0, 0.0, 0.0, scratch)
    newton_euler(table, Cv, Cv, scratch)


@kernel
def inverse_dynamics_regressor(Y: Array, scratch: Array) -> None:
    """Regressor of the inertial parameters; needs link_accelerations.

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


@kernel
def observer_terms(
    table: Array,
    q: Array,
    v: Array,
    momentum: Array,
    CTv: Array,
    G: Array,
    J: Array,
    R_WE: Array,
    p_WE: Array,
    scratch: Array,
) -> None:
    """Writes the terms of a momentum observer and of a wrench reading, for other kernels.

    Args:
        table: SerialChain.table, (n + 1, TABLE_COLUMNS).
        q, v: (n,) joint positions and velocities.
        momentum, CTv, G, J, R_WE, p_WE: written; (n,), (n,), (n,), (6, n), (3, 3), (3,).
        scratch: written; (n, SCRATCH_COLUMNS).
    """
    place_links(table, q, scratch)
    place_inertia(table, scratch)
    link_velocities(v, scratch)
    momentum_and_forces(table, v, momentum, CTv, G, scratch)
    tool_pose(table, scratch, R_WE, p_WE)
    tool_jacobian(scratch, p_WE, J)


@kernel
def all_terms(table: Array, terms: Record, scratch: Array) -> None:
    """Writes all fields of RigidBodyTerms at the record's q and v.

    Args:
        table: SerialChain.table, (n + 1, TABLE_COLUMNS).
        terms: (1,) of `terms_type`; q and v are read.
        scratch: written; (n, SCRATCH_COLUMNS).
    """
    terms_row = terms[0]
    q, v, p_WE, V_WE = (
        plain(terms_row.q),
        plain(terms_row.v),
        plain(terms_row.p_WE),
        plain(terms_row.V_WE),
    )
    observer_terms(
        table,
        q,
        v,
        plain(terms_row.momentum),
        plain(terms_row.CTv),
        plain(terms_row.G),
        plain(terms_row.J),
        plain(terms_row.R_WE),
        p_WE,
        scratch,
    )
    composite_mass_matrix(table, plain(terms_row.M), scratch)
    coriolis_torque(table, v, plain(terms_row.Cv), scratch)
    n = q.shape[0]
    for i in range(3):
        V_WE[i] = scratch[n - 1, 18 + i]
    x, y, z = V_WE[0], V_WE[1], V_WE[2]
    V_WE[3] = scratch[n - 1, 21] + (y * p_WE[2] - z * p_WE[1])
    V_WE[4] = scratch[n - 1, 22] + (z * p_WE[0] - x * p_WE[2])
    V_WE[5] = scratch[n - 1, 23] + (x * p_WE[1] - y * p_WE[0])


class JointDynamics(NamedTuple):
    """The terms of the equation of motion at one sample.

    Attributes:
        M, Cv, G: (n, n) kg m^2, (n,) and (n,) N m, at q, v.
        q, v: (n,) rad, rad/s.
    """

    M: Array
    Cv: Array
    G: Array
    q: Array
    v: Array


@kernel
def dynamics_terms(table: Array, dynamics: JointDynamics, scratch: Array) -> None:
    """Writes only M, C v and G of one sample, bit by bit as `all_terms`.

    Args:
        table: SerialChain.table, (n + 1, TABLE_COLUMNS).
        dynamics: q and v are read, the other terms are written.
        scratch: written; (n, SCRATCH_COLUMNS). It then serves `tool_pose` and `tool_jacobian`.
    """
    q, v, G = dynamics.q, dynamics.v, dynamics.G
    place_links(table, q, scratch)
    place_inertia(table, scratch)
    link_velocities(v, scratch)
    n = v.shape[0]
    gx, gy, gz = table[n, 12], table[n, 13], table[n, 14]
    m, hx, hy, hz = 0.0, 0.0, 0.0, 0.0
    for j in range(n - 1, -1, -1):
        m += scratch[j, 24]
        hx += scratch[j, 25]
        hy += scratch[j, 26]
        hz += scratch[j, 27]
        G[j] = -(
            scratch[j, 12] * (hy * gz - hz * gy)
            + scratch[j, 13] * (hz * gx - hx * gz)
            + scratch[j, 14] * (hx * gy - hy * gx)
            + m * (scratch[j, 15] * gx + scratch[j, 16] * gy + scratch[j, 17] * gz)
        )
    composite_mass_matrix(table, dynamics.M, scratch)
    coriolis_torque(table, v, dynamics.Cv, scratch)


@kernel
def pose_and_jacobian(
    table: Array, q: Array, R_WE: Array, p_WE: Array, J: Array, scratch: Array
) -> None:
    """Pose of E in W and Jacobian [angular; linear] of one sample, for other kernels.

    Args:
        table: SerialChain.table, (n + 1, TABLE_COLUMNS).
        q: (n,) joint positions.
        R_WE, p_WE, J: written; (3, 3), (3,), (6, n).
        scratch: written; (n, SCRATCH_COLUMNS).
    """
    place_links(table, q, scratch)
    tool_pose(table, scratch, R_WE, p_WE)
    tool_jacobian(scratch, p_WE, J)
