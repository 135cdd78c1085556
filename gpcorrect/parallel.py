"""Many independent calls: in this process, its threads, several, or on a Dask cluster; the results are the same.

Library code maps a function over items with :func:`each` and knows nothing of where it runs. Whoever starts a long job
says where with :func:`workers`; without it everything runs here, one call after the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version
from itertools import chain
from typing import Any, TypeVar

from joblib import Parallel, delayed, effective_n_jobs, parallel_config
from joblib.parallel import ThreadingBackend, get_active_backend

from gpcorrect.errors import DataError, GpCorrectError, MissingExtraError
from gpcorrect.types import Progress

Item = TypeVar("Item")
Result = TypeVar("Result")

PATIENCE = 10.0  # s for the scheduler to answer; chosen by hand: a network's answer takes milliseconds
CHUNKS = 4  # a worker, chosen by hand: few enough that shared data seldom travel, enough that a lost one costs little


class ClusterError(GpCorrectError):
    """A cluster that does not answer, lost its workers, or runs another version of this package."""


def each(
    function: Callable[[Item], Result], items: Iterable[Item], progress: Progress | None = None, stage: str = ""
) -> Iterator[Result]:
    """Yield `function(item)` of every item, in their order, reported to `progress` as `stage`.

    Parameters
    ----------
    function : callable
        Without side effects, of results that can be sent between processes; data that all calls share go into it
        with :func:`functools.partial`.
    items : iterable
        What differs between the calls: a random generator of its own where one is needed.
    progress, stage : see :class:`~gpcorrect.types.Progress`

    Raises
    ------
    ClusterError
        The cluster lost the work.
    """
    todo = list(items)
    # Neighbouring items go together, some chunks for each worker; one by one where there is one worker.
    jobs = effective_n_jobs()
    size = 1 if jobs == 1 else max(1, math.ceil(len(todo) / (CHUNKS * jobs)))
    chunks = [todo[k : k + size] for k in range(0, len(todo), size)]
    # The work has no name here: a traceback would keep it running beyond the context that it runs in.
    for done, result in enumerate(chain.from_iterable(_run(partial(_results, function), chunks, "generator")), start=1):
        if progress is not None:
            progress.step(stage, done / len(todo))
        yield result


def each_here(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return `function(item)` of every item: in threads where the context is of threads, else one after the other.

    For calls that are too short to be sent anywhere, and mostly compiled code that leaves the interpreter to others.

    Parameters
    ----------
    function, items : see :func:`each`
    """
    backend, jobs = get_active_backend()
    if not isinstance(backend, ThreadingBackend) or jobs == 1:
        return [function(item) for item in items]
    with ThreadPoolExecutor(effective_n_jobs(jobs)) as pool:  # joblib's costs 14 ms a call, more than many of these do
        return list(pool.map(function, items))


def each_as_done(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Yield `function(item)` of every item as soon as it is there, in any order; for long calls.

    Parameters
    ----------
    function, items : see :func:`each`
    """
    return _run(function, list(items), "generator_unordered")


@contextmanager
def workers(jobs: int = 1, scheduler: str | None = None, *, threads: bool = False) -> Iterator[None]:
    """Let :func:`each` run in `jobs` processes, or on the Dask cluster of a scheduler, inside this context.

    Parameters
    ----------
    jobs : int
        Processes of this machine; -1 for one a core.
    threads : bool
        Take threads for the processes.
    scheduler : str, optional
        Address such as "tcp://head:8786"; `jobs` is not looked at then.

    Raises
    ------
    DataError
        There is to be no job.
    MissingExtraError
        The library distributed is not installed.
    ClusterError
        The scheduler does not answer, has no workers, or they run another version of this package.
    """
    if jobs == 0:
        raise DataError("no job at all can do no work.", hint="Give --jobs a number from 1, or -1 for one a core.")
    if scheduler is not None:
        with _cluster(scheduler), parallel_config(backend="dask"):
            yield
    elif threads:
        with parallel_config(backend="threading", n_jobs=jobs):
            yield
    elif jobs != 1:
        with parallel_config(backend="loky", n_jobs=jobs, inner_max_num_threads=1):
            yield
    else:
        yield


@contextmanager
def _cluster(address: str) -> Iterator[None]:
    try:
        from distributed import Client
        from distributed.client import FutureCancelledError
        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise MissingExtraError("distributed", extra="cluster", purpose="Work on a Dask cluster") from error
    try:
        client: Any = Client(address, timeout=PATIENCE)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"no Dask scheduler answers at {address} ({error}).",
            hint=f"Start one with `dask scheduler`, and workers with `dask worker {address}`.",
        ) from error
    try:
        with client:
            _check_workers(client, address)
            yield
    except (KilledWorker, FutureCancelledError, CommClosedError) as error:
        raise ClusterError(
            f"the cluster {address} lost the work: {error}.", hint="Give the same command again."
        ) from error


def _check_workers(client: Any, address: str) -> None:
    """Refuse a cluster without workers, or whose workers would compute something else."""
    try:
        versions = client.run(_own_version)
    except ImportError as error:
        raise ClusterError(
            f"the workers of {address} lack this package: {error}.", hint="Install the same version there."
        ) from error
    if not versions:
        raise ClusterError(f"the cluster {address} has no workers.", hint=f"Start some: dask worker {address}")
    other = sorted({found for found in versions.values() if found != _own_version()})
    if other:
        raise ClusterError(
            f"the workers run version {', '.join(other)} of this package, here is {_own_version()}.",
            hint="Install the same version there: results would differ.",
        )


def _own_version() -> str:
    return version("gpcorrect")


def _results(function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    return [function(item) for item in items]


def _run(function: Callable[[Item], Result], items: Sequence[Item], return_as: str) -> Iterator[Result]:
    """Run calls wherever the context says; all data travel with the call, so that any worker can take it again."""
    calls = [partial(function, item) for item in items]
    if len(calls) < 2:
        yield from (call() for call in calls)
    else:
        yield from Parallel(return_as=return_as, batch_size=1)(delayed(call)() for call in calls)
