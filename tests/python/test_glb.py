"""GLB out: read back by the validator of Khronos, by trimesh, and by Open3D where it is installed."""

import io
import json
import os
import shutil
import subprocess

import numpy as np
import pytest
import trimesh
from PIL import Image

import objlib

MODULES = objlib.REPOSITORY / "target" / "node" / "node_modules"
VALIDATE = """
const fs = require("fs"), validator = require("gltf-validator");
const bytes = new Uint8Array(fs.readFileSync(process.argv[1]));
validator.validateBytes(bytes).then(report => console.log(JSON.stringify(report)));
"""
CASES = {
    "town": ["town/town.obj", "--ratio", "0.3"],
    "baked": ["town/town.obj", "--ratio", "0.2", "--textures", "bake", "--atlas", "512", "--image", "jpeg"],
    "normals": ["miniatures/normals_box.obj", "--ratio", "0.6"],
    "colours": ["miniatures/coloured_sphere.obj", "--ratio", "0.5"],
    "plain": ["miniatures/two_materials_plane.obj", "--ratio", "0.5"],
}


@pytest.fixture(scope="module")
def results(drystone, tmp_path_factory):
    """Each case as GLB and as OBJ."""
    folder = tmp_path_factory.mktemp("glb")

    def both(name):
        source, *options = CASES[name]
        run = lambda ending: drystone.simplify(
            objlib.FIXTURES / source, folder, *options, name=f"{name}.{ending}", codes=(0, 3)
        )
        return run("glb").output, run("obj").output

    return {name: both(name) for name in CASES}


@pytest.mark.parametrize("case", CASES)
def test_the_validator_finds_nothing(results, case):
    if shutil.which("node") is None or not MODULES.is_dir():
        pytest.skip("node or the package gltf-validator is absent (tools/test installs it where npm is)")
    environment = {**os.environ, "NODE_PATH": str(MODULES)}
    done = subprocess.run(
        ["node", "-e", VALIDATE, results[case][0]], env=environment, capture_output=True, text=True, check=True
    )
    issues = json.loads(done.stdout)["issues"]
    assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"]


@pytest.mark.parametrize("case", ["town", "plain", "normals"])
def test_trimesh_reads_the_surface(results, case):
    glb, obj = results[case]
    scene, expected = trimesh.load(glb, process=False), objlib.read(obj)
    found = scene.to_geometry() if len(scene.geometry) == 1 else trimesh.util.concatenate(scene.dump())
    assert len(found.faces) == len(expected.face)
    triangles = expected.position[expected.face]
    sides = triangles[:, 1:] - triangles[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2
    assert found.area == pytest.approx(area, rel=1e-5)
    position = np.column_stack([found.vertices[:, 0], -found.vertices[:, 2], found.vertices[:, 1]])
    bounds = [position.min(axis=0), position.max(axis=0)]
    assert np.abs(bounds - np.array([triangles.min((0, 1)), triangles.max((0, 1))])).max() < 1e-6 * expected.diagonal


def colours(mesh_uv, pixels):
    """Colours of an image at texture coordinates with (0, 0) at the lower left, without mixing."""
    height, width = pixels.shape[:2]
    column = np.floor(mesh_uv[:, 0] % 1 * width).astype(int) % width
    row = np.floor((1 - mesh_uv[:, 1]) % 1 * height).astype(int) % height
    return pixels[row, column]


def test_faces_show_what_they_show_in_the_obj(results):
    glb, obj = results["town"]
    expected = objlib.read(obj)
    images = {}
    for line in "".join(objlib.read_libraries(obj)).splitlines():
        word, _, rest = line.partition(" ")
        if word == "newmtl":
            material = rest
        elif word == "map_Kd":
            images[material] = np.asarray(Image.open(obj.parent / rest).convert("RGB"))
    scene = trimesh.load(glb, process=False)
    assert len(scene.geometry) == len(images)
    for mesh in scene.geometry.values():
        material = mesh.visual.material
        found_image = np.asarray(material.baseColorTexture.convert("RGB"))
        assert np.array_equal(found_image, images[material.name])
        # trimesh turns v upside down, as an OBJ has it.
        found = colours(mesh.visual.uv[mesh.faces].mean(axis=1), found_image)
        own = expected.material == material.name
        wanted = colours(expected.texcoord[expected.face_uv[own]].mean(axis=1), images[material.name])
        assert np.abs(found.mean(axis=0) - wanted.mean(axis=0)).max() < 1
        assert len(found) == len(wanted)


def test_open3d_reads_the_surface(results):
    open3d = pytest.importorskip("open3d")
    glb, obj = results["baked"]
    found, expected = open3d.io.read_triangle_model(str(glb)), objlib.read(obj)
    assert sum(len(part.mesh.triangles) for part in found.meshes) == len(expected.face)
    assert all(len(part.mesh.triangle_uvs) == 3 * len(part.mesh.triangles) for part in found.meshes)
    assert all(material.albedo_img is not None for material in found.materials)


def test_images_are_the_bytes_of_the_files(results):
    glb, obj = results["town"]
    data = glb.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    for image in document["images"]:
        view = document["bufferViews"][image["bufferView"]]
        inside = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        (file,) = (obj.parent / "town_textures").glob(image["name"] + ".*")
        assert inside == file.read_bytes()
        Image.open(io.BytesIO(inside)).verify()
