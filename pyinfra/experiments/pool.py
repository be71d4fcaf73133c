"""Runs tasks through joblib in several processes, local or in a Dask cluster."""

import contextlib
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args

import joblib
from joblib.externals import loky

Task = TypeVar("Task")
# Callback for lines of progress; worker processes call it too.
Progress = Callable[[str], None]
Backend = Literal["local", "dask"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)
# A cluster of this module listens on LOOPBACK only, because a cluster runs code of any sender.
LOOPBACK = "127.0.0.1"


def silent(_: str) -> None:
    """Discards the line."""


@dataclass(frozen=True)
class Pool:
    """The processes in which tasks run.

    address: address of a running cluster. If it is empty, a cluster is started that accepts
    connections from this machine only.
    gpu: whether each task needs a GPU. Local tasks reserve a GPU themselves (gpus.py). A cluster
    schedules tasks on nodes with GPUs.
    """

    backend: Backend = "local"
    jobs: int = 1
    address: str = ""
    gpu: bool = False


@contextmanager
def workers(pool: Pool) -> Iterator[None]:
    """Context manager in which joblib runs its tasks on the pool.

    Raises ImportError if the package of the back-end is not installed.
    """
    if pool.backend == "dask":
        from dask.distributed import Client, LocalCluster

        needs: dict[str, Any] = {"resources": {"GPU": 1}} if pool.gpu else {}
        with contextlib.ExitStack() as stack:
            where: Any = pool.address
            if not where:
                cluster = LocalCluster(
                    n_workers=pool.jobs,
                    threads_per_worker=1,
                    host=LOOPBACK,
                    dashboard_address=f"{LOOPBACK}:0",  # by default Dask listens on all interfaces
                    **needs,
                )
                where = stack.enter_context(cluster)
            stack.enter_context(Client(where))
            stack.enter_context(joblib.parallel_config("dask", **needs))
            yield
    else:
        with (
            warnings.catch_warnings(),
            joblib.parallel_config("loky", n_jobs=pool.jobs, inner_max_num_threads=1),
        ):
            # During a training the memory of a worker grows. loky then replaces the worker and
            # issues a warning.
            warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
            yield


def call_all(call: Callable[[Task], Any], tasks: Sequence[Task], pool: Pool) -> None:
    """Calls `call` once for each task. Raises the exception of a failed call."""
    with workers(pool), stopped_by_interrupt():
        joblib.Parallel(batch_size=1)(joblib.delayed(call)(task) for task in tasks)


@contextmanager
def stopped_by_interrupt() -> Iterator[None]:
    """Context manager in which Ctrl-C ends loky's local processes without messages from them.

    A terminal sends Ctrl-C to all processes. A worker that is interrupted while it starts prints a
    traceback and leaves a semaphore, which is reported as leaked. Workers are therefore started
    with the signal ignored, and this process ends them.
    """
    kind = loky.process_executor.ProcessPoolExecutor
    start_processes = kind._adjust_process_count

    def start_ignoring(executor: Any) -> None:
        if threading.current_thread() is not threading.main_thread():
            start_processes(executor)  # signal handlers can be set only in the main thread
            return
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            start_processes(executor)
        finally:
            signal.signal(signal.SIGINT, before)

    kind._adjust_process_count = start_ignoring
    try:
        yield
    except KeyboardInterrupt:
        executor = loky.reusable_executor._executor  # None if no local worker processes run
        if executor is not None:
            executor.shutdown(wait=True, kill_workers=True)
        raise
    finally:
        kind._adjust_process_count = start_processes


def run(
    call: Callable[[Task], Any],
    tasks: Sequence[Task],
    pool: Pool,
    left: Callable[[Sequence[Task]], list[Task]],
    lost: Callable[[Task, Exception], None],
    progress: Progress = silent,
) -> None:
    """Calls `call` at least once for each task, and repeats tasks whose worker process died.

    `call` itself must not raise. left: returns the given tasks that are not done. If a worker dies
    while only one task runs, `lost` is called with this task and the error, and the task is not
    repeated.
    """
    groups = [list(tasks)]
    while groups:
        group = groups.pop(0)
        try:
            call_all(call, group, pool)
        except ImportError:
            raise
        except Exception as error:
            rest = left(group)
            progress(f"pyinfra: a worker stopped, {len(rest)} tasks are left: {error!r}")
            if len(rest) < len(group):
                groups.append(rest)
            elif len(group) > 1:
                groups.extend([task] for task in rest)
            else:
                lost(group[0], error)
