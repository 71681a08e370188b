"""Cuts the power of a job at its calls that change files, and lets it go on with what the disk holds then.

    python3 tools/faults/power_cuts.py target/release/drystone fixtures/town/town.obj --cuts 2000

A run is recorded call by call, with the bytes it writes. From the calls before a cut follows what a disk must hold, and
what it may: bytes that were written since the file was last synced, and names that were made, changed or removed since
the folder was. Five disks are made for each cut:

- lost: nothing is there that was not synced, neither bytes nor names;
- names: all names are there, but of bytes only those that were synced; files have their length and are zero where
  nothing was synced (a journal of names only, like ext4 with data=writeback);
- bytes: all bytes are there, but names only as synced;
- early: as the names, and each folder's last change is missing (names kept in order);
- some: of unsynced blocks of 4 KiB, and of unsynced changes of names in order, so many as fall by chance.

The job goes on there by the same command and must have the bytes of an undisturbed run; what bears the result's name
before must be the older result or a whole one. After the last call, when the program has said that it is done, the
result must be there on every disk without going on.
"""

import argparse
import random
import sys
import tempfile
from pathlib import Path

from calls import OLDER, Job, spread

BLOCK = 4096
DISKS = ["lost", "names", "bytes", "early", "some"]


class File:
    """Bytes as the process sees them, and as they were last synced."""

    def __init__(self, content=b""):
        self.content, self.synced = bytearray(content), content

    def extend_to(self, length):
        """Zeros up to a length."""
        self.content.extend(bytes(max(0, length - len(self.content))))

    def on_disk(self, disk, chance):
        """What a disk holds of it."""
        if disk == "bytes":
            return bytes(self.content)
        if disk == "lost":
            return self.synced
        held = bytearray(self.synced[: len(self.content)].ljust(len(self.content), b"\0"))
        if disk == "some":
            for at in range(0, len(held), BLOCK):
                if chance.random() < 0.5:
                    held[at : at + BLOCK] = self.content[at : at + BLOCK]
        return bytes(held)


class Disk:
    """Files and folders below a root as calls change them."""

    def __init__(self, job):
        self.root = str(job.root)
        older = File(OLDER)
        # Names below each folder now; the changes since the folder was synced, in order; the names then.
        self.names = {self.root: {"out": None}, str(job.out): {"result.obj": older}}
        self.synced = {folder: dict(names) for folder, names in self.names.items()}
        self.changes = {folder: [] for folder in self.names}

    def change(self, folder, *edits):
        """Names of a folder come to stand for a file (None for a folder), or go, all at once."""
        self.changes[folder].append(edits)
        put(self.names[folder], edits)

    def apply(self, call):
        """Does what a call did."""
        folder, name = call.path.rsplit("/", 1)
        if call.operation == "sync" and call.path in self.names:
            self.synced[call.path] = dict(self.names[call.path])
            self.changes[call.path] = []
            return
        file = self.names[folder].get(name)
        if call.operation == "create":
            self.change(folder, (name, File(), True))
        elif call.operation == "folder":
            self.change(folder, (name, None, True))
            self.names[call.path], self.synced[call.path], self.changes[call.path] = {}, {}, []
        elif call.operation == "remove":
            self.change(folder, (name, None, False))
            self.names.pop(call.path, None)
        elif call.operation == "rename":
            other, new_name = call.target.rsplit("/", 1)
            assert other == folder, "names move within a folder only"
            self.change(folder, (new_name, file, True), (name, None, False))
        elif call.operation == "write":
            file.extend_to(call.offset)
            file.content[call.offset : call.offset + len(call.written)] = call.written
        elif call.operation == "truncate":
            file.extend_to(call.offset)
            del file.content[call.offset :]
        elif call.operation == "sync":
            file.synced = bytes(file.content)

    def survivors(self, folder, disk, chance):
        """Names of a folder that a disk holds."""
        held, changes = dict(self.synced[folder]), self.changes[folder]
        all_of_them = len(changes)
        some = chance.randint(0, all_of_them)
        count = {"lost": 0, "names": all_of_them, "bytes": 0, "early": max(0, all_of_them - 1), "some": some}[disk]
        for change in changes[:count]:
            put(held, change)
        return held

    def make(self, disk, chance):
        """Writes what such a disk holds after a power cut."""
        folders = [self.root]
        while folders:
            folder = folders.pop()
            for name, file in self.survivors(folder, disk, chance).items():
                path = Path(folder, name)
                if file is not None:
                    path.write_bytes(file.on_disk(disk, chance))
                elif str(path) in self.synced:
                    path.mkdir(exist_ok=True)
                    folders.append(str(path))


def put(names, edits):
    """Sets and removes names."""
    for name, file, exists in edits:
        if exists:
            names[name] = file
        else:
            names.pop(name, None)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=Path)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--cuts", type=int, default=200, help="cuts at most, each with one of the disks")
    parser.add_argument("--long", action="store_true", help="a job that syncs its work folder, too, as long ones do")
    arguments = parser.parse_args()
    chance = random.Random(1)
    with tempfile.TemporaryDirectory() as scratch:
        job = Job(scratch, arguments.binary, arguments.mesh, options=["--keep-work"] if arguments.long else [])
        calls = job.record()
        expected = job.digest()
        points = [(place, disk) for place in range(len(calls)) for disk in DISKS]
        chosen = spread(points, arguments.cuts - len(DISKS)) + [(len(calls), disk) for disk in DISKS]
        model, done, faults = Disk(job), 0, 0
        for place, disk in chosen:
            for call in calls[done:place]:
                model.apply(call)
            done = place
            job.empty()
            model.make(disk, chance)
            whole, finished = job.is_whole(expected), job.digest() == expected
            again = job.run()
            promised = finished or place < len(calls)
            if not whole or not promised or again.returncode != 0 or job.digest() != expected:
                faults += 1
                last = f"{calls[place - 1].operation} {calls[place - 1].path}" if place else "the beginning"
                told = again.stderr.strip()[-200:]
                print(f"{disk} after {last}: whole {whole}, finished {finished}, exit {again.returncode} {told}")
        print(f"{len(calls)} calls, {len(chosen)} power cuts, {faults} faults")
        return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
