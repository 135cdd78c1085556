"""One thread of linear algebra: of the many small factorisations here two BLAS pools, numpy's and scipy's, fight."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def on_one_thread(work: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Return the same work with one thread of linear algebra: on few cores two pools take up to ten times as long.

    Parameters
    ----------
    work : callable
    """

    @wraps(work)
    def limited(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        with threadpool_limits(limits=1):
            return work(*args, **kwargs)

    return limited
