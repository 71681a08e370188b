"""Tiles: what the validator of Khronos, trimesh and a renderer of ours see of them."""

import json
import os
import shutil
import subprocess

import numpy as np
import pymeshlab
import pyproj
import pytest
import scipy.spatial
import trimesh

import objlib

MODULES = objlib.REPOSITORY / "target" / "node" / "node_modules"
VALIDATE = """
const fs = require("fs"), validator = require("gltf-validator");
(async () => {
  for (const file of process.argv.slice(1)) {
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)));
    console.log(JSON.stringify([file, report.issues]));
  }
})();
"""


@pytest.fixture(scope="module")
def pyramid(drystone, tmp_path_factory):
    """The town as a pyramid of small tiles."""
    folder = tmp_path_factory.mktemp("tiles") / "town"
    source = objlib.FIXTURES / "town" / "town.obj"
    done = drystone("tile", source, "-o", folder, "--tile-faces", "1000", "--tile-side", "512", "--json", "--quiet")
    return folder, json.loads(done.stdout)


def tiles_of(folder):
    """Each tile of the tileset, with its level."""
    pending = [json.loads((folder / "tileset.json").read_text())["root"]]
    while pending:
        tile = pending.pop()
        pending += tile.get("children", [])
        name = tile.get("content", {}).get("uri", "")
        if name.endswith(".json"):
            pending.append(json.loads((folder / name).read_text())["root"])
        elif name:
            yield tile, int(name.split("/")[0])


def test_the_validator_finds_nothing_in_any_tile(pyramid):
    if shutil.which("node") is None or not MODULES.is_dir():
        pytest.skip("node or the package gltf-validator is absent (tools/test installs it where npm is)")
    files = sorted(pyramid[0].glob("*/*.glb"))
    assert len(files) > 20
    environment = {**os.environ, "NODE_PATH": str(MODULES)}
    done = subprocess.run(["node", "-e", VALIDATE, *files], env=environment, capture_output=True, text=True, check=True)
    reports = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(reports) == len(files)
    for file, issues in reports:
        assert issues["numErrors"] == issues["numWarnings"] == 0, (file, issues["messages"])


def surface_of(folder, level):
    """The triangles of a level without skirts, in the coordinates of the input."""
    origin = np.array(json.loads((folder / "tileset.json").read_text())["root"]["transform"][12:15])
    parts = []
    for tile, own in tiles_of(folder):
        if own != level:
            continue
        scene = trimesh.load(folder / tile["content"]["uri"], process=False)
        mesh = scene.to_geometry() if hasattr(scene, "to_geometry") else scene.dump(concatenate=True)
        skirt = next(iter(scene.geometry.values())).metadata["skirtTriangles"]
        triangles = np.asarray(mesh.triangles)[: len(mesh.faces) - skirt]
        x, up, south = np.moveaxis(triangles, 2, 0)
        parts.append(np.stack([x, -south, up], axis=2) + origin)
    return np.concatenate(parts)


def area(triangles):
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_trimesh_reads_the_surface_of_each_level(pyramid):
    folder, report = pyramid
    town = trimesh.load(objlib.FIXTURES / "town" / "town.obj", process=False, force="mesh", skip_materials=True)
    whole = area(np.asarray(town.triangles))
    for level in report["levels"]:
        triangles = surface_of(folder, level["level"])
        assert abs(area(triangles) / whole - 1) < (1e-3 if level["level"] == 0 else 0.03)
        assert np.abs(triangles.min((0, 1)) - town.bounds[0]).max() < 2 * level["texel"]
        assert np.abs(triangles.max((0, 1)) - town.bounds[1]).max() < 2 * level["texel"]


def test_a_level_lies_within_its_texel_as_pymeshlab_measures(pyramid):
    folder, report = pyramid
    town = trimesh.load(objlib.FIXTURES / "town" / "town.obj", process=False, force="mesh", skip_materials=True)
    for level in report["levels"][1:]:
        triangles = surface_of(folder, level["level"])
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(np.asarray(town.vertices), np.asarray(town.faces)))
        corners = np.arange(3 * len(triangles)).reshape(-1, 3)
        meshes.add_mesh(pymeshlab.Mesh(triangles.reshape(-1, 3), corners))
        for sampled, target, p99 in [(1, 0, level["to_input_p99"]), (0, 1, level["from_input_p99"])]:
            found = meshes.get_hausdorff_distance(
                sampledmesh=sampled, targetmesh=target, samplenum=50_000, maxdist=pymeshlab.PercentageValue(50)
            )
            # 99 % lie within p99, which is within a texel.
            assert found["RMS"] < 0.7 * p99 <= 0.7 * level["texel"], (level, found)
        assert level["geometric_error"] >= 16 * level["texel"] * 0.999


AMERSFOORT = (
    "+step +inv +proj=sterea +lat_0=52.15616055555555 +lon_0=5.38763888888889 +k=0.9999079 +x_0=155000 +y_0=463000"
    " +ellps=bessel +step +proj=cart +ellps=bessel +step +proj=helmert +x=565.2369 +y=50.0087 +z=465.658"
    " +rx=-0.406857 +ry=0.350733 +rz=-1.87035 +s=4.0812 +convention=position_vector"
)
LONG_ISLAND = (
    "+step +proj=unitconvert +xy_in=us-ft +xy_out=m +z_in=us-ft +z_out=m +step +inv +proj=lcc +lat_0=40.1666666666667"
    " +lon_0=-74 +lat_1=41.0333333333333 +lat_2=40.6666666666667 +x_0=300000 +y_0=0 +ellps=GRS80"
    " +step +proj=cart +ellps=GRS80"
)
ZONE = "+step +inv +proj=utm +zone={} +ellps=WGS84 +step +proj=cart +ellps=WGS84"


@pytest.mark.parametrize(
    ("system", "offset", "steps"),
    [
        ("EPSG:32633", (0, 0, 0), ZONE.format(33)),
        ("+proj=utm +zone=18 +datum=WGS84", (1000, -2e6, 40.5), ZONE.format(18)),
        # US survey feet, heights too.
        ("EPSG:2263", (550000, -4400000, 0), LONG_ISLAND),
        # Another datum.
        ("EPSG:28992", (-300000, -4100000, 0), AMERSFOORT),
    ],
)
def test_a_map_lies_where_proj_says(drystone, tmp_path, system, offset, steps):
    source = objlib.FIXTURES / "town" / "town.obj"
    shift = ",".join(map(str, offset))
    drystone("tile", source, "-o", tmp_path / "town", "--crs", system, "--offset", shift, "--quiet")
    town = trimesh.load(source, process=False, force="mesh", skip_materials=True)
    on_map = np.asarray(town.vertices)[np.unique(town.faces)] + offset
    expected = np.column_stack(pyproj.Transformer.from_pipeline("+proj=pipeline " + steps).transform(*on_map.T))
    transform = json.loads((tmp_path / "town" / "tileset.json").read_text())["root"]["transform"]
    transform = np.array(transform).reshape(4, 4).T
    # The first triangles are those of the surface: each vertex of the input is one of it.
    local = surface_of(tmp_path / "town", 0).reshape(-1, 3) - transform[:3, 3]
    found = local @ transform[:3, :3].T + transform[:3, 3]
    away, _ = scipy.spatial.cKDTree(found).query(expected)
    assert away.max() < 0.02, (away.max(), np.median(away))
