"""Fields of a record as arrays of any shape, for kernels."""

from typing import Any

from numba.core import types
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic
from numba.np import arrayobj


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
