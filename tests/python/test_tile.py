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


# Decodes the views of tiles with the decoder that comes with three.js, each to a file beside its tile.
DECODE = """
const fs = require("fs"), [modules, ...files] = process.argv.slice(1);
(async () => {
  const { MeshoptDecoder } = await import(`${modules}/three/examples/jsm/libs/meshopt_decoder.module.js`);
  await MeshoptDecoder.ready;
  for (const file of files) {
    const bytes = new Uint8Array(fs.readFileSync(file));
    const jsonBytes = new DataView(bytes.buffer).getUint32(12, true);
    const { bufferViews } = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + jsonBytes)));
    for (const [number, view] of bufferViews.entries()) {
      const own = view.extensions?.EXT_meshopt_compression;
      if (!own) continue;
      const start = 28 + jsonBytes + own.byteOffset;
      const target = new Uint8Array(own.count * own.byteStride);
      MeshoptDecoder.decodeGltfBuffer(target, own.count, own.byteStride, bytes.subarray(start, start + own.byteLength), own.mode);
      fs.writeFileSync(`${file}.${number}`, target);
    }
  }
})();
"""
SMALL = ["--tile-faces", "1000", "--tile-side", "512"]


def tiles(drystone, folder, compress):
    source = objlib.FIXTURES / "town" / "town.obj"
    done = drystone("tile", source, "-o", folder, *SMALL, "--compress", compress, "--json", "--quiet")
    return folder, json.loads(done.stdout)


@pytest.fixture(scope="module")
def pyramid(drystone, tmp_path_factory):
    """The town as a pyramid of small tiles."""
    return tiles(drystone, tmp_path_factory.mktemp("tiles") / "town", "none")


@pytest.fixture(scope="module")
def compressed(drystone, tmp_path_factory):
    """The same, compressed."""
    return tiles(drystone, tmp_path_factory.mktemp("tiles") / "compressed", "meshopt")


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


def node(script, *arguments):
    if shutil.which("node") is None or not MODULES.is_dir():
        pytest.skip("node or its packages are absent (tools/test installs them where npm is)")
    environment = {**os.environ, "NODE_PATH": str(MODULES)}
    command = ["node", "-e", script, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("kind", ["pyramid", "compressed"])
def test_the_validator_finds_nothing_in_any_tile(kind, request):
    folder, _ = request.getfixturevalue(kind)
    files = sorted(folder.glob("*/*.glb"))
    assert len(files) > 20
    reports = [json.loads(line) for line in node(VALIDATE, *files).splitlines()]
    assert len(reports) == len(files)
    for file, issues in reports:
        assert issues["numErrors"] == issues["numWarnings"] == 0, (file, issues["messages"])


# What the validator says of KTX2, which it does not know.
UNKNOWN = {"VALUE_NOT_IN_LIST", "IMAGE_UNRECOGNIZED_FORMAT"}
# Reads the images of tiles with the reader of KTX2 that comes with three.js.
READ_KTX2 = """
const fs = require("fs"), [modules, ...files] = process.argv.slice(1);
(async () => {
  const { read } = await import(`${modules}/three/examples/jsm/libs/ktx-parse.module.js`);
  for (const file of files) {
    const bytes = new Uint8Array(fs.readFileSync(file));
    const jsonBytes = new DataView(bytes.buffer).getUint32(12, true);
    const { byteOffset, byteLength } = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + jsonBytes))).bufferViews[2];
    const { pixelWidth, pixelHeight, supercompressionScheme, levels } = read(bytes.slice(28 + jsonBytes + byteOffset).slice(0, byteLength));
    console.log(JSON.stringify([pixelWidth, pixelHeight, supercompressionScheme, levels.length]));
  }
})();
"""


@pytest.mark.parametrize(("image", "extension"), [("webp", "EXT_texture_webp"), ("ktx2", "KHR_texture_basisu")])
def test_the_validator_finds_nothing_in_tiles_with_other_images(drystone, small_town, tmp_path, image, extension):
    options = ["--tile-faces", "2000", "--tile-side", "256", "--image", image, "--quiet"]
    made = drystone("tile", small_town, "-o", tmp_path / "town", *options, codes=(0, 2))
    if made.code == 2:
        assert "is built without" in made.stderr and "--features" in made.stderr
        pytest.skip(made.stderr.splitlines()[0])
    files = sorted((tmp_path / "town").glob("*/*.glb"))
    for line in node(VALIDATE, *files).splitlines():
        file, issues = json.loads(line)
        severe = [message for message in issues["messages"] if message["severity"] < 2]
        assert {message["code"] for message in severe} <= (UNKNOWN if image == "ktx2" else set()), (file, severe)
    document, _ = document_of(files[0])
    assert extension in document["extensionsRequired"] and "source" not in document["textures"][0]
    if image == "ktx2":
        for width, height, scheme, levels in map(json.loads, node(READ_KTX2, MODULES, *files).splitlines()):
            assert (width % 4, height % 4, scheme) == (0, 0, 1) and levels == max(width, height).bit_length()


def document_of(file):
    """The JSON of a GLB, and its binary chunk."""
    whole = file.read_bytes()
    length = int.from_bytes(whole[12:16], "little")
    return json.loads(whole[20 : 20 + length]), whole[28 + length :]


def corners_of(document, views):
    """The bytes of the vertices of all triangles, each from its least one on: of the surface, and of the skirt."""
    stride, wide = document["bufferViews"][0]["byteStride"], document["accessors"][1]["componentType"] == 5125
    vertices = [views[0][at : at + stride] for at in range(0, len(views[0]), stride)]
    indices = np.frombuffer(views[1], np.uint32 if wide else np.uint16)[: document["accessors"][1]["count"]]
    corners = [[vertices[index] for index in triangle] for triangle in indices.reshape(-1, 3)]
    turned = [min(all[first:] + all[:first] for first in range(3)) for all in corners]
    skirt = document["meshes"][0]["extras"]["skirtTriangles"]
    return sorted(turned[: len(turned) - skirt]), sorted(turned[len(turned) - skirt :])


def test_the_decoder_of_three_js_finds_the_triangles_of_the_plain_tiles(pyramid, compressed):
    names = [file.relative_to(compressed[0]) for file in sorted(compressed[0].glob("*/*.glb"))]
    assert len(names) > 20
    node(DECODE, MODULES, *(compressed[0] / name for name in names))
    for name in names:
        document, chunk = document_of(pyramid[0] / name)
        part = lambda view: chunk[view["byteOffset"] :][: view["byteLength"]]
        expected = corners_of(document, [part(view) for view in document["bufferViews"][:2]])
        document, _ = document_of(compressed[0] / name)
        assert "EXT_meshopt_compression" in document["extensionsRequired"]
        decoded = [(compressed[0] / f"{name}.{number}").read_bytes() for number in range(2)]
        assert corners_of(document, decoded) == expected, name


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
    options = ["--crs", system, "--offset", shift, "--compress", "none", "--quiet"]
    drystone("tile", source, "-o", tmp_path / "town", *options)
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
