"""Has the tasks of jobs done by three nodes of Slurm on this machine, and loses one of them.

    python3 tools/faults/slurm.py target/release/drystone fixtures/town/town.obj

Nothing is installed: the packages are downloaded, unpacked into a temporary folder and laid over /usr for the processes of
this script alone, which have a network and process ids of their own. All jobs must give the bytes that one process gives.
Needs root, a Debian or Ubuntu whose lists of packages are up to date (`apt-get update`), `ip` and `unshare`; says so and
ends where Slurm cannot be had. Takes five minutes: Slurm waits for two before it runs the task of a lost node again.
"""

import argparse
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PACKAGES = ["slurmctld", "slurmd", "slurm-client", "slurm-wlm-basic-plugins", "munge"]
NODES = ["n1", "n2", "n3"]
LOST = NODES[1]
OPTIONS = ["--ratio", "0.2", "--cluster-faces", "2000", "--threads", "1", "--memory", "256MiB", "--quiet"]
START_SECONDS, PATIENCE_SECONDS = 60, 900
CONFIGURATION = """\
ClusterName=drystone
SlurmctldHost={host}(127.0.0.1)
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
ReturnToService=2
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/%n.log
SchedulerParameters=sched_interval=2,batch_sched_delay=0
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdTimeout=20
KillWait=5
JobRequeue=1
NodeName=n[1-3] NodeHostname={host} NodeAddr=127.0.0.1 Port=[17001-17003] CPUs=1 RealMemory=1000 State=UNKNOWN
PartitionName=all Nodes=n[1-3] Default=YES MaxTime=INFINITE State=UP
"""


class NoSlurm(Exception):
    """Slurm cannot be had here."""


def quietly(*command, **more):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, **more)
    if done.returncode != 0:
        raise NoSlurm(f"{command[0]}: {(done.stderr.strip().splitlines() or ['failed'])[-1]}")
    return done.stdout


def unpack(folder):
    """Downloads Slurm and what it needs, and unpacks all of it."""
    packages = folder / "packages"
    (packages / "partial").mkdir(parents=True)
    take = ["-y", "--no-install-recommends", "--download-only", "-o", f"Dir::Cache::archives={packages}"]
    quietly("apt-get", *take, "install", *PACKAGES)
    for package in packages.glob("*.deb"):
        quietly("dpkg", "-x", package, folder / "root")
    # Debian adds to the names of the daemons, and Slurm does not.
    for daemon in (folder / "root/usr/sbin").glob("*-wlm"):
        daemon.with_name(daemon.name.removesuffix("-wlm")).symlink_to(daemon.name)


def start(folder):
    """Starts the daemons, and waits until all nodes are idle."""
    # Slurm asks for addresses as of a machine with a network, not of one that has none but `lo`.
    for words in ["link set lo up", "link add e0 type veth", "addr add 10.78.0.1/24 dev e0", "link set e0 up"]:
        quietly("ip", *words.split())
    quietly("mount", "-t", "overlay", "overlay", "-o", f"lowerdir={folder}/root/usr:/usr", "/usr")
    (folder / "state").mkdir()
    configuration = folder / "slurm.conf"
    host = os.uname().nodename.split(".")[0]
    configuration.write_text(CONFIGURATION.format(host=host, folder=folder))
    os.environ["SLURM_CONF"] = str(configuration)
    key = folder / "munge.key"
    key.write_bytes(os.urandom(128))
    key.chmod(0o600)
    files = {"key-file": key, "socket": folder / "munge.socket"}
    files |= {f"{name}-file": folder / f"munge.{name}" for name in ("pid", "log", "seed")}
    quietly("munged", "--force", *[f"--{name}={path}" for name, path in files.items()])
    quietly("slurmctld")
    for node in NODES:
        (folder / f"spool-{node}").mkdir()
        quietly("slurmd", "-N", node)
    end = time.monotonic() + START_SECONDS
    while (states := nodes()) != ["idle"] * len(NODES):
        if time.monotonic() > end:
            raise NoSlurm(f"its nodes are not ready: {' '.join(states)}")
        time.sleep(0.5)


def nodes():
    """The states of all nodes; what is wrong, before the daemons answer."""
    try:
        return quietly("sinfo", "-h", "-N", "-o", "%t").split()
    except NoSlurm as error:
        return [str(error)]


def simplify(program, mesh, folder, *more):
    folder.mkdir()
    command = [program, "simplify", mesh, "-o", folder / "out.obj", *OPTIONS, *more]
    return subprocess.Popen(list(map(str, command)), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)


def contents(folder):
    """The bytes of all files below a folder, by name."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def lose(node):
    """Kills a node as soon as it has a task: its daemon, what watches over the task, and the task."""
    daemon = int((Path(os.environ["SLURM_CONF"]).parent / f"{node}.pid").read_text())
    end = time.monotonic() + START_SECONDS
    while len(victims := [daemon, *at_work(node)]) < 3:
        if time.monotonic() > end:
            raise AssertionError(f"{node} had no task")
        time.sleep(0.1)
    for victim in victims:
        os.kill(victim, signal.SIGKILL)


def at_work(node):
    """Processes of the tasks of a node."""
    jobs = quietly("squeue", "-h", "-w", node, "-t", "R", "-o", "%A").split()
    watchers = [f"slurmstepd: [{job}.".encode() for job in jobs]
    for process in Path("/proc").glob("[0-9]*"):
        try:
            name, variables = (process / "cmdline").read_bytes(), (process / "environ").read_bytes()
        except OSError:
            continue
        if name.startswith(tuple(watchers)) or f"SLURMD_NODENAME={node}\0".encode() in variables:
            yield int(process.name)


def run(program, mesh, folder):
    """Runs the cases; returns the number of faults."""
    assert simplify(program, mesh, folder / "alone").wait() == 0
    expected = contents(folder / "alone")
    script, slow, faults = folder / "task.sbatch", folder / "slow", 0
    # With the file, tasks take long enough to be met.
    task = f'exec {shlex.quote(str(program))} task "$1" --threads 1 --memory 256MiB --quiet'
    script.write_text(f'#!/bin/sh\n[ -e {shlex.quote(str(slow))} ] && sleep 5\n{task}\n')
    runner = f"sbatch --wait --requeue -o /dev/null --array=0-{{last}} {shlex.quote(str(script))} {{stage}}"
    for name in ["well", "lost"]:
        began = time.monotonic()
        if name == "lost":
            slow.touch()
        job = simplify(program, mesh, folder / name, "--tasks", "6", "--task-runner", runner)
        if name == "lost":
            lose(LOST)
            slow.unlink()
        code = job.wait(timeout=PATIENCE_SECONDS)
        is_same = code == 0 and contents(folder / name) == expected
        faults += not is_same
        outcome = "same bytes" if is_same else f"FAILED: exit code {code}, or other bytes"
        print(f"{name:10} {time.monotonic() - began:5.0f} s  {outcome}", flush=True)
    return faults


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--inside", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    program, mesh = arguments.program.resolve(), arguments.mesh.resolve()
    try:
        if arguments.inside:
            start(arguments.inside)
            sys.exit(run(program, mesh, arguments.inside) > 0)
        missing = [tool for tool in ("apt-get", "dpkg", "ip", "unshare") if shutil.which(tool) is None]
        if os.geteuid() != 0 or missing:
            raise NoSlurm(f"needs root and {', '.join(missing) or 'nothing else'}")
        with tempfile.TemporaryDirectory() as folder:
            unpack(Path(folder))
            # Daemons end with the processes of this command.
            apart = ["unshare", "--mount", "--net", "--pid", "--fork", "--kill-child", "--mount-proc"]
            again = [sys.executable, __file__, str(program), str(mesh), "--inside", folder]
            sys.exit(subprocess.run(apart + again).returncode)
    except NoSlurm as error:
        print(f"NOTE: no Slurm: {error}")


if __name__ == "__main__":
    main()
