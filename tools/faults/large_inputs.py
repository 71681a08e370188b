"""Gives the program files of ten megabytes that no exporter should write, and looks whether it stays quick, small and polite.

    python3 tools/faults/large_inputs.py target/release/drystone [NAME...]

Each file must be read or refused within the time and the memory, without a panic; who is refused gets a short message and
no result. One line a file: exit code, seconds of processor time, peak memory.
"""

import argparse
import math
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from multiprocessing import Process
from pathlib import Path

SIZE = 10_000_000
SECONDS = 10
# The program's budget is 256 MiB; the rest is its code.
PEAK_BYTES = 300 << 20
MESSAGE_BYTES = 20_000
TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def repeated(make):
    """Numbered lines up to the size."""
    parts, size, i = [], 0, 0
    while size < SIZE:
        parts.append(make(i))
        size += len(parts[-1])
        i += 1
    return b"".join(parts)


def noise():
    return random.Random(1).randbytes(SIZE)


def grid(i):
    """The i-th strip of two triangles, with its own vertices."""
    return b"v %d 0 0\nv %d 1 0\nv %d 0 1\nv %d 1 1\nf -4 -3 -2\nf -3 -1 -2\n" % (i, i, i, i)


def polygons(corners, order):
    """Faces of these corners, again and again, in this order."""
    vertices = b"".join(b"v %.3f %.3f 0\n" % corner for corner in corners)
    face = b"f " + b" ".join(b"%d" % (i + 1) for i in order) + b"\n"
    return vertices + face * max(1, (SIZE - len(vertices)) // len(face))


def scattered(count):
    chance = random.Random(2)
    return [(100 * chance.random(), 100 * chance.random()) for _ in range(count)]


def spiral(count):
    arm = [[(radius + 0.1 * i, 0.2 * i) for i in range(count // 2)] for radius in (1.0, 1.3)]
    return [(radius * math.cos(angle), radius * math.sin(angle)) for radius, angle in arm[0] + arm[1][::-1]]


def spelling(i, bits):
    """A path that leads nowhere, another one for each number."""
    return b"".join(b"de"[i >> bit & 1 :][:1] + b"/../" for bit in range(bits))


SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]

CASES = {
    # Text that is none.
    "random_bytes": lambda: {"a.obj": noise()},
    "zeros": lambda: {"a.obj": bytes(SIZE)},
    "blanks": lambda: {"a.obj": b" " * SIZE},
    "line_feeds": lambda: {"a.obj": b"\n" * SIZE},
    "carriage_returns": lambda: {"a.obj": repeated(grid).replace(b"\n", b"\r")},
    "utf_16": lambda: {"a.obj": repeated(grid)[: SIZE // 2].decode().encode("utf-16")},
    "random_after_a_good_start": lambda: {"a.obj": repeated(grid)[: SIZE // 2] + noise()[: SIZE // 2]},
    "cut_within_a_face": lambda: {"a.obj": repeated(grid)[: SIZE - 3]},
    # Lines without an end.
    "one_line_of_v": lambda: {"a.obj": b"v" + b" 1.5" * (SIZE // 4)},
    "one_face_of_a_million_corners": lambda: {
        "a.obj": repeated(lambda i: b"v %d %d 0\n" % (i % 1000, i // 1000))[: SIZE // 2].rpartition(b"\n")[0]
        + b"\nf" + b"".join(b" %d" % (1 + i % 300_000) for i in range(700_000))},
    "one_comment": lambda: {"a.obj": TRIANGLE + b"f 1 2 3\n#" + b"x" * SIZE},
    "continued_for_ever": lambda: {"a.obj": TRIANGLE + b"f 1 2 3" + b" \\\n" * (SIZE // 3)},
    "numbers_of_a_thousand_digits": lambda: {"a.obj": repeated(lambda i: b"v 0.%s 1 2\n" % (b"7" * 1000))},
    "one_number_of_ten_million_digits": lambda: {"a.obj": b"v 1" + b"0" * SIZE + b" 1 2\n"},
    "huge_exponents": lambda: {"a.obj": repeated(lambda i: b"v 1e%d 1e-%d 0\n" % (i, i))},
    "one_name": lambda: {"a.obj": TRIANGLE + b"usemtl " + b"n" * SIZE + b"\nf 1 2 3\n"},
    # Many of what there are few of.
    "a_material_a_face": lambda: {"a.obj": TRIANGLE + repeated(lambda i: b"usemtl m%d\nf 1 2 3\n" % i)},
    "a_group_a_face": lambda: {"a.obj": TRIANGLE + repeated(lambda i: b"g a%d b%d\nf 1 2 3\n" % (i, i))},
    "an_object_a_face": lambda: {"a.obj": TRIANGLE + repeated(lambda i: b"o %d\nf 1 2 3\n" % i)},
    "a_material_and_group_a_face": lambda: {
        "a.obj": TRIANGLE + repeated(lambda i: b"usemtl m%d\ng g%d\ns %d\nf 1 2 3\n" % (i % 3000, i % 3001, i % 3002))},
    "a_library_a_line": lambda: {"a.obj": TRIANGLE + b"f 1 2 3\n" + repeated(lambda i: b"mtllib m%d.mtl\n" % i)},
    "the_same_library_again": lambda: {"a.obj": TRIANGLE + b"f 1 2 3\n" + repeated(lambda i: b"mtllib a.mtl\n"),
                                       "a.mtl": b"newmtl a\nKd 1 1 1\n"},
    "a_line_of_libraries": lambda: {
        "a.obj": b"mtllib" + repeated(lambda i: b" m%d" % i) + b"\n" + TRIANGLE + b"f 1 2 3\n"},
    "a_library_by_many_names": lambda: {
        "a.obj": TRIANGLE + b"".join(b"mtllib " + b"x/../" * i + b"a.mtl\n" for i in range(200)) + b"usemtl a\nf 1 2 3\n",
        "a.mtl": repeated(lambda i: b"newmtl a\nKd 1 1 1\n")},
    "a_library_of_many": lambda: {"a.obj": b"mtllib a.mtl\nusemtl m7\n" + TRIANGLE + b"f 1 2 3\n",
                                  "a.mtl": repeated(lambda i: b"newmtl m%d\nmap_Kd t%d.png\n" % (i, i))},
    "a_library_of_used_textures": lambda: {
        "a.obj": b"mtllib a.mtl\n" + TRIANGLE + b"".join(b"usemtl m%d\nf 1 2 3\n" % i for i in range(5000)),
        "a.mtl": repeated(lambda i: b"newmtl m%d\n" % i + b"".join(b"bump %d_%d\n" % (i, j) for j in range(250)))},
    "a_library_of_noise": lambda: {"a.obj": b"mtllib a.mtl\nusemtl m7\n" + TRIANGLE + b"f 1 2 3\n", "a.mtl": noise()},
    "a_library_of_one_line": lambda: {"a.obj": b"mtllib a.mtl\nusemtl a\n" + TRIANGLE + b"f 1 2 3\n",
                                      "a.mtl": b"newmtl a\nmap_Kd " + b"../" * (SIZE // 3)},
    "a_library_by_many_ways": lambda: {
        "a.obj": b"".join(b"mtllib %sa.mtl\n" % spelling(i, 14) for i in range(9999)) + TRIANGLE + b"f 1 2 3\n",
        "a.mtl": repeated(lambda i: b"newmtl x%d\nKd 1 1 1\n" % i), "d/.keep": b"", "e/.keep": b""},
    "a_texture_by_many_ways": lambda: {
        "a.obj": b"mtllib a.mtl\n" + TRIANGLE + b"".join(b"usemtl m%d\nf 1 2 3\n" % i for i in range(60_000)),
        "a.mtl": b"".join(b"newmtl m%d\nmap_Kd %st.png\n" % (i, spelling(i, 16)) for i in range(60_000)),
        "t.png": noise(), "d/.keep": b"", "e/.keep": b""},
    "unknown_words": lambda: {"a.obj": TRIANGLE + b"f 1 2 3\n" + repeated(lambda i: b"word%d 1 2 3\n" % i)},
    # Polygons that are hard to triangulate.
    "polygons_that_go_round_8_times": lambda: {"a.obj": polygons(SQUARE, [0, 1, 2, 3] * 8)},
    "polygons_that_go_round_16_times": lambda: {"a.obj": polygons(SQUARE, [0, 1, 2, 3] * 16)},
    "polygons_that_go_round_250_times": lambda: {"a.obj": polygons(SQUARE, [0, 1, 2, 3] * 250)},
    "a_polygon_that_goes_round_a_million_times": lambda: {"a.obj": polygons(SQUARE, [0, 1, 2, 3] * 1_200_000)},
    "polygons_that_cross_themselves": lambda: {"a.obj": polygons(scattered(512), range(512))},
    "spirals": lambda: {"a.obj": polygons(spiral(512), range(512))},
    # Faces that mean nothing.
    "every_face_wrong": lambda: {"a.obj": TRIANGLE + repeated(lambda i: b"f 1 2 %d\n" % (4_000_000_000 + i))},
    "every_face_flat": lambda: {"a.obj": TRIANGLE + repeated(lambda i: b"f 1 1 2\n")},
    "every_face_the_same": lambda: {"a.obj": TRIANGLE + repeated(lambda i: b"f 1 2 3\n")},
    "both_sides_of_one_face": lambda: {"a.obj": TRIANGLE + repeated(lambda i: b"f 1 2 3\nf 3 2 1\n")},
    "faces_before_vertices": lambda: {"a.obj": b"f 1 2 3\n" * (SIZE // 8) + TRIANGLE},
    "far_relative_indices": lambda: {"a.obj": TRIANGLE + repeated(lambda i: b"f -1 -2 -%d\n" % (i + 4))},
    "coordinates_not_finite": lambda: {"a.obj": repeated(lambda i: b"v nan inf -inf\nv 1 2 3\nf -1 -2 -1\n")},
    "vertices_only": lambda: {"a.obj": repeated(lambda i: b"v %d 1 2\n" % i)},
    "indices_of_twenty_digits": lambda: {"a.obj": TRIANGLE + repeated(lambda i: b"f 1 2 99999999999999999999\n")},
    "scattered_to_the_ends": lambda: {"a.obj": repeated(
        lambda i: b"v %de300 0 0\nv 0 %de-300 0\nv 1 1 1\nf -1 -2 -3\n" % (i % 9 + 1, i % 9 + 1))},
}


def write(name, folder):
    folder.mkdir()
    for file, content in CASES[name]().items():
        path = folder / file
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)


def limit():
    resource.setrlimit(resource.RLIMIT_CPU, (3 * SECONDS, 3 * SECONDS))


def run(command):
    """Exit code, processor seconds, peak bytes and words."""
    with tempfile.TemporaryFile() as printed:
        # Processor time is what counts; who waits for ever is ended all the same.
        command = ["timeout", "-s", "KILL", str(60 * SECONDS), *command]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=printed, preexec_fn=limit)
        _, status, usage = os.wait4(process.pid, 0)
        code = process.returncode = os.waitstatus_to_exitcode(status)
        printed.seek(0)
        return code, usage.ru_utime + usage.ru_stime, usage.ru_maxrss << 10, printed.read().decode(errors="replace")


def faults_of(code, seconds, peak, words, out):
    if code < 0 or code in (101, 134, 137, 139) or "panicked" in words:
        yield f"crashed, or ended for taking too long: {words.strip()[-200:]}"
    if seconds > SECONDS:
        yield f"{seconds:.1f} s"
    if peak > PEAK_BYTES:
        yield f"{peak >> 20} MiB"
    if len(words) > MESSAGE_BYTES:
        yield f"{len(words)} bytes of messages"
    if code not in (0, 3) and any(path.is_file() for path in out.rglob("*")):
        yield "refused, but left a result"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=Path)
    parser.add_argument("names", nargs="*", choices=[*CASES, []], metavar="NAME", help=", ".join(CASES))
    arguments = parser.parse_args()
    failed, slowest, largest = 0, 0.0, 0
    for name in arguments.names or CASES:
        with tempfile.TemporaryDirectory() as scratch:
            folder, out = Path(scratch, "in"), Path(scratch, "out")
            # In a process of its own: the kernel counts what this one has had towards the peak of what it starts.
            maker = Process(target=write, args=(name, folder))
            maker.start()
            maker.join()
            command = [arguments.binary.resolve(), "simplify", folder / "a.obj", "-o", out / "b.obj", "--ratio", "0.5"]
            command += ["--memory", "256MiB", "--threads", "2", "--quiet", "--work", Path(scratch, "work")]
            code, seconds, peak, words = run(list(map(str, command)))
            faults = list(faults_of(code, seconds, peak, words, out))
            first = words.strip().splitlines()[0].replace(str(folder), "")[:90] if words.strip() else ""
            print(f"{name:36} exit {code:3} {seconds:6.2f} s {peak >> 20:4} MiB  {first}", flush=True)
            for fault in faults:
                print(f"    FAULT {fault}", flush=True)
            failed += bool(faults)
            slowest, largest = max(slowest, seconds), max(largest, peak)
            shutil.rmtree(out, ignore_errors=True)
    print(f"{len(arguments.names or CASES)} files, {failed} faults, at most {slowest:.1f} s and {largest >> 20} MiB")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
