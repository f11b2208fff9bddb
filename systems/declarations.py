"""Declarations that blocks share: named parameters, cache entries, ports that split one vector."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    CacheEntry,
    Context,
    DependencyTicket,
    InputPort,
    LeafSystem,
    NumericParameterIndex,
    OutputPort,
    ValueProducer,
)

from wrenchsight.models.estimation.torque_error_stage import ERROR_ROWS
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.finite import LARGEST_INPUT, all_below
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms, terms_type
from wrenchsight.systems.sampled_block import SampledBlock

MIN_POLE = 1e-6  # 1/s; an observer with a slower one settles in days


def torque_error_size(num_joints: int) -> int:
    """Entries of a port that carries a `TorqueError` of one sample, flat."""
    return ERROR_ROWS * num_joints


OBSERVED_WRENCH_SIZE = 42
"""Entries of a port that carries an ObservedWrench, flat."""


class ObservedWrench(NamedTuple):
    """The wrench that an observer reads itself.

    Attributes:
        wrench: (6,) F_E_W, N m and N.
        covariance: (6, 6) of it.
    """

    wrench: Array
    covariance: Array

    @classmethod
    def of_flat(cls, flat: Array) -> "ObservedWrench":
        """That of (OBSERVED_WRENCH_SIZE,) memory, as of a port; views of it."""
        return cls(wrench=flat[:6], covariance=flat[6:OBSERVED_WRENCH_SIZE].reshape(6, 6))


def sliding_size(num_joints: int) -> int:
    """Entries of a port that carries a `SlidingLaw`, flat."""
    return len(SlidingLaw._fields) * num_joints


class ObserverLag(NamedTuple):
    """What a port `pole` says.

    Attributes:
        K_0: (n,) 1/s of the observer; None: it has no such lag.
        is_usable: whether all joints have a pole of MIN_POLE or more, or none has one.
    """

    K_0: Array | None
    is_usable: bool

    @classmethod
    def of(cls, pole: Array) -> "ObserverLag":
        """Of poles (n,) in 1/s; negative ones where the observer has none."""
        has_lag = bool((pole >= MIN_POLE).all()) and all_below(pole, LARGEST_INPUT)
        return cls(pole if has_lag else None, has_lag or bool((pole < 0.0).all()))


def checked_effort_limit(effort_limit: ArrayLike, num_joints: int, block: str) -> Array:
    """A copy (n,) of effort limits, N m, all of them positive; inf for none.

    Args:
        effort_limit: (n,).
        num_joints: n, of the friction law, which compiled kernels read unchecked.
        block: of which the error line speaks.

    Raises:
        InputError: one is not positive, or there is not one a joint.
    """
    limit = np.array(effort_limit, dtype=np.float64)
    if limit.shape != (num_joints,) or not np.all(limit > 0.0):  # NaN neither
        problem = f"{limit.tolist()}, expected {num_joints} above 0, N m, one a joint of friction"
        raise InputError(block, "effort_limit", problem)
    return limit


def terms_at(port: InputPort, context: Context, num_joints: int) -> RigidBodyTerms:
    """What an abstract port `terms` carries, checked: compiled kernels read it unchecked.

    Args:
        port: of a block.
        context: of that block.
        num_joints: of the arm that the block is of.

    Raises:
        ValueError: it carries something else, or terms of an arm of another number of joints.
    """
    terms = port.Eval(context)
    if not isinstance(terms, RigidBodyTerms):
        found = type(terms).__name__
    elif terms.record.dtype != terms_type(num_joints):
        found = f"those of {terms.record['q'].shape[-1]} joints"
    else:
        return terms
    block = port.get_system().GetSystemPathname()
    raise ValueError(f"{block}: terms must be of {num_joints} joints, and are {found}")


class TunedParameters:
    """The numeric parameters of a block: declared here, and to be changed in a run.

    Args:
        block: whose they are.
        values: their defaults by name, of any shape. A Context holds each flat, row by row, in the
            order in which they are given.

    Attributes:
        indices: of the Context's numeric parameters, by name.
        tickets: of them all; of nothing where there are none.
    """

    def __init__(self, block: LeafSystem, values: Mapping[str, Array]) -> None:
        self._shapes = {name: value.shape for name, value in values.items()}
        # pydrake returns a plain number, and takes none for a ticket.
        self.indices = {
            name: NumericParameterIndex(block.DeclareNumericParameter(BasicVector(value.ravel())))
            for name, value in values.items()
        }
        tickets = {block.numeric_parameter_ticket(index) for index in self.indices.values()}
        self.tickets: set[DependencyTicket] = tickets or {block.nothing_ticket()}

    def at(self, context: Context) -> dict[str, Array]:
        """The parameters of a context by name, in the order and shapes of `values`, copied."""
        return {
            name: np.array(context.get_numeric_parameter(index).value()).reshape(self._shapes[name])
            for name, index in self.indices.items()
        }


def declare_cached(
    block: LeafSystem,
    name: str,
    calc: Callable[[Context], Any],
    tickets: set[DependencyTicket],
) -> CacheEntry:
    """Declares a cache entry that holds what `calc` returns.

    Drake calls `calc` again when one of `tickets` has changed. The value is
    `EvalAbstract(context).get_value()` of the entry.
    """

    def write(context: Context, value: Value) -> None:
        value.set_value(calc(context))

    producer = ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=write)
    return block.DeclareCacheEntry(name, producer, tickets)


def joined_ticket(block: LeafSystem, tickets: set[DependencyTicket]) -> set[DependencyTicket]:
    """One prerequisite in the place of several, for ports that share them.

    When a value changes, Drake notifies all that depends on it, along each edge from a prerequisite
    to a port. Five ports with ten prerequisites have 50 edges, and with this one between them 15.
    It is the ticket of a cache entry that is never computed.
    """
    return {declare_cached(block, "joined prerequisites", lambda context: None, tickets).ticket()}


def declare_outputs(
    block: LeafSystem,
    sizes: Mapping[str, int],
    calc: Callable[[Context, BasicVector], None],
    tickets: set[DependencyTicket],
) -> OutputPort:
    """Declares the output ports of a block that computes all of them at once.

    These are a port for each output, and one port `all` with the outputs one after another. Each
    port that is read takes a call into Python at a tick: a diagram that reads several connects
    `all` instead, which Drake's Demultiplexer splits (`diagrams.outputs.split_outputs`).

    Args:
        block: that gets the ports.
        sizes: numbers of entries of the outputs, by name, in their order in `all`.
        calc: writes `all`.
        tickets: prerequisites of `all`, and of its parts: each reads the whole.

    Returns:
        The port `all`.
    """
    # One ticket that is out of date when any of them is: Drake follows fewer edges.
    joined = joined_ticket(block, tickets)
    port = block.DeclareVectorOutputPort("all", sum(sizes.values()), calc, joined)
    # A part copies its entries of `all`, whose value Drake keeps: `calc` is called once.
    declare_port_of_each_part(block, port.Eval, sizes, joined)
    return port


def declare_held_outputs(
    block: SampledBlock,
    sizes: Mapping[str, int],
    calc: Callable[[Context, BasicVector], None],
    tickets: set[DependencyTicket],
    whole_name: str = "all",
) -> OutputPort:
    """As `declare_outputs`, but computed at a tick and held until the next one.

    `all` is one held output (`SampledBlock.declare_held_output`): `take_sample` returns it whole.
    The other ports are parts of it, and so depend on time and memory as well.

    Args:
        block, sizes, calc: as `declare_outputs`.
        tickets: as there; time and memory are added here.
        whole_name: of the port with all outputs, in the place of `all`.
    """
    joined = joined_ticket(block, tickets | block.time_and_memory_tickets)
    port = block.declare_held_output(whole_name, sum(sizes.values()), calc, joined)
    declare_port_of_each_part(block, port.Eval, sizes, joined)
    return port


def parts_of(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Where consecutive parts of a vector stand, by name, from its first entry on."""
    ends = np.cumsum(list(sizes.values())).tolist()
    return {
        name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)
    }


def declare_port_of_each_part(
    block: LeafSystem,
    read_vector: Callable[[Context], Array],
    sizes: Mapping[str, int],
    tickets: set[DependencyTicket],
) -> None:
    """Declares output ports that are consecutive parts of one vector.

    Args:
        block: that gets the ports.
        read_vector: returns the whole vector of a context.
        sizes: of the parts, by the names of their ports, from the vector's first entry on.
        tickets: prerequisites of the vector.
    """
    for name, part in parts_of(sizes).items():

        def write(context: Context, output: BasicVector, part: slice = part) -> None:
            output.SetFromVector(read_vector(context)[part])

        block.DeclareVectorOutputPort(name, sizes[name], write, tickets)
