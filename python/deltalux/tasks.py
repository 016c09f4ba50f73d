"""Tasks over any `concurrent.futures.Executor`: handed out, taken in as they end, done again where a worker is lost.

A task is a function of one argument, both of which can be sent to another process, and leaves the same whoever does it,
and however often: what it makes is put into its place whole.
"""

from __future__ import annotations

import multiprocessing
import signal
import warnings
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, TypeVar

from ._core import set_threads
from ._core import threads as used_threads
from .checks import count
from .mistakes import described

__all__ = ["checked_executor", "completed", "spawned"]

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")

_LOSSES = 3
"""Pools of our own that may break over the same tasks before something is wrong with these."""


def checked_executor(executor: Executor | None) -> Executor | None:
    """An executor, or None; TypeError of anything else."""
    if executor is None or isinstance(executor, Executor) or callable(getattr(executor, "submit", None)):
        return executor
    how = "concurrent.futures has some, and so has dask: client.get_executor()"
    raise TypeError(f"expected an executor to submit tasks to, got {described(executor)}; {how}")


def completed(
    function: Callable[[_Task], _Result], tasks: Sequence[_Task], executor: Executor | None
) -> Generator[tuple[int, _Result]]:
    """Does all tasks, and hands over the number of each with its result as it ends; without an executor, here.

    Who stops asking closes it, so that no task begins any more. A worker that dies costs its task. Dask gives that to
    another worker by itself. A pool of processes breaks with its worker: one of `spawned` is made anew, and what
    somebody else's has left undone is done here, with a warning.

    Parameters
    ----------
    function
        Of a module, so that other processes find it.
    tasks
        Its arguments.
    executor
        Who does it.

    Raises
    ------
    BrokenExecutor
        If workers keep dying over the same tasks.
    """
    losses, left = 0, dict(enumerate(tasks))
    while left and executor is not None:
        before = len(left)
        for number, result in _as_they_end(function, left, executor):
            del left[number]
            yield number, result
        if left and not isinstance(executor, _Spawned):
            warnings.warn(
                f"a worker died, and its pool with it: {len(left)} of {len(tasks)} tasks go on here", stacklevel=2
            )
            break
        losses = losses + 1 if len(left) == before else 0
        if left and isinstance(executor, _Spawned):
            if losses == _LOSSES:
                raise BrokenExecutor(f"workers keep dying over the same {len(left)} tasks; what is finished is kept")
            executor.renew()
    for number, task in left.items():
        yield number, function(task)


def _as_they_end(
    function: Callable[[_Task], _Result], tasks: Mapping[int, _Task], executor: Executor
) -> Iterator[tuple[int, _Result]]:
    """Tasks that end well, until all have ended or the executor is broken; what a task raises is raised."""
    running: dict[Future[_Result], int] = {}
    # Nobody takes from `tasks` before they are all handed out.
    try:
        for number, task in tasks.items():
            running[executor.submit(function, task)] = number
    except BrokenExecutor:
        pass  # What was handed out before may have ended well.
    try:
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                number = running.pop(future)
                try:
                    result = future.result()
                except BrokenExecutor:
                    continue
                yield number, result
    finally:
        # After a mistake, Ctrl-C, or where nobody asks on: what has not begun never does, what has is waited for.
        begun = [future for future in running if not future.cancel()]
        wait(begun)


class _Spawned(Executor):
    """Processes of our own, which take a new pool when theirs is broken."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._pool = self._made()

    def _made(self) -> ProcessPoolExecutor:
        # Each has its share of the processors.
        share = max(used_threads() // self._jobs, 1)
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._jobs, context, initializer=_begin, initargs=(share,))

    def renew(self) -> None:
        """After a worker has died."""
        self._pool.shutdown(cancel_futures=True)
        self._pool = self._made()

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **options: Any) -> Future[Any]:
        return self._pool.submit(function, *arguments, **options)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


def _begin(share: int) -> None:
    """What a process of ours does first."""
    # Ctrl-C reaches all processes of a terminal: the one that hands out tasks says what becomes of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_threads(share)


@contextmanager
def spawned(jobs: int) -> Iterator[Executor]:
    """So many processes on this machine, each with its share of the threads, until the end of the block."""
    if count("jobs", jobs) < 1:
        raise ValueError(f"expected at least one job, got {jobs}")
    pool = _Spawned(jobs)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)
