"""Baked textures against two other programs: xatlas for the charts, PyMeshLab for the colours."""

import shutil

import numpy as np
import pymeshlab
import pytest
import xatlas
from PIL import Image

import objlib
from test_charts import SHAPES

GUTTER = 4  # texels around each chart; xatlas is given as many between two
ROUNDING = 1.001


def image_of_material(path):
    """{material: path of its image} of an OBJ."""
    images, material = {}, None
    for library in objlib.read_libraries(path):
        for line in library.splitlines():
            word, _, rest = line.partition(" ")
            if word == "newmtl":
                material = rest
            elif word == "map_Kd":
                images[material] = path.parent / rest
    return images


def stretch(corners, flat):
    """Root mean square of how much a map from the image to the surface stretches, 1 if it never does.

    corners: (t, 3, 3) in space; flat: (t, 3, 2) in texels. Sander, Snyder, Gortler & Hoppe 2001, "Texture mapping
    progressive meshes", equation 1, at equal areas.
    """
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.linalg.norm(np.cross(ab, ac), axis=1)
    solid = np.stack([ab, ac], -1)
    image = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], -1)
    flat_area = 0.5 * np.abs(np.linalg.det(image))
    mapped = solid @ np.linalg.inv(image)
    return np.sqrt((area * 0.5 * (mapped**2).sum(axis=(1, 2))).sum() / area.sum() * flat_area.sum() / area.sum())


@pytest.mark.parametrize("shape", SHAPES)
def test_charts_are_as_good_as_those_of_xatlas(shape, drystone, tmp_path):
    position, face = SHAPES[shape]()
    objlib.write(tmp_path / "in.obj", position, face)
    run = drystone.simplify(tmp_path / "in.obj", tmp_path / "out", "--ratio", 1, "--textures", "bake")
    mesh, bake = run.mesh, run.report["bake"]
    (image,) = image_of_material(run.output).values()
    size = np.array(Image.open(image).size)
    flat = mesh.texcoord[mesh.face_uv] * size

    atlas = xatlas.Atlas()
    atlas.add_mesh(mesh.position.astype(np.float32), mesh.face.astype(np.uint32))
    pack_options = xatlas.PackOptions()
    pack_options.texels_per_unit, pack_options.padding = 1 / bake["texel"], GUTTER
    atlas.generate(xatlas.ChartOptions(), pack_options)
    _, their_face, their_texcoord = atlas[0]
    their_size = np.array([atlas.width, atlas.height])
    their_flat = their_texcoord[their_face] * their_size

    corners = mesh.position[mesh.face]
    assert objlib.charts(mesh).max() + 1 == bake["charts"] <= atlas.chart_count
    assert stretch(corners, flat) <= ROUNDING * stretch(corners, their_flat)
    areas = objlib.uv_areas(mesh)
    assert (areas > 0).all()
    fill = areas.sum()
    assert fill == pytest.approx(bake["fill"], rel=0.02)
    ab, ac = their_flat[:, 1] - their_flat[:, 0], their_flat[:, 2] - their_flat[:, 0]
    their_fill = 0.5 * np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]).sum() / their_size.prod()
    assert fill >= their_fill


@pytest.fixture
def town_with_pngs(town_path, tmp_path):
    """The town with images that PyMeshLab reads everywhere: it takes JPEGs with a plugin alone."""
    folder = tmp_path / "town"
    folder.mkdir()
    shutil.copy(town_path, folder)
    library = town_path.with_suffix(".mtl")
    (folder / library.name).write_text(library.read_text().replace(".jpg", ".png"))
    for image in image_of_material(town_path).values():
        Image.open(image).convert("RGB").save(folder / image.with_suffix(".png").name)
    return folder / town_path.name


def test_colours_are_those_that_pymeshlab_transfers(drystone, town_path, town_with_pngs, tmp_path):
    options = ("--ratio", 0.3, "--textures", "bake", "--texels", 0.25)
    run = drystone.simplify(town_path, tmp_path / "out", *options)
    (image,) = image_of_material(run.output).values()
    ours = np.asarray(Image.open(image).convert("RGB")).astype(float)
    height, width, _ = ours.shape

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(town_with_pngs))
    meshes.load_new_mesh(str(run.output))
    meshes.transfer_attributes_to_texture_per_vertex(
        sourcemesh=0,
        targetmesh=1,
        attributeenum="Texture Color",
        upperbound=pymeshlab.PercentageValue(5),
        textname="theirs.png",
        textw=width,
        texth=height,
        overwrite=False,
        pullpush=False,
    )
    meshes.save_current_mesh(str(tmp_path / "saved.obj"))
    theirs = np.asarray(Image.open(tmp_path / "theirs.png").convert("RGB")).astype(float)

    # Texels well inside of charts: PyMeshLab samples once, so what it shows beside an edge is a matter of chance.
    mesh = run.mesh
    charts = objlib.ChartMap(mesh, 1024)
    inside = charts.chart >= 0
    for _ in range(2):
        for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
            inside &= np.roll(inside, step, axis)
    rows, columns = np.nonzero(inside)
    x = ((columns + 0.5) / 1024 * width).astype(int)
    y = ((1 - (rows + 0.5) / 1024) * height).astype(int)
    difference = np.abs(ours[y, x] - theirs[y, x])
    assert inside.mean() > 0.5
    assert np.median(difference) < 5
    assert np.sqrt((difference**2).mean()) < 18
