"""Compilation, in one way for all of the core."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating]
Numbers = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Successors = npt.NDArray[np.uint32]
Times = npt.NDArray[np.int32]

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """The same function as machine code, which runs on the caller's thread and without the GIL.

    The first call compiles it, for a second or two; the result is kept on disk beside the source, or
    in the user's cache.
    """
    return cast("Function", numba.njit(cache=True, nogil=True, error_model="numpy")(function))
