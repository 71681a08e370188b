"""Kills a job at its system calls that change files, one job for each call, and lets it go on.

    python3 tools/faults/kill_at_calls.py target/release/drystone fixtures/town/town.obj --points 400

A run under strace lists the calls; then each of them (or so many, evenly spread) gets a job of its own that is killed as it
enters the call. Under its own name the result must then be absent or whole, and after the same command once more it
must have the bytes of an undisturbed run.
"""

import argparse
import hashlib
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

CALLS = "write,pwrite64,writev,rename,renameat,renameat2,fsync,fdatasync,ftruncate,unlink,unlinkat,mkdir,mkdirat,rmdir"


def digest(folder):
    """Of all files below a folder: their names and bytes; nothing if there are none."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    digests = [(str(path.relative_to(folder)), hashlib.sha256(path.read_bytes()).hexdigest()) for path in files]
    return digests or None


def fresh(folder):
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=Path)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--points", type=int, default=400, help="kills at most")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        out, work = folder / "out", folder / "work"
        command = [arguments.binary.resolve(), "simplify", arguments.mesh.resolve(), "-o", out / "result.obj", "--work", work]
        command += ["--ratio", "0.1", "--cluster-faces", "2000", "--memory", "256MiB", "--threads", "2", "--force", "--quiet"]
        command = list(map(str, command))

        def run(prefix=()):
            return subprocess.run([*prefix, *command], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)

        fresh(out)
        listing = folder / "calls"
        run(["strace", "-f", "-qq", "-o", str(listing), "-e", f"trace={CALLS}"]).check_returncode()
        expected = digest(out)
        counts = {}
        for line in listing.read_text(errors="replace").splitlines():
            found = re.match(r"\d+ +(\w+)\(", line)
            if found:
                counts[found[1]] = counts.get(found[1], 0) + 1
        points = [(call, place) for call, count in sorted(counts.items()) for place in range(1, count + 1)]
        step = max(1, len(points) / max(1, arguments.points))
        chosen = [points[int(i * step)] for i in range(min(len(points), arguments.points))]
        killed, faults = 0, 0
        for call, place in chosen:
            fresh(out)
            shutil.rmtree(work, ignore_errors=True)
            inject = ["-e", f"trace={call}", "-e", f"inject={call}:signal=KILL:when={place}"]
            killed += run(["strace", "-f", "-qq", "-o", "/dev/null", *inject]).returncode != 0
            result = out / "result.obj"
            partial = result.exists() and hashlib.sha256(result.read_bytes()).hexdigest() != dict(expected)["result.obj"]
            again = run()
            if partial or again.returncode != 0 or digest(out) != expected:
                faults += 1
                print(f"{call} {place}: partial {partial}, exit {again.returncode} {again.stderr.strip()[-200:]}")
        print(f"{len(points)} calls, {killed} jobs killed at {len(chosen)} of them, {faults} faults")
        return 1 if faults or not killed else 0


if __name__ == "__main__":
    sys.exit(main())
