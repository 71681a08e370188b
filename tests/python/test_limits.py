"""Large runs: within the memory budget, and killed at any moment without a trace in the result."""

import hashlib
import json
import os
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytestmark = pytest.mark.slow

MIB = 1 << 20


def peak_resident_bytes(process_id):
    """VmHWM as the kernel counts it, or 0 once the process is gone or where there is no /proc."""
    try:
        for line in Path(f"/proc/{process_id}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return 0


def thread_count(process_id):
    """Threads of a process, or 0 once it is gone or where there is no /proc."""
    try:
        return len(os.listdir(f"/proc/{process_id}/task"))
    except OSError:
        return 0


def simplify_in_128_mib(drystone, source, tmp_path, *options):
    """Simplifies within 128 MiB, as the program and the kernel count them; the report."""
    output, report_path = tmp_path / "out.obj", tmp_path / "report.json"
    command = [drystone.binary, "simplify", source, "-o", output, "--memory", "128MiB", *options]
    command += ["--report", report_path, "--quiet"]
    with open(tmp_path / "messages.txt", "w+") as messages:
        process = subprocess.Popen(list(map(str, command)), stdin=subprocess.DEVNULL, stderr=messages)
        seen = 0
        while process.poll() is None:
            seen = max(seen, peak_resident_bytes(process.pid))
            time.sleep(0.02)
        messages.seek(0)
        assert process.returncode == 0, messages.read()
    report = json.loads(report_path.read_text())
    assert report["memory"]["budget"] == 128 * MIB
    assert report["memory"]["peak_resident"] <= 128 * MIB
    assert seen <= 128 * MIB
    assert report["memory"]["peak_resident"] >= 0.9 * seen, "the report must not claim less than the kernel counts"
    return report


def test_million_triangles_fit_into_128_mib(drystone, large_town, tmp_path):
    report = simplify_in_128_mib(drystone, large_town, tmp_path, "--ratio", "0.1")
    wanted = report["faces"]["target"]
    assert abs(report["faces"]["output"] - wanted) <= max(2, 0.001 * wanted)


SYSTEMS = [
    ["--metric", "qem"],
    ["--metric", "qem-1997"],
    ["--metric", "oblique"],
    ["--metric", "curvature"],
    ["--metric", "terrain"],
    ["--metric", "sharpness", "--optimize"],
    ["--remesh", "cvd"],
    ["--remesh", "cvd:cells=40000"],
]


@pytest.mark.parametrize("system", SYSTEMS, ids=" ".join)
def test_every_metric_and_remeshing_fit_into_128_mib(drystone, middle_town, tmp_path, system):
    target = [] if "cells" in system[-1] else ["--ratio", "0.3"]
    report = simplify_in_128_mib(drystone, middle_town, tmp_path, "--cluster-faces", "100000", *target, *system)
    assert report["faces"]["output"] < report["faces"]["input"]


@pytest.mark.parametrize("atlas, texels", [(256, 0.02), (512, 0.1), (4096, 0.1)])
def test_new_images_of_any_size_fit_into_128_mib_and_the_plan(drystone, middle_town, tmp_path, atlas, texels):
    options = ["--ratio", 0.05, "--textures", "bake", "--atlas", atlas, "--texels", texels, "--threads", 4]
    planned = json.loads(drystone("plan", middle_town, "--memory", "128MiB", "--json", *options).stdout)
    report = simplify_in_128_mib(drystone, middle_town, tmp_path, *options)
    assert report["memory"]["peak_resident"] <= planned["memory"]["peak"]


def test_lines_of_15_mb_are_read_one_after_the_other(drystone, tmp_path):
    """Polygons of 7.5 million corners that all repeat a vertex: the text and three times as much once parsed."""
    side = 100
    vertices = "".join(f"v {i % side} {i // side} 0\n" for i in range(side * side))
    first = [1 + j * side + i for j in range(side - 1) for i in range(side - 1)]
    with open(tmp_path / "in.obj", "w") as file:
        file.write(vertices + "".join(f"f {a} {a + 1} {a + side + 1} {a + side}\n" for a in first))
        for _ in range(6):
            file.write("f" + " 1" * 7_500_000 + "\n")
    report = simplify_in_128_mib(drystone, tmp_path / "in.obj", tmp_path, "--ratio", "0.5")
    assert report["memory"]["peak_resident"] <= 100 * MIB


def write_square_with_a_large_image(folder, ending):
    """A square that shows an image of 264 MiB once decoded; the path of the mesh."""
    side = 9600
    across, down = np.meshgrid(np.arange(side, dtype=np.uint16), np.arange(side, dtype=np.uint16))
    pixels = np.stack([across >> 5, down >> 5, (across >> 7 ^ down >> 7) % 2 * 200], axis=-1).astype(np.uint8)
    options = {"subsampling": 0} if ending == "jpg" else {"compress_level": 1}
    Image.fromarray(pixels).save(folder / f"large.{ending}", **options)
    (folder / "in.mtl").write_text(f"newmtl large\nmap_Kd large.{ending}\n")
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    lines = [f"v {10 * u} {10 * v} 0\nvt {u} {v}\n" for u, v in corners]
    (folder / "in.obj").write_text("mtllib in.mtl\nusemtl large\n" + "".join(lines) + "f 1/1 2/2 3/3 4/4\n")
    return folder / "in.obj"


REDUCED_BAKE = ["--ratio", "1", "--textures", "bake", "--texels", "0.01", "--atlas", "1024"]


@pytest.mark.parametrize("ending", ["jpg", "png"])
def test_images_that_do_not_fit_are_baked_at_a_lower_resolution(drystone, tmp_path, ending):
    report = simplify_in_128_mib(drystone, write_square_with_a_large_image(tmp_path, ending), tmp_path, *REDUCED_BAKE)
    assert report["repairs"]["reduced_image"] == 1
    assert report["bake"]["colourless"] == 0


def test_a_jpeg_is_decoded_by_no_more_threads_than_a_png(drystone, tmp_path):
    """Threads beyond `--threads` wait for each other without a limit on what waits between them."""
    most = {}
    for ending in ["jpg", "png"]:
        folder = tmp_path / ending
        folder.mkdir()
        source = write_square_with_a_large_image(folder, ending)
        command = [drystone.binary, "simplify", source, "-o", folder / "out.obj", "--memory", "128MiB", *REDUCED_BAKE]
        command += ["--threads", "1", "--quiet"]
        process = subprocess.Popen(list(map(str, command)), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        most[ending] = 0
        while process.poll() is None:
            most[ending] = max(most[ending], thread_count(process.pid))
            time.sleep(0.002)
        assert process.returncode == 0
    # One may be missed between two looks.
    assert most["jpg"] <= most["png"] + 1


def test_a_metric_that_does_not_fit_is_refused_with_what_would_do(drystone, middle_town, tmp_path):
    options = ["--metric", "terrain", "--ratio", "0.3", "--memory", "128MiB", "--cluster-faces"]
    words = drystone.simplify(middle_town, tmp_path, *options, "250000", codes=(2,)).stderr
    fitting = words.split("give --cluster-faces ")[1].split()[0]
    assert 150_000 < int(fitting) < 200_000
    # What stays of the mesh through all passes is known after the scan alone, and takes a little.
    drystone.simplify(middle_town, tmp_path, *options, int(fitting) * 9 // 10)


def test_killed_run_leaves_no_result_and_the_next_one_has_the_same_bytes(drystone, large_town, tmp_path):
    def command(folder):
        options = ["--ratio", "0.1", "--memory", "256MiB", "--cluster-faces", "20000", "--quiet"]
        return [drystone.binary, "simplify", str(large_town), "-o", str(folder / "out.obj"), *options]

    calm, killed = tmp_path / "calm", tmp_path / "killed"
    calm.mkdir()
    killed.mkdir()
    started = time.monotonic()
    subprocess.run(command(calm), stdin=subprocess.DEVNULL, check=True)
    whole = time.monotonic() - started

    # The first kill comes early, the second in whatever the restarted run is doing by then.
    for delay in (min(0.5, 0.2 * whole), 0.3 * whole):
        process = subprocess.Popen(command(killed), stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(delay)
        process.send_signal(signal.SIGKILL)
        if process.wait() != -signal.SIGKILL:
            pytest.fail(f"the run ended within {delay:.2f} s of {whole:.2f} s: nothing was killed")
        assert not (killed / "out.obj").exists()

    subprocess.run(command(killed), stdin=subprocess.DEVNULL, check=True)
    digests = {hashlib.sha256((folder / "out.obj").read_bytes()).hexdigest() for folder in (calm, killed)}
    assert len(digests) == 1
    assert sorted(p.name for p in calm.iterdir()) == sorted(p.name for p in killed.iterdir())
