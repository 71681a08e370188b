"""Has tasks of a job done by the workers of a Dask cluster.

As the task runner of `drystone simplify`, which runs it once for each stage of the job:

    drystone simplify tiles/ -o out/city.obj --ratio 0.1 --work /shared/city.work \\
        --task-runner 'python -m drystone.dask tcp://head:8786 {stage} {count}'

Workers need the program, and the work folder at the same path. One worker for each machine, with one thread, is best: a
task uses all processors. A scheduler runs what anybody sends who reaches its port: use a private network, or TLS.
"""

import argparse
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from distributed import Client, Future

FINAL = frozenset({2, 4, 5, 7, 8})
"""Exit codes of tasks that fail on every worker."""
TRIES = 3
"""How often Dask hands out a task whose process was killed."""
LOOK_SECONDS = 0.5
"""Time between two looks at what the workers do."""
WORDS_MAX = 2000
"""Characters that are kept of what a task said."""


class TaskKilled(Exception):
    """A signal ended the process of a task: Dask hands it out again."""


class Ended(NamedTuple):
    """A task that ended with an exit code, and what it said."""

    task: int
    code: int
    words: str


def do_task(program: Sequence[str], stage: str, index: int, options: Sequence[str]) -> Ended:
    """Does a task on a worker, in a process of its own: if the system kills it for its memory, the worker lives."""
    program = program or (sys.executable, "-m", "drystone")
    command = [*program, "task", stage, str(index), "--quiet", *options]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    if done.returncode < 0 or done.returncode > 128:
        raise TaskKilled(f"task {index}: exit code {done.returncode}")
    return Ended(index, done.returncode, done.stderr.decode(errors="replace")[-WORDS_MAX:])


class Runner:
    """Has tasks of stages done by the workers of a client.

    `program`: the words that begin the command on a worker; by default its Python runs this package. `threads` and
    `memory` are those of `drystone task`. While workers idle, a task that takes `patience` times as long as the others
    is done by another worker, too: whichever ends first counts, and both write the same bytes.
    """

    def __init__(
        self,
        client: "Client",
        *,
        program: Sequence[str] = (),
        threads: int | None = None,
        memory: int | str | None = None,
        patience: float = 3.0,
    ) -> None:
        self.client = client
        self.program = tuple(program)
        self.patience = patience
        limits = {"--threads": threads, "--memory": memory}
        self.options = [word for name, limit in limits.items() if limit is not None for word in (name, str(limit))]

    def __call__(self, stage: str, count: int, is_stopped: Callable[[], bool] = lambda: False) -> list[Ended]:
        """Has the tasks of a stage done that have no results; returns those that failed for good.

        Ends early once `is_stopped` returns True.
        """
        run = _StageRun(self, stage)
        try:
            # `wait` asks for a current client.
            with self.client.as_current():
                return run.until_done(range(count), is_stopped)
        finally:
            self.client.cancel(list(run.pending), force=True)


class _StageRun:
    """A stage under way."""

    def __init__(self, runner: Runner, stage: str) -> None:
        self.runner = runner
        self.stage = stage
        self.pending: dict[Future, int] = {}
        self.began: dict[str, float] = {}
        self.seconds: list[float] = []
        self.copied: set[int] = set()
        # Keys of an earlier call must not give its results.
        self.name = f"drystone-{time.time_ns():x}"

    def until_done(self, indices: Iterable[int], is_stopped: Callable[[], bool]) -> list[Ended]:
        from distributed import wait

        for index in indices:
            self.submit(index)
        failed: list[Ended] = []
        while self.pending and not is_stopped():
            try:
                done = wait(list(self.pending), timeout=LOOK_SECONDS, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                done = set()
            failed += [ended for future in done for ended in self.take(future)]
            if any(ended.code in FINAL for ended in failed):
                break
            self.copy_late()
        return failed

    def submit(self, index: int, copy: int = 0) -> None:
        runner, key = self.runner, f"{self.name}-{index}-{copy}"
        future = runner.client.submit(
            do_task, runner.program, self.stage, index, runner.options, key=key, pure=False, retries=TRIES
        )
        self.pending[future] = index

    def take(self, future: "Future") -> list[Ended]:
        """Takes a task that ended; its copies are not waited for. Returns it if it failed."""
        index = self.pending.pop(future, None)
        if index is None:
            return []
        if future.key in self.began:
            self.seconds.append(time.monotonic() - self.began[future.key])
        others = [other for other, of in self.pending.items() if of == index]
        if future.status != "finished":
            # A copy may still succeed.
            return [] if others else [Ended(index, -1, str(future.exception()))]
        ended = Ended(*future.result())
        if ended.code != 0 and ended.code not in FINAL:
            # A copy may still succeed, where this worker sees no such stage, or its disk fails.
            return [] if others else [ended]
        for other in others:
            del self.pending[other]
        self.runner.client.cancel(others, force=True)
        return [] if ended.code == 0 else [ended]

    def copy_late(self) -> None:
        """Has tasks done a second time that take much longer than the others, if workers have nothing else to do."""
        processing: dict[str, Sequence[str]] = self.runner.client.processing()
        busy = {key for keys in processing.values() for key in keys}
        now = time.monotonic()
        for key in busy:
            self.began.setdefault(key, now)
        idle = sum(not keys for keys in processing.values())
        if not self.seconds or idle == 0:
            return
        late = self.runner.patience * max(statistics.median(self.seconds), LOOK_SECONDS)
        for future, index in list(self.pending.items()):
            if idle > 0 and index not in self.copied and now - self.began.get(future.key, now) > late:
                self.copied.add(index)
                self.submit(index, copy=1)
                idle -= 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a stage on the workers of a scheduler; returns the exit code of the first task that failed for good, else 0."""
    from distributed import Client, Security

    parser = argparse.ArgumentParser("python -m drystone.dask", description="Has tasks of a stage done by Dask workers.")
    parser.add_argument("scheduler", help="its address, such as tcp://head:8786")
    parser.add_argument("stage", help="the stage's file: {stage}")
    parser.add_argument("count", type=int, help="the number of its tasks: {count}")
    parser.add_argument("--program", nargs="+", default=(), help="command of drystone on the workers")
    parser.add_argument("--threads", type=int, help="threads of a task [default: one per processor]")
    parser.add_argument("--memory", help="memory of a task [default: half of the machine's]")
    parser.add_argument("--patience", type=float, default=3.0, help="times the usual after which a task is done twice")
    for name, what in [("ca", "certificate authority"), ("cert", "certificate"), ("key", "key")]:
        parser.add_argument(f"--tls-{name}", metavar="FILE", help=f"{what} of the TLS connection")
    given = parser.parse_args(arguments)
    security: Any = None
    if given.tls_ca or given.tls_cert:
        security = Security(
            tls_ca_file=given.tls_ca,
            tls_client_cert=given.tls_cert,
            tls_client_key=given.tls_key,
            require_encryption=True,
        )
    options = {"program": given.program, "threads": given.threads, "memory": given.memory, "patience": given.patience}
    with Client(given.scheduler, security=security, set_as_default=False) as client:
        failed = Runner(client, **options)(given.stage, given.count)
    for ended in failed:
        print(f"task {ended.task}: exit code {ended.code}: {ended.words.strip()}", file=sys.stderr)
    return next((ended.code for ended in failed if ended.code in FINAL), 1 if failed else 0)


if __name__ == "__main__":
    sys.exit(main())
