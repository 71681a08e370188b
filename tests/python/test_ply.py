"""PLY in and out: results are read back with PyMeshLab, trimesh and Open3D, where they are installed."""

import json

import numpy as np
import pytest

import objlib
import plylib

MINIATURES = ["closed_sphere", "coloured_sphere", "seam_strip", "open_border_disk", "bow_tie"]
TOWN_TEXTURES = {"facade": "facade.jpg", "green": "green.jpg", "roof": "roof.jpg", "street": "street.png"}


def tail(path):
    """The statements of an OBJ but for names of materials and libraries."""
    names = ("mtllib", "usemtl", "#", "o ", "g ")
    return [line for line in path.read_text().splitlines() if not line.startswith(names)]


@pytest.mark.parametrize("encoding", plylib.ENCODINGS)
@pytest.mark.parametrize("name", MINIATURES)
def test_a_miniature_as_ply_gives_the_result_of_its_obj(drystone, tmp_path, name, encoding):
    source = objlib.FIXTURES / "miniatures" / f"{name}.obj"
    plylib.write(tmp_path / f"{name}.ply", objlib.read(source), encoding=encoding)
    from_obj = drystone.simplify(source, tmp_path, "--ratio", "0.5", name="a.obj", codes=(0, 3))
    from_ply = drystone.simplify(tmp_path / f"{name}.ply", tmp_path, "--ratio", "0.5", name="b.obj", codes=(0, 3))
    assert from_obj.code == from_ply.code
    assert tail(from_obj.output) == tail(from_ply.output)


@pytest.fixture(scope="module")
def town_results(drystone, town_path, tmp_path_factory):
    """The town at 30 % as OBJ and as PLY, and the PLY at 30 % again as both."""
    folder = tmp_path_factory.mktemp("town_ply")
    obj = drystone.simplify(town_path, folder, "--ratio", "0.3", name="a.obj").output
    ply = drystone.simplify(town_path, folder, "--ratio", "0.3", name="b.ply")
    again = drystone.simplify(ply.output, folder, "--ratio", "0.3", name="c.ply").output
    back = drystone.simplify(ply.output, folder, "--ratio", "0.3", name="d.obj").output
    return obj, ply, again, back


def test_both_results_are_the_same_surface(drystone, town_results):
    obj, ply, again, back = town_results
    for one, other in [(obj, ply.output), (again, back)]:
        found = json.loads(drystone("compare", one, other, "--json", "--samples", "2000").stdout)
        geometry = found["geometry"]
        # What rounding does to sample points, far from the origin.
        assert geometry["symmetric"]["max"] < 1e-10 * geometry["diagonal"]
        assert geometry["area"]["before"] == geometry["area"]["after"]
        for part in ("topology", "quality"):
            assert found[part]["before"] == found[part]["after"]


def test_faces_and_images_are_those_of_the_obj(town_results):
    trimesh = pytest.importorskip("trimesh")
    obj, ply, _, _ = town_results
    expected = objlib.read(obj)
    lines = plylib.header(ply.output)
    names = [line.split()[-1] for line in lines if line.startswith("comment TextureFile")]
    assert sorted(names) == sorted(f"b_textures/{image}" for image in TOWN_TEXTURES.values())
    assert all((ply.output.parent / name).exists() for name in names)
    assert "property double x" in lines
    found = trimesh.load(ply.output, process=False)
    # It splits vertices at seams of the texture.
    assert np.array_equal(found.vertices[found.faces], expected.position[expected.face])
    assert ply.report["repairs"].get("unwritten_statements", 0) > 0


def test_pymeshlab_reads_positions_faces_and_texture(town_results):
    pymeshlab = pytest.importorskip("pymeshlab")
    obj, ply, _, _ = town_results
    expected = objlib.read(obj)
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(ply.output))
    found = meshes.current_mesh()
    assert (found.face_matrix() == expected.face).all()
    assert np.abs(found.vertex_matrix() - expected.position).max() < 1e-9
    assert found.has_wedge_tex_coord() and found.texture_number() == 4
    uv = found.wedge_tex_coord_matrix().reshape(-1, 3, 2)
    assert np.abs(uv - expected.texcoord[expected.face_uv]).max() < 1e-6


def test_open3d_reads_positions_and_faces(town_results):
    open3d = pytest.importorskip("open3d")
    obj, ply, _, _ = town_results
    expected = objlib.read(obj)
    found = open3d.io.read_triangle_mesh(str(ply.output))
    assert (np.asarray(found.triangles) == expected.face).all()
    assert np.abs(np.asarray(found.vertices) - expected.position).max() < 1e-9


@pytest.mark.parametrize("name", ["coloured_sphere", "normals_box"])
def test_colours_and_normals_are_read_by_others(drystone, tmp_path, name):
    trimesh = pytest.importorskip("trimesh")
    source = objlib.FIXTURES / "miniatures" / f"{name}.obj"
    obj = drystone.simplify(source, tmp_path, "--ratio", "0.5", name="a.obj", codes=(0, 3)).mesh
    ply = drystone.simplify(source, tmp_path, "--ratio", "0.5", name="a.ply", codes=(0, 3)).output
    found = trimesh.load(ply, process=False)
    assert np.abs(found.vertices - obj.position).max() < 1e-6
    lines = plylib.header(ply)
    if obj.colour is not None:
        assert "property uchar red" in lines
        assert np.abs(found.visual.vertex_colors[:, :3] / 255 - obj.colour).max() <= 0.5 / 255 + 1e-6
    else:
        assert "property float nx" in lines
        assert np.abs(np.linalg.norm(found.vertex_normals, axis=1) - 1).max() < 1e-3


def test_what_meshlab_writes_is_read(drystone, town_path, tmp_path):
    """With an image for every face, as MeshLab writes them, in both of its forms."""
    pymeshlab = pytest.importorskip("pymeshlab")
    expected = drystone.simplify(town_path, tmp_path, "--ratio", "0.3", name="a.obj")
    for binary in (True, False):
        folder = tmp_path / ("binary" if binary else "text")
        folder.mkdir()
        for image in TOWN_TEXTURES.values():
            (folder / image).write_bytes((town_path.parent / image).read_bytes())
        meshes = pymeshlab.MeshSet()
        meshes.load_new_mesh(str(town_path))
        options = {"binary": binary, "save_wedge_texcoord": True, "save_vertex_color": False, "save_textures": False}
        meshes.save_current_mesh(str(folder / "town.ply"), **options)
        found = drystone.simplify(folder / "town.ply", folder, "--ratio", "0.3", name="b.obj")
        assert found.report["faces"]["input"] == expected.report["faces"]["input"]
        assert found.report["faces"]["output"] == expected.report["faces"]["output"]
        # Without a reader of JPEG it writes names of its own for images.
        names = [line.split()[-1] for line in plylib.header(folder / "town.ply") if "TextureFile" in line]
        copied = {f"b_textures/{name}" if (folder / name).exists() else name for name in names}
        assert set(objlib.textures(found.output)) == copied and "b_textures/street.png" in copied


@pytest.mark.parametrize("encoding", plylib.ENCODINGS)
def test_a_damaged_ply_is_refused_with_its_place(drystone, tmp_path, encoding):
    source = objlib.read(objlib.FIXTURES / "miniatures" / "closed_sphere.obj")
    path = tmp_path / "a.ply"
    plylib.write(path, source, encoding=encoding)
    whole = path.read_bytes()
    for length in range(0, len(whole), 97):
        path.write_bytes(whole[:length])
        run = drystone("simplify", path, "-o", tmp_path / "b.ply", "--ratio", "0.5", "--quiet", codes=(4,))
        assert "a.ply" in run.stderr
    assert not (tmp_path / "b.ply").exists()
