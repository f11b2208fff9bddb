"""What is used of numba, which has no types of its own: a kernel has the type of its function."""

from collections.abc import Callable
from typing import Any, TypeVar, overload

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])

prange = range

@overload
def njit(kernel: _Kernel) -> _Kernel: ...
@overload
def njit(
    *,
    cache: bool = ...,
    error_model: str = ...,
    parallel: bool = ...,
    inline: str = ...,
    forceinline: bool = ...,
    no_cfunc_wrapper: bool = ...,
) -> Callable[[_Kernel], _Kernel]: ...
def __getattr__(name: str) -> Any: ...
