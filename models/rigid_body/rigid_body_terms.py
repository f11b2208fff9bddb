"""All terms of the equation of motion at one sample, in one record."""

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Record, record_type


@cache
def terms_type(num_joints: int) -> np.dtype[np.void]:
    """The record type of RigidBodyTerms, its fields one after another in memory."""
    n = num_joints
    return record_type(
        momentum=(n,),
        CTv=(n,),
        Cv=(n,),
        G=(n,),
        M=(n, n),
        J=(6, n),
        R_WE=(3, 3),
        p_WE=(3,),
        V_WE=(6,),
        q=(n,),
        v=(n,),
    )


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
        record: (1,) of `terms_type`; the attributes are views of it, made when first read. Its
            fields are those of one sample with a first axis, as `record["J"]` (1, 6, n).
    """

    if TYPE_CHECKING:
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

    def __init__(self, record: Record) -> None:
        self.record = record

    @classmethod
    def zeros(cls, num_joints: int) -> "RigidBodyTerms":
        """Terms that are all zero, to be written."""
        return cls(np.zeros(1, terms_type(num_joints)))

    @classmethod
    def at(cls, q: Array, v: Array) -> "RigidBodyTerms":
        """Terms that are zero but for q and v (n,), to be written."""
        n = len(q)
        kind = terms_type(n)
        entries = np.zeros(kind.itemsize // 8)
        entries[-2 * n : -n], entries[-n:] = q, v  # the last fields
        return cls(np.frombuffer(entries, kind))  # a fifth of the time that a view takes

    def are_at(self, q: Array, v: Array) -> bool:
        """Whether these are the terms of q and v (n,), to the last bit."""
        record = self.record
        is_at_q = bool(record["q"].tobytes() == q.tobytes())
        return is_at_q and bool(record["v"].tobytes() == v.tobytes())

    def __getattr__(self, name: str) -> Array:
        # A copy in the making has no record yet.
        if name == "record" or name not in (self.record.dtype.names or ()):
            raise AttributeError(name)
        field: Array = self.record[name][0]
        self.__dict__[name] = field
        return field

    def __reduce__(self) -> tuple[type["RigidBodyTerms"], tuple[Record]]:
        return RigidBodyTerms, (self.record,)  # a copy's attributes are views of its own record
