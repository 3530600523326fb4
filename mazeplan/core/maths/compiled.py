"""Call a compiled function through its address, from compiled code that does not know it.

Numba compiles a solver that takes functions as arguments anew for each function, and cannot cache it between processes.
With Numba's first-class function values a solver can be cached, but unpacking them costs 28 us per function and call.
Therefore the solver gets addresses as plain integers, and calls the functions behind them. It is compiled once for all
models. A cached solver never contains a stale copy of a changed model.
"""

from __future__ import annotations

from typing import Any

from numba import njit, types
from numba.core import cgutils
from numba.core.typing.templates import signature as typing_signature
from numba.extending import intrinsic

INTEGER = types.int64
REAL = types.float64
VECTOR = types.float64[::1]
MATRIX = types.float64[:, ::1]
POINTER = types.CPointer(types.float64)  # numbers in a row; indexed as an array, without length or bounds

# arguments of njit. A wrapper for Python takes as long to compile as a small function; one for C is never used
KERNEL = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
CALLEE = {**KERNEL, "no_cpython_wrapper": True}  # of functions that only compiled code calls


def address_of(function: Any, signature: Any) -> int:
    """Address of a function made by `numba.njit`, compiled for the signature (or loaded from the cache).

    The caller must keep the function alive as long as the address is used. Raises TypeError for anything else.
    """
    if not hasattr(function, "get_compile_result"):
        raise TypeError(f"got {function!r}, expected a function compiled with numba.njit")
    result = function.get_compile_result(signature)
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def caller(signature: Any) -> Any:
    """A compiled function call(address, arguments) for functions of one signature; arguments is a tuple.

    Exceptions of the called function are passed on.
    """

    @intrinsic
    def through(typing_context, address, arguments):
        def code(context, builder, sig, values):
            pointer_type = context.call_conv.get_function_type(signature.return_type, signature.args).as_pointer()
            pointer = builder.inttoptr(values[0], pointer_type)
            unpacked = cgutils.unpack_tuple(builder, values[1], len(signature.args))
            status, result = context.call_conv.call_function(
                builder, pointer, signature.return_type, signature.args, unpacked
            )
            with cgutils.if_unlikely(builder, status.is_error):
                context.call_conv.return_status_propagate(builder, status)
            return result

        expected = typing_signature(signature.return_type, INTEGER, types.Tuple(signature.args))
        return expected, code

    return through


def _pointer_to(typing_context, array, index):
    """Pointer to the element at a flat index of a C-contiguous array of numbers, from compiled code.

    Each time a function passes an array on, Numba counts references. In a filter, that costs more than the arithmetic;
    a pointer costs nothing. The caller keeps the array alive and stays inside it."""

    def code(context, builder, sig, values):
        data = context.make_array(sig.args[0])(context, builder, values[0]).data
        return builder.gep(data, [values[1]])

    if not isinstance(array, types.Array) or array.layout != "C":
        return None
    return types.CPointer(array.dtype)(array, INTEGER), code


def _shifted(typing_context, pointer, count):
    """The pointer to the element that lies `count` further on."""

    def code(context, builder, sig, values):
        return builder.gep(values[0], [values[1]])

    return (pointer(pointer, INTEGER), code) if isinstance(pointer, types.CPointer) else None


pointer_to: Any = intrinsic(_pointer_to)
shifted: Any = intrinsic(_shifted)


@njit(**CALLEE)
def copy_into(to, source):
    """Copy the numbers of one array (N,) into another. It compiles seconds faster than `to[:] = source`, which is ready
    for arrays that overlap or are broadcast."""
    for i in range(len(to)):
        to[i] = source[i]
