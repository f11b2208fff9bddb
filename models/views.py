"""Two-dimensional views of flat memory, for kernels that name the parts of what they are given."""

from typing import Any

from numba.core import types
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic
from numba.np import arrayobj


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
