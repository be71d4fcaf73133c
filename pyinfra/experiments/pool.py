"""Tasks on several processes through joblib: local ones, or those of a Ray or Dask cluster."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args

import joblib

from pyinfra.core.errors import Error

Task = TypeVar("Task")
Say = Callable[[str], None]  # is told in a line what is going on, also from the tasks' processes
Backend = Literal["local", "ray", "dask"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)
LOOPBACK = "127.0.0.1"  # a cluster that is started here runs what it is sent, by whomever


def silent(_: str) -> None:
    """Tells nobody."""


class NoGpu(Error):
    """A cluster was asked for what it does not have."""


@dataclass(frozen=True)
class Pool:
    """Where tasks run.

    address: of a cluster that is there; without it one is started that only this machine reaches.
    gpu: each task needs one; local tasks see to that themselves (gpus.py), a cluster sends them
    where GPUs are.
    """

    backend: Backend = "local"
    jobs: int = 1
    address: str = ""
    gpu: bool = False


@contextmanager
def workers(pool: Pool) -> Iterator[None]:
    """joblib's tasks inside run on the pool. Raises ImportError without the back-end's package."""
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
                    dashboard_address=f"{LOOPBACK}:0",  # its default is all of the machine's
                    **needs,
                )
                where = stack.enter_context(cluster)
            stack.enter_context(Client(where))
            stack.enter_context(joblib.parallel_config("dask", **needs))
            yield
    elif pool.backend == "ray":
        import ray
        from ray.util.joblib import register_ray

        register_ray()
        size: dict[str, Any]
        size = {"address": pool.address} if pool.address else {"num_cpus": pool.jobs}
        reach = contextlib.nullcontext() if pool.address else _on_loopback()
        with reach, ray.init(**size, include_dashboard=False):
            needs = {"ray_remote_args": {"num_gpus": _share(pool)}} if pool.gpu else {}
            with joblib.parallel_config("ray", n_jobs=pool.jobs, **needs):
                yield
    else:
        with (
            warnings.catch_warnings(),
            joblib.parallel_config("loky", n_jobs=pool.jobs, inner_max_num_threads=1),
        ):
            # Between tasks loky replaces a worker that has grown, as a training's does.
            warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
            yield


@contextmanager
def _on_loopback() -> Iterator[None]:
    """Ray started inside listens on the loopback address alone, as it does elsewhere than on Linux.

    It has no setting for that but this one, which it reads when it is imported; what it starts
    reads the environment.
    """
    from ray._private import ray_constants

    name, before = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", ray_constants.ENABLE_RAY_CLUSTER
    old = os.environ.get(name)
    os.environ[name], ray_constants.ENABLE_RAY_CLUSTER = "0", False
    try:
        yield
    finally:
        ray_constants.ENABLE_RAY_CLUSTER = before
        os.environ.pop(name)
        if old is not None:
            os.environ[name] = old


def _share(pool: Pool) -> float:
    """GPUs for each of Ray's workers: one, or less if there are more workers than GPUs."""
    import ray

    gpus = float(ray.cluster_resources().get("GPU", 0))
    if gpus == 0:
        raise NoGpu("device: found cuda, allowed cpu: the cluster has no GPU")
    return min(1.0, gpus / pool.jobs)


def call_all(call: Callable[[Task], Any], tasks: Sequence[Task], pool: Pool) -> None:
    """Calls each task once. Raises what a call raises, after those under way."""
    with workers(pool):
        joblib.Parallel(batch_size=1)(joblib.delayed(call)(task) for task in tasks)


def run(
    call: Callable[[Task], Any],
    tasks: Sequence[Task],
    pool: Pool,
    left: Callable[[Sequence[Task]], list[Task]],
    lost: Callable[[Task, Exception], None],
    say: Say = silent,
) -> None:
    """Calls each task once at least, also when workers die; `call` itself does not raise.

    left: those of the tasks that are not done. lost: is told of a task whose worker died although
    it ran alone.
    """
    groups = [list(tasks)]
    while groups:
        group = groups.pop(0)
        try:
            call_all(call, group, pool)
        except (ImportError, NoGpu):
            raise
        except Exception as error:
            rest = left(group)
            say(f"pyinfra: a worker died, {len(rest)} tasks left: {error!r}")
            if len(rest) < len(group):
                groups.append(rest)
            elif len(group) > 1:
                groups.extend([task] for task in rest)
            else:
                lost(group[0], error)
