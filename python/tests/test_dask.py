"""Jobs whose tasks the workers of a Dask cluster do: the same bytes, also if workers are killed or stop."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import drystone

distributed = pytest.importorskip("distributed")

from drystone.dask import Ended, Runner, do_task  # noqa: E402

LIMITS = {"threads": 1, "memory": "128MiB"}
OPTIONS = {"ratio": 0.5, "cluster_faces": 2000, "passes": 1}


def hills(path: Path, side: int = 220) -> Path:
    """An OBJ of `side` × `side` vertices: about 97,000 triangles."""
    lines = [f"v {x} {y} {((x * 37 + y * 61) % 97) / 97 + (x * y % 13) / 5:.3f}\n" for y in range(side) for x in range(side)]
    for y in range(side - 1):
        for x in range(side - 1):
            a = y * side + x + 1
            lines += [f"f {a} {a + 1} {a + side + 1}\n", f"f {a} {a + side + 1} {a + side}\n"]
    path.write_text("".join(lines))
    return path


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    return hills(tmp_path_factory.mktemp("mesh") / "hills.obj")


@pytest.fixture(scope="module")
def expected(mesh, tmp_path_factory):
    output = tmp_path_factory.mktemp("expected") / "out.obj"
    drystone.simplify(mesh, output, **OPTIONS, **LIMITS)
    return output.read_bytes()


@pytest.fixture
def cluster():
    # A worker that is silent is given up after some seconds.
    with distributed.LocalCluster(
        n_workers=3, threads_per_worker=1, processes=True, dashboard_address=None, worker_dashboard_address=None
    ) as cluster:
        yield cluster


def command(cluster) -> str:
    """The task runner for a cluster."""
    program = f"{sys.executable} -m drystone.dask {cluster.scheduler_address} {{stage}} {{count}}"
    return f"{program} --threads 1 --memory 128MiB"


def run(cluster, mesh: Path, output: Path) -> drystone.Report:
    return drystone.simplify(mesh, output, **OPTIONS, **LIMITS, task_runner=command(cluster), tasks=12)


def test_the_workers_of_a_cluster_write_the_same_bytes(cluster, mesh, expected, tmp_path):
    run(cluster, mesh, tmp_path / "out.obj")
    assert (tmp_path / "out.obj").read_bytes() == expected
    assert sorted(os.listdir(tmp_path)) == ["out.obj"]


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_worker_that_is_killed_or_stops_changes_nothing(cluster, mesh, expected, tmp_path, how):
    victims = [worker.pid for worker in cluster.workers.values()][:1]
    done = threading.Event()

    def strike():
        work = tmp_path / "out.obj.work"
        while not list(work.glob("stage-*/stage.bin")) and not done.is_set():
            time.sleep(0.01)
        for victim in victims:
            os.kill(victim, how)

    striking = threading.Thread(target=strike)
    striking.start()
    try:
        run(cluster, mesh, tmp_path / "out.obj")
    finally:
        done.set()
        striking.join()
        if how == signal.SIGSTOP:
            os.kill(victims[0], signal.SIGCONT)
    assert (tmp_path / "out.obj").read_bytes() == expected
    time.sleep(0.5)
    assert sorted(os.listdir(tmp_path)) == ["out.obj"], "a late worker wrote something"


def test_a_task_that_fails_on_every_worker_ends_the_job(cluster, mesh, tmp_path):
    runner = command(cluster) + " --program false"
    with pytest.raises(drystone.TaskError, match="task 0 of 12 tasks has no result after 2 tries"):
        drystone.simplify(
            mesh, tmp_path / "out.obj", **OPTIONS, **LIMITS, task_runner=runner, tasks=12, task_tries=2, force=True
        )


def test_a_client_of_ones_own_does_a_stage(cluster, tmp_path):
    failing = tmp_path / "program"
    failing.write_text("#!/bin/sh\necho no such mesh >&2\nexit 4\n")
    failing.chmod(0o755)
    with distributed.Client(cluster, set_as_default=False) as client:
        failed = Runner(client, program=[str(failing)])("stage.bin", 5)
        assert failed and all(ended.code == 4 and ended.words == "no such mesh\n" for ended in failed)
        assert Runner(client, program=["true"])("stage.bin", 5) == []


def test_a_runner_is_the_hands_of_a_job(cluster, mesh, expected, tmp_path):
    with distributed.Client(cluster, set_as_default=False) as client:
        runner = Runner(client, **LIMITS)
        drystone.simplify(mesh, tmp_path / "out.obj", **OPTIONS, **LIMITS, hands=runner, tasks=12)
    assert (tmp_path / "out.obj").read_bytes() == expected


def test_a_task_is_a_process():
    assert do_task(["true"], "stage.bin", 3, []) == Ended(3, 0, "")
    ended = do_task([], "/nowhere/stage.bin", 0, ["--threads", "1"])
    assert ended.code == 9, ended
    found = subprocess.run([sys.executable, "-m", "drystone.dask", "--help"], capture_output=True, text=True)
    assert found.returncode == 0 and "--tls-ca" in found.stdout
