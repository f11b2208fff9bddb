"""Arrays in one stretch of memory, for kernels that name the parts of what they are given."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numba.core import types
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic
from numba.np import arrayobj
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

Layout = NDArray[np.int64]  # (parts, 3): first entry, rows and columns of each


def joined(parts: Iterable[ArrayLike]) -> tuple[Array, Layout]:
    """One- and two-dimensional arrays, numbers too, as one: all entries, and where each lies."""
    arrays = [np.atleast_2d(np.asarray(part, float)) for part in parts]
    starts = np.cumsum([0] + [part.size for part in arrays]).tolist()
    layout = [[start, *part.shape] for start, part in zip(starts, arrays, strict=False)]
    return np.concatenate([part.ravel() for part in arrays]), np.array(layout, np.int64)


@intrinsic
def view_2d(context: Any, flat: Any, start: Any, rows: Any, columns: Any) -> Any:
    """A view (rows, columns) of flat[start : start + rows * columns], C-contiguous.

    As `.reshape` of that slice, at a tenth of its cost: nothing is checked.
    """
    kind = types.Array(flat.dtype, 2, "C")
    library: Any = arrayobj  # has no types

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, first, height, width = arguments
        source = library.make_array(signature.args[0])(context, builder, array)
        view = library.make_array(kind)(context, builder)
        size = context.get_constant(types.intp, context.get_abi_sizeof(source.data.type.pointee))
        library.populate_array(
            view,
            data=builder.gep(source.data, [first]),
            shape=[height, width],
            strides=[builder.mul(width, size), size],
            itemsize=size,
            meminfo=source.meminfo,
            parent=source.parent,
        )
        return impl_ret_borrowed(context, builder, kind, view._getvalue())

    return kind(flat, types.intp, types.intp, types.intp), code


@kernel(inline="always")
def part(values: Array, layout: Layout, k: int) -> Array:
    """One of the arrays that were `joined`, (rows, columns)."""
    array: Array = view_2d(values, layout[k, 0], layout[k, 1], layout[k, 2])
    return array


@kernel(inline="always")
def copy_to(target: Array, source: Array) -> None:
    """Copies (n,) numbers. numba's slices spend a second's compilation on an error's words."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@intrinsic
def copy_whole(context: Any, target: Any, source: Any) -> Any:
    """Copies a C-contiguous array into another of as many numbers; nothing is checked."""
    if target.layout != "C" or source.layout != "C" or target.dtype != source.dtype:
        return None

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        library: Any = arrayobj  # has no types
        into, whole = (
            library.make_array(kind)(context, builder, value)
            for kind, value in zip(signature.args, arguments, strict=True)
        )
        size = context.get_abi_sizeof(whole.data.type.pointee)
        library.cgutils.raw_memcpy(builder, into.data, whole.data, whole.nitems, size)
        return context.get_dummy_value()

    return types.void(target, source), code


@intrinsic
def read_only(context: Any, array: Any) -> Any:
    """The same array, typed as read-only.

    Drake's contexts give read-only arrays: a kernel that is called with such ones alone is compiled
    once.
    """
    kind = array.copy(readonly=True)

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return impl_ret_borrowed(context, builder, kind, arguments[0])

    return kind(array), code


@intrinsic
def plain(context: Any, field: Any) -> Any:
    """An array of a record, whose type holds its shape, as an array of any shape.

    What takes such arrays is compiled once for all numbers of joints, and for all other arrays.
    """
    kind = types.Array(field.dtype, field.ndim, "C")
    library: Any = arrayobj  # has no types

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source = library.make_array(field)(context, builder, value=arguments[0])
        view = library.make_array(kind)(context, builder)
        library.cgutils.copy_struct(view, source)
        return impl_ret_borrowed(context, builder, kind, view._getvalue())

    return kind(field), code


@intrinsic
def borrowed(context: Any, array: Any) -> Any:
    """The same array, for a kernel that hands many views of it on: their references, which cost
    more than the arithmetic of a joint, are not counted.

    Only of a kernel's own argument, which its caller holds until it returns: what the kernel makes
    itself would be let go of. No view may leave the kernel.
    """

    library: Any = arrayobj  # has no types

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        view = library.make_array(array)(context, builder, value=arguments[0])
        for name in ("meminfo", "parent"):
            setattr(view, name, library.cgutils.get_null_value(getattr(view, name).type))
        return view._getvalue()

    return array(array), code
