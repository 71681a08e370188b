"""Meshes of trimesh, PyVista and Open3D keep what drystone keeps."""

import numpy as np
import pytest

import drystone
from conftest import MINIATURES, TOWN, grid, read_obj
from drystone import arrays


def plane_uv(vertices):
    return vertices[:, :2] / 12


def colour_at(image, uv):
    """Colours of an image, counted from its lower left."""
    height, width = image.shape[:2]
    x = np.clip(uv[:, 0] * width, 0, width - 1).astype(int)
    y = np.clip((1 - uv[:, 1]) * height, 0, height - 1).astype(int)
    return image[y, x].astype(float)


def corners(mesh):
    """Position and texture coordinate of each corner of a Trimesh, once each."""
    return {tuple(row) for row in np.round(np.column_stack([mesh.vertices, mesh.visual.uv])[mesh.faces.ravel()], 5)}


MESHES = [TOWN, *(path for path in sorted(MINIATURES.glob("*.obj")) if read_obj(path).faces.shape[1] == 3)]


def coloured(path):
    """A mesh of triangles, and a random colour for each position: vertices at the same one are merged."""
    mesh = read_obj(path)
    positions = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].ravel()
    colors = np.random.default_rng(3).integers(0, 256, (positions.max() + 1, 3)).astype(np.uint8)
    return mesh, colors[positions]


def triangles(*corners):
    """Values of the corners of each triangle: its least corner first, and the triangles in order."""
    rows = np.concatenate([values.reshape(len(values), 3, -1).astype(float) for values in corners], axis=2).tolist()
    return sorted(min(row[k:] + row[:k] for k in range(3)) for row in rows)


def test_trimesh_keeps_its_texture():
    trimesh = pytest.importorskip("trimesh")
    import drystone.trimesh

    mesh = trimesh.load(TOWN, process=False, force="mesh")
    result = drystone.trimesh.simplify(mesh, ratio=0.3)
    assert abs(len(result.faces) - 0.3 * len(mesh.faces)) <= 2
    assert result.visual.uv.shape == (len(result.vertices), 2)
    assert result.visual.material is mesh.visual.material
    whole = drystone.trimesh.simplify(mesh, ratio=1.0)
    assert len(whole.faces) == len(mesh.faces) and corners(whole) == corners(mesh)
    assert result.metadata["drystone"].faces.output == len(result.faces)


def test_trimesh_bakes():
    trimesh = pytest.importorskip("trimesh")
    image_class = pytest.importorskip("PIL.Image")
    import drystone.trimesh

    vertices, faces = grid(12)
    ramp = np.zeros((64, 64, 3), np.uint8)
    ramp[:, :, 0] = np.linspace(0, 255, 64)
    visual = trimesh.visual.TextureVisuals(uv=plane_uv(vertices), image=image_class.fromarray(ramp))
    mesh = trimesh.Trimesh(vertices, faces, visual=visual, process=False)
    result = drystone.trimesh.simplify(mesh, ratio=0.3, textures="bake", texels=4)
    found = colour_at(np.asarray(result.visual.material.image), result.visual.uv)[:, 0]
    assert np.abs(found - result.vertices[:, 0] * 255 / 12).max() < 20
    with pytest.raises(drystone.UsageError, match="no image"):
        drystone.trimesh.simplify(trimesh.Trimesh(vertices, faces), ratio=0.3, textures="bake")
    with pytest.raises(TypeError, match="Scene"):
        drystone.trimesh.simplify(trimesh.Scene(), ratio=0.3)


def test_trimesh_keeps_colours_of_faces_and_several_materials():
    trimesh = pytest.importorskip("trimesh")
    import drystone.trimesh

    vertices, faces = grid(12)
    is_left = vertices[faces].mean(axis=1)[:, 0] < 6
    colors = np.where(is_left[:, None], [250, 10, 20, 255], [5, 100, 200, 255]).astype(np.uint8)
    mesh = trimesh.Trimesh(vertices, faces, face_colors=colors, process=False, metadata={"name": "grid"})
    result = drystone.trimesh.simplify(mesh, ratio=0.3)
    left = result.vertices[result.faces].mean(axis=1)[:, 0] < 6
    assert np.array_equal(result.visual.face_colors[:, 0] == 250, left) and result.metadata["name"] == "grid"
    several = trimesh.visual.material.MultiMaterial([trimesh.visual.material.SimpleMaterial() for _ in range(2)])
    visual = trimesh.visual.TextureVisuals(uv=plane_uv(vertices), material=several, face_materials=is_left.astype(int))
    result = drystone.trimesh.simplify(trimesh.Trimesh(vertices, faces, visual=visual, process=False), ratio=0.3)
    left = result.vertices[result.faces].mean(axis=1)[:, 0] < 6
    assert np.array_equal(result.visual.face_materials == 1, left)


def test_trimesh_keeps_colours():
    trimesh = pytest.importorskip("trimesh")
    import drystone.trimesh

    vertices, faces = grid(12)
    colors = np.column_stack([vertices[:, 0] * 20, vertices[:, 1] * 20, 0 * vertices[:, 0]]).astype(np.uint8)
    result = drystone.trimesh.simplify(trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False), ratio=0.3)
    assert np.abs(result.visual.vertex_colors[:, 0] - result.vertices[:, 0] * 20).max() < 25


def test_trimesh_warns_of_alpha_that_is_left_out():
    trimesh = pytest.importorskip("trimesh")
    import drystone.trimesh

    vertices, faces = grid(12)
    colors = np.full((len(vertices), 4), 255, np.uint8)
    colors[5, 3] = 254
    with pytest.warns(UserWarning, match="alpha"):
        drystone.trimesh.simplify(trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False), ratio=0.3)
    mesh = trimesh.Trimesh(vertices, faces, face_colors=np.tile([9, 9, 9, 100], (len(faces), 1)), process=False)
    assert np.all(drystone.trimesh.simplify(mesh, ratio=0.3).visual.face_colors == [9, 9, 9, 100])


def test_pyvista_keeps_texture_coordinates_and_arrays():
    pyvista = pytest.importorskip("pyvista")
    import drystone.pyvista

    vertices, faces = grid(12)
    mesh = pyvista.PolyData.from_regular_faces(vertices, faces)
    mesh.active_texture_coordinates = plane_uv(vertices)
    mesh.cell_data["side"] = (vertices[faces].mean(axis=1)[:, 0] < 6).astype(np.int32)
    mesh.point_data["rgb"] = (plane_uv(vertices)[:, [0, 0, 0]] * 250).astype(np.uint8)
    result = drystone.pyvista.simplify(mesh, material="side", colors="rgb", ratio=0.3)
    side, rgb = mesh.cell_data["side"], mesh.point_data["rgb"]
    options = {"uv": plane_uv(vertices), "face_material": side, "vertex_colors": rgb, "ratio": 0.3}
    same = drystone.simplify_mesh(vertices, faces, **options)
    assert np.array_equal(result.regular_faces, same.faces) and np.array_equal(result.points, same.vertices)
    assert np.allclose(result.active_texture_coordinates, plane_uv(np.asarray(result.points)), atol=0.05)
    is_left = np.asarray(result.points)[result.regular_faces].mean(axis=1)[:, 0] < 6
    assert np.array_equal(np.asarray(result.cell_data["side"]) == 1, is_left)
    assert result.point_data["rgb"].dtype == np.uint8
    squares = drystone.pyvista.simplify(pyvista.Plane(i_resolution=4, j_resolution=4), ratio=1.0)
    assert squares.n_cells == 32
    with pytest.raises(drystone.UsageError, match="simplify_mesh"):
        drystone.pyvista.simplify(mesh, ratio=0.3, textures="bake")
    with pytest.raises(TypeError, match="PolyData"):
        drystone.pyvista.simplify(pyvista.ImageData(dimensions=(2, 2, 2)), ratio=0.5)


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_pyvista_keeps_a_whole_mesh(path):
    pyvista = pytest.importorskip("pyvista")
    import drystone.pyvista

    source, colors = coloured(path)
    own = np.arange(len(source.faces)) % 3 if source.face_material is None else source.face_material
    pairs = np.stack([source.faces, source.faces if source.uv is None else source.face_uv], axis=-1)
    known, places = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    mesh = pyvista.PolyData.from_regular_faces(source.vertices[known[:, 0]], places.reshape(-1, 3))
    if source.uv is not None:
        mesh.active_texture_coordinates = source.uv[known[:, 1]]
    mesh.cell_data["own"], mesh.point_data["rgb"] = own, colors[known[:, 0]]
    result = drystone.pyvista.simplify(mesh, material="own", colors="rgb", ratio=1.0)

    def values(mesh):
        faces, uv = mesh.regular_faces, mesh.active_texture_coordinates
        materials = np.repeat(np.asarray(mesh.cell_data["own"])[:, None], 3, axis=1)
        coordinates = [] if uv is None else [np.asarray(uv)[faces]]
        return triangles(np.asarray(mesh.points)[faces], np.asarray(mesh.point_data["rgb"])[faces], materials, *coordinates)

    assert values(result) == values(mesh) and len(values(mesh)) == len(source.faces)
    assert result.points.dtype == np.float64 and result.point_data["rgb"].dtype == np.uint8


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_open3d_keeps_a_whole_mesh(path):
    open3d = pytest.importorskip("open3d", exc_type=ImportError)
    import drystone.open3d

    source, colors = coloured(path)
    utility = open3d.utility
    mesh = open3d.geometry.TriangleMesh(utility.Vector3dVector(source.vertices), utility.Vector3iVector(source.faces))
    mesh.vertex_colors = utility.Vector3dVector(colors / 256)
    if source.uv is not None:
        mesh.triangle_uvs = utility.Vector2dVector(source.uv[source.face_uv].reshape(-1, 2))
    if source.face_material is not None:
        mesh.triangle_material_ids = utility.IntVector(source.face_material.astype(np.int32))
    images = [np.full((4, 4, 3), value, np.uint8) for value in (40, 200)]
    mesh.textures = [open3d.geometry.Image(image) for image in images]
    result = drystone.open3d.simplify(mesh, ratio=1.0)

    def values(mesh):
        faces, ids, uv = (np.asarray(each) for each in (mesh.triangles, mesh.triangle_material_ids, mesh.triangle_uvs))
        materials = [np.repeat(ids[:, None], 3, axis=1)] if len(ids) else []
        coordinates = [uv.reshape(-1, 3, 2)] if len(uv) else []
        return triangles(np.asarray(mesh.vertices)[faces], np.asarray(mesh.vertex_colors)[faces], *materials, *coordinates)

    assert values(result) == values(mesh) and len(values(mesh)) == len(source.faces)
    assert result.has_triangle_uvs() == mesh.has_triangle_uvs()
    assert result.has_triangle_material_ids() == mesh.has_triangle_material_ids()
    assert all(np.array_equal(np.asarray(found), image) for found, image in zip(result.textures, images, strict=True))


def test_open3d_keeps_what_triangles_have():
    open3d = pytest.importorskip("open3d", exc_type=ImportError)
    import drystone.open3d

    vertices, faces = grid(12)
    utility = open3d.utility
    mesh = open3d.geometry.TriangleMesh(utility.Vector3dVector(vertices), utility.Vector3iVector(faces))
    mesh.triangle_uvs = utility.Vector2dVector(plane_uv(vertices)[faces].reshape(-1, 2))
    mesh.triangle_material_ids = utility.IntVector((vertices[faces].mean(axis=1)[:, 0] < 6).astype(np.int32))
    mesh.vertex_colors = utility.Vector3dVector(np.repeat(plane_uv(vertices)[:, :1], 3, axis=1))
    images = [np.full((32, 32, 3), value, np.uint8) for value in (40, 200)]
    mesh.textures = [open3d.geometry.Image(image) for image in images]
    result = drystone.open3d.simplify(mesh, ratio=0.3)
    at, corners = np.asarray(result.vertices), np.asarray(result.triangles)
    options = {"uv": plane_uv(vertices), "face_uv": faces, "face_material": mesh.triangle_material_ids}
    colors = np.asarray(mesh.vertex_colors)
    same = drystone.simplify_mesh(vertices, faces, **options, vertex_colors=colors, ratio=0.3)
    assert np.array_equal(corners, same.faces) and np.array_equal(at, same.vertices)
    assert np.allclose(np.asarray(result.triangle_uvs), plane_uv(at)[corners].reshape(-1, 2), atol=0.05)
    ids = np.asarray(result.triangle_material_ids)
    assert np.array_equal(ids == 1, at[corners].mean(axis=1)[:, 0] < 6)
    assert len(result.textures) == 2 and np.abs(np.asarray(result.vertex_colors)[:, 0] - at[:, 0] / 12).max() < 0.1
    baked = drystone.open3d.simplify(mesh, ratio=0.3, textures="bake", texels=4)
    uv, ids = np.asarray(baked.triangle_uvs).reshape(-1, 3, 2).mean(axis=1), np.asarray(baked.triangle_material_ids)
    x = np.asarray(baked.vertices)[np.asarray(baked.triangles)].mean(axis=1)[:, 0]
    for number, image in enumerate(baked.textures):
        own = (ids == number) & (np.abs(x - 6) > 1)
        found = colour_at(np.asarray(image)[::-1], uv[own])[:, 0]
        assert np.abs(found - np.where(x[own] < 6, 200, 40)).max() < 10
    with pytest.raises(TypeError):
        drystone.open3d.simplify(open3d.geometry.PointCloud(), ratio=0.5)


def test_open3d_has_its_images_the_right_way_up(tmp_path):
    open3d = pytest.importorskip("open3d", exc_type=ImportError)
    image_class = pytest.importorskip("PIL.Image")
    import drystone.open3d

    vertices, faces = grid(12)
    uv = plane_uv(vertices)
    ramp = np.zeros((64, 64, 3), np.uint8)
    ramp[:, :, 0] = np.linspace(255, 0, 64)[:, None]
    image_class.fromarray(ramp).save(tmp_path / "ramp.png")
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd ramp.png\n")
    rows = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"vt {u} {v}" for u, v in uv]
    rows += ["f " + " ".join(f"{i}/{i}" for i in face) for face in faces + 1]
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl a\n" + "\n".join(rows) + "\n")
    mesh = open3d.io.read_triangle_mesh(str(tmp_path / "a.obj"))
    baked = drystone.open3d.simplify(mesh, ratio=0.3, textures="bake", texels=4)
    (tmp_path / "out").mkdir()
    open3d.io.write_triangle_mesh(str(tmp_path / "out" / "b.obj"), baked)
    texture = drystone.compare(tmp_path / "a.obj", tmp_path / "out" / "b.obj", samples=2000).texture
    assert texture is not None and texture.colour_rms < 12


def test_adapters_do_not_import_their_library_before_they_are_called():
    import subprocess
    import sys

    code = (
        "import sys, drystone, drystone.trimesh, drystone.pyvista, drystone.open3d\n"
        "print([name for name in ('trimesh', 'pyvista', 'open3d', 'tqdm', 'PIL') if name in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
    assert arrays.simplify_mesh is drystone.simplify_mesh
