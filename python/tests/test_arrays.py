"""Meshes in arrays: the results of the command line, whatever form the arrays have."""

import ctypes
import os
import struct
import subprocess
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

import drystone
from conftest import MINIATURES, TOWN, grid, read_obj
from drystone import array_job
from drystone.errors import InputError, UsageError

OBJS = sorted(path.stem for path in MINIATURES.glob("*.obj"))


def rounded(values, decimals=6):
    return np.round(values, decimals)


@pytest.mark.parametrize("name", OBJS)
def test_a_miniature_gives_the_mesh_of_its_obj(tmp_path, name):
    path = MINIATURES / f"{name}.obj"
    source = read_obj(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", drystone.TargetMissed)
        drystone.simplify(path, tmp_path / "a.obj", ratio=0.4, normals="drop")
        mesh = drystone.simplify_mesh(**source.arguments(), ratio=0.4)
    expected = read_obj(tmp_path / "a.obj")
    decimals = 3
    assert len(mesh.vertices) == len(expected.vertices)
    assert np.allclose(mesh.vertices, expected.vertices, atol=0.6 * 10.0**-decimals)
    assert np.array_equal(mesh.faces, expected.faces)
    if expected.uv is not None:
        corner = mesh.face_uv >= 0
        assert np.array_equal(corner, expected.face_uv >= 0)
        assert np.allclose(mesh.uv[mesh.face_uv[corner]], expected.uv[expected.face_uv[corner]], atol=1e-3)
    if source.materials:
        names = np.array([*source.materials, ""])
        assert list(names[mesh.face_material]) == list(np.array([*expected.materials, ""])[expected.face_material])
    if source.colors is not None:
        assert np.allclose(mesh.vertex_colors, expected.colors, atol=1e-3)


def test_the_town_in_many_clusters_is_that_of_the_command_line(tmp_path, town):
    # Arrays have no groups, which order the faces of an OBJ.
    plain = [line for line in TOWN.read_text().splitlines(True) if line[0] in "vfu"]
    (tmp_path / "town.obj").write_text("".join(plain))
    drystone.simplify(tmp_path / "town.obj", tmp_path / "a.obj", ratio=0.1, cluster_faces=2000)
    expected = read_obj(tmp_path / "a.obj")
    found = []
    for threads in (1, 2):
        mesh = drystone.simplify_mesh(**town.arguments(), ratio=0.1, cluster_faces=2000, threads=threads)
        assert np.allclose(mesh.vertices, expected.vertices, atol=6e-4) and np.array_equal(mesh.faces, expected.faces)
        assert np.abs(mesh.vertices).max() > 4e6
        names = np.array(town.materials)[mesh.face_material]
        assert list(names) == list(np.array(expected.materials)[expected.face_material])
        found.append(mesh)
    for one, two in zip(found[0][:5], found[1][:5]):
        assert np.array_equal(one, two)
    assert mesh.report.faces.output == len(mesh.faces) and abs(len(mesh.faces) - 1822) <= 2


def test_vertices_that_stay_keep_their_numbers(town):
    mesh = drystone.simplify_mesh(**town.arguments(), ratio=0.5)
    there = {tuple(vertex) for vertex in town.vertices}
    assert sum(tuple(vertex) in there for vertex in mesh.vertices) > 0.3 * len(mesh.vertices)


def _same(mesh, other):
    return all(np.array_equal(a, b) for a, b in zip(mesh[:6], other[:6]) if a is not None)


INTEGERS = [*"bhilqBHILQ", ">i2", ">i4", ">i8", ">u2", ">u4", ">u8"]
NUMBERS = [*INTEGERS, *"efdg", ">f2", ">f4", ">f8"]
OTHERS = [*"?FDGO", "U3", "S3", "M8[s]", "m8[s]", "V8", [("x", "f8")]]


def _unaligned(array):
    """The same numbers one byte beside where they should begin."""
    raw = np.zeros(array.nbytes + 1, np.uint8)
    out = raw[1:].view(array.dtype).reshape(array.shape)
    out[...] = array
    return out


def _with_gaps(array):
    """Each number is the middle one of three."""
    out = np.zeros((*array.shape, 3), array.dtype)
    out[..., 1] = array
    return out[..., 1]


def _of_records(array):
    """A field of records of odd size."""
    records = np.zeros(array.shape, [("before", "u1"), ("own", array.dtype), ("behind", "u2")])
    records["own"] = array
    return records["own"]


def _read_only(array):
    out = array.copy()
    out.flags.writeable = False
    return out


LAYOUTS = {
    "as they are": lambda a: a,
    "Fortran": np.asfortranarray,
    "rows backwards": lambda a: a[::-1].copy()[::-1],
    "all backwards": lambda a: np.flip(np.flip(a).copy()),
    "every other row": lambda a: np.repeat(a, 2, axis=0)[::2],
    "gaps": _with_gaps,
    "records": _of_records,
    "unaligned": _unaligned,
    "read-only": _read_only,
    "memoryview": lambda a: memoryview(a.astype(a.dtype.newbyteorder("="))),
    "lists": lambda a: a.tolist(),
}


def _small_mesh(is_padded):
    """A mesh whose numbers every type that is accepted can hold, with all arrays that a mesh may have."""
    chance = np.random.default_rng(7)
    vertices, faces = grid(8)
    vertices[:, 2] = chance.integers(0, 3, len(vertices))
    if is_padded:
        faces = np.column_stack([faces, np.full(len(faces), -1)])
    return {
        "vertices": vertices,
        "faces": faces,
        "uv": chance.integers(0, 9, (100, 2)),
        "face_uv": np.where(faces < 0, -1, (faces + chance.integers(0, 2)) % 100),
        "face_material": chance.integers(0, 2, len(faces)),
        "vertex_colors": chance.integers(0, 100, (len(vertices), 3)).astype(float),
    }


def _formed(array, kind, layout):
    """The numbers of an array as a type in a layout; None if there is no such array."""
    try:
        return LAYOUTS[layout](array.astype(kind))
    except (TypeError, ValueError, BufferError):
        return None


def _is_refused(name, array):
    """Whether an array is none of integers or, where any number will do, of numbers; or has lost its -1."""
    values = np.asarray(array)
    kinds = "iu" if name.startswith("face") else "iuf"
    return values.dtype.kind not in kinds or (name == "faces" and values.shape[1] > 3 and values.min() >= 0)


@pytest.fixture(scope="module")
def results():
    return {is_padded: drystone.simplify_mesh(**_small_mesh(is_padded), ratio=0.4) for is_padded in (False, True)}


@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_types_and_layouts_do_not_matter(results, data):
    is_padded = data.draw(st.booleans())
    arrays = _small_mesh(is_padded)
    layouts = {name: data.draw(st.sampled_from(list(LAYOUTS))) for name in arrays}
    kinds = {name: data.draw(st.sampled_from(INTEGERS if name.startswith("face") else NUMBERS)) for name in arrays}
    if data.draw(st.integers(0, 3)) == 0:
        kinds[data.draw(st.sampled_from(list(arrays)))] = data.draw(st.sampled_from(NUMBERS + OTHERS))
    given = {name: _formed(array, kinds[name], layouts[name]) for name, array in arrays.items()}
    assume(all(array is not None for array in given.values()))
    copies = {name: np.array(array) for name, array in given.items()}
    refused = [name for name in given if _is_refused(name, given[name])]
    if refused:
        with pytest.raises(InputError, match=rf"^({'|'.join(refused)})\b"):
            drystone.simplify_mesh(**given, ratio=0.4)
        return
    mesh = drystone.simplify_mesh(**given, ratio=0.4)
    for name, copy in copies.items():
        found, expected = getattr(mesh, name), getattr(results[is_padded], name)
        if name == "vertex_colors" and copy.dtype.kind in "iu":
            expected = np.rint(expected)
        if name in ("vertex_colors", "face_material"):
            expected = expected.astype(copy.dtype)
        assert found.dtype == expected.dtype and np.array_equal(found, expected), name
        assert found.flags.writeable and found.flags.c_contiguous, name
        assert np.array_equal(given[name], copy), name


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_arrays_without_a_number_are_refused_by_name(data):
    arrays = _small_mesh(is_padded=False)
    shapes = st.lists(st.integers(0, 5), min_size=1, max_size=3).filter(lambda shape: 0 in shape)
    for name in data.draw(st.lists(st.sampled_from(list(arrays)), min_size=1, unique=True)):
        empty = np.zeros(data.draw(shapes), data.draw(st.sampled_from(NUMBERS + OTHERS)))
        arrays[name] = data.draw(st.sampled_from([empty, empty.tolist()]))
    with pytest.raises(InputError, match=rf"^({'|'.join(arrays)})\b|^the mesh: no faces"):
        drystone.simplify_mesh(**arrays, ratio=0.5)


def test_texture_coordinates_that_no_face_has_may_be_none():
    vertices, faces = grid(8)
    none = np.full_like(faces, -1)
    plain = drystone.simplify_mesh(vertices, faces, ratio=0.4)
    mesh = drystone.simplify_mesh(vertices, faces, uv=np.zeros((0, 2)), face_uv=none, ratio=0.4)
    assert _same(mesh._replace(uv=None, face_uv=None), plain)
    assert mesh.uv.shape == (0, 2) and np.array_equal(mesh.face_uv, np.full_like(mesh.faces, -1))


def test_uv_of_vertices_come_back_as_such():
    vertices, faces = grid(12)
    uv = vertices[:, :2] / 12
    mesh = drystone.simplify_mesh(vertices, faces, uv=uv, ratio=0.3)
    assert mesh.face_uv is None and mesh.uv.shape == (len(mesh.vertices), 2)
    assert np.allclose(mesh.uv, mesh.vertices[:, :2] / 12, atol=0.05)
    colors = (vertices[:, :1] * [[10, 1, 5]]).astype(np.uint8)
    both = drystone.simplify_mesh(vertices, faces, uv=uv, vertex_colors=colors, ratio=0.3)
    assert both.vertex_colors.dtype == np.uint8 and len(both.vertex_colors) == len(both.vertices)
    assert np.abs(both.vertex_colors[:, 0] - both.vertices[:, 0] * 10).max() < 25


def test_vertices_of_a_seam_are_split_as_they_came(town):
    pairs, corners = np.unique(np.stack([town.faces, town.face_uv], axis=-1).reshape(-1, 2), axis=0, return_inverse=True)
    faces = corners.reshape(town.faces.shape)
    split = drystone.simplify_mesh(town.vertices[pairs[:, 0]], faces, uv=town.uv[pairs[:, 1]], ratio=0.2)
    whole = drystone.simplify_mesh(town.vertices, town.faces, uv=town.uv, face_uv=town.face_uv, ratio=0.2)
    assert len(split.uv) == len(split.vertices) > len(whole.vertices)
    assert len(np.unique(split.vertices, axis=0)) == len(np.unique(whole.vertices, axis=0))
    assert _uv_area(split.uv, split.faces) == pytest.approx(_uv_area(whole.uv, whole.face_uv), rel=1e-9)


def _uv_area(uv, ids):
    (ax, ay), (bx, by) = np.moveaxis(np.diff(uv[ids], axis=1), 1, 0).swapaxes(1, 2)
    return np.abs(ax * by - ay * bx).sum()


@pytest.mark.parametrize("materials", [[0, 1], [7, 3], [-1, 5], [2**40, -(2**40)]])
def test_materials_are_any_integers(materials):
    vertices, faces = grid(12)
    labels = np.where(vertices[faces].mean(axis=1)[:, 0] < 6, *materials)
    mesh = drystone.simplify_mesh(vertices, faces, face_material=labels, ratio=0.2)
    assert mesh.face_material.dtype == labels.dtype and set(mesh.face_material) == set(materials)
    is_left = mesh.vertices[mesh.faces].mean(axis=1)[:, 0] < 6
    assert np.array_equal(mesh.face_material, np.where(is_left, *materials))


def test_polygons_and_triangles():
    side = 12
    vertices, _ = grid(side)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    squares = corner[:, None] + np.array([[0, 1, side + 2, side + 1]])
    triangle = np.array([[*squares[0][:3], -1], [squares[0][0], *squares[0][2:], -1]])
    mixed = drystone.simplify_mesh(vertices, np.concatenate([squares[1:], triangle]), ratio=1.0)
    assert len(mixed.faces) == 2 * side * side
    assert len(drystone.simplify_mesh(vertices, squares, face_count=50).faces) == 50


def test_a_small_mesh_and_a_target_that_is_missed():
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert drystone.simplify_mesh(vertices, [[0, 1, 2]], ratio=1).faces.tolist() == [[0, 1, 2]]
    fins = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    corners = [*vertices, [0, 0, 1], [0, -1, 0]]
    with pytest.warns(drystone.TargetMissed):
        mesh = drystone.simplify_mesh(corners, fins, face_count=1, topology="keep", borders="lock")
    assert len(mesh.faces) == 3
    with pytest.raises(drystone.TargetMissedError) as caught:
        drystone.simplify_mesh(corners, fins, face_count=1, topology="keep", borders="lock", strict=True)
    assert caught.value.report.faces.output == 3


def test_faults_name_their_row():
    vertices, faces = grid(6)
    uv, face_uv = vertices[:, :2], faces.copy()

    def spoilt(array, place, value):
        out = np.array(array)
        out[place] = value
        return out

    cases = [
        (dict(vertices=spoilt(vertices, (7, 1), np.nan)), r"vertices\[7\]", 7),
        (dict(vertices=spoilt(vertices, (8, 2), 1e39)), r"vertices\[8\]", 8),
        (dict(faces=spoilt(faces, (17, 0), 99)), r"faces\[17\]: refers to 99; there are 49 vertices", 17),
        (dict(faces=spoilt(faces, (3, 1), -2)), r"faces\[3\]: refers to -2", 3),
        (dict(faces=spoilt(faces, (4, 2), -1)), r"faces\[4\]: expected at least 3", 4),
        (dict(faces=spoilt(np.pad(faces, ((0, 0), (0, 2)), constant_values=-1), (9, 4), 5), uv=None, face_uv=None), r"faces\[9\]: expected nothing but -1 behind", 9),
        (dict(faces=np.ma.array(faces, mask=faces == 3)), "faces: some of its numbers are masked", None),
        (dict(vertex_colors=spoilt(np.zeros((49, 3)), (5, 1), np.nan)), r"vertex_colors\[5\]", 5),
        (dict(vertices=np.full((49, 3), np.longdouble("1e400"))), r"vertices\[0\]", 0),
        (dict(uv=spoilt(uv, (2, 0), np.inf)), r"uv\[2\]", 2),
        (dict(face_uv=spoilt(face_uv, (5, 1), 49)), r"face_uv\[5\]: refers to 49; there are 49 uv", 5),
        (dict(face_uv=spoilt(face_uv, (6, 1), -2)), r"face_uv\[6\]", 6),
        (dict(vertices=vertices[:, :2]), "vertices: expected an array of shape", None),
        (dict(vertices=vertices.ravel()), "vertices: expected", None),
        (dict(faces=faces.astype(float)), "faces: expected integers, found float64", None),
        (dict(faces=faces[:, :2]), "faces: expected an array of shape", None),
        (dict(face_uv=face_uv[:-1]), "face_uv: expected the shape of faces", None),
        (dict(face_material=np.zeros(3, int)), "face_material: expected one for each of 72", None),
        (dict(vertex_colors=np.zeros((3, 3))), "vertex_colors: expected one for each of 49", None),
        (dict(vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), int), uv=None, face_uv=None), "no faces", None),
        (dict(faces=[[0, 1], [0, 1, 2]]), "faces:", None),
        (dict(vertices=np.array([["a", "b", "c"]])), "vertices: expected numbers", None),
    ]
    for changed, words, row in cases:
        arguments = {"vertices": vertices, "faces": faces, "uv": uv, "face_uv": face_uv, "ratio": 0.5, **changed}
        with pytest.raises(InputError, match=words) as caught:
            drystone.simplify_mesh(**arguments)
        assert caught.value.row == row and isinstance(caught.value, ValueError), words


def test_options_are_those_of_files():
    vertices, faces = grid(6)
    with pytest.raises(TypeError, match="'normals'"):
        drystone.simplify_mesh(vertices, faces, ratio=0.5, normals="drop")
    with pytest.raises(UsageError, match="give a target"):
        drystone.simplify_mesh(vertices, faces)
    with pytest.raises(UsageError, match="face_uv"):
        drystone.simplify_mesh(vertices, faces, face_uv=faces, ratio=0.5)


def test_a_bound_on_the_error_holds():
    vertices, faces = grid(40)
    mesh = drystone.simplify_mesh(vertices, faces, max_error=0.05)
    assert len(mesh.faces) < 0.5 * len(faces)
    assert mesh.report.error.measured.rms <= 0.05


def test_textures_are_baked(town):
    rng = np.random.default_rng(1)
    images = {i: rng.integers(0, 255, (32, 64, 3), dtype=np.uint8) for i in range(len(town.materials))}
    images[0][:] = [250, 10, 20]
    mesh = drystone.simplify_mesh(**town.arguments(), texture=images, textures="bake", ratio=0.1, texels=0.5)
    assert mesh.textures and all(image.dtype == np.uint8 and image.shape[2] == 3 for image in mesh.textures)
    assert set(np.unique(mesh.face_material)) == set(range(len(mesh.textures)))
    assert mesh.face_uv.min() >= 0 and 0 <= mesh.uv.min() and mesh.uv.max() <= 1
    assert mesh.report.bake.images == len(mesh.textures)


def test_a_baked_texture_shows_the_colours_of_the_old_one():
    vertices, faces = grid(30)
    uv = vertices[:, :2] / 30
    ramp = np.zeros((64, 64, 3), np.uint8)
    ramp[:, :, 0] = np.linspace(0, 255, 64)
    ramp[:, :, 1] = np.linspace(255, 0, 64)[:, None]
    mesh = drystone.simplify_mesh(vertices, faces, uv=uv, texture=ramp, textures="bake", ratio=0.2, texels=4)
    (image,) = mesh.textures
    height, width, _ = image.shape
    x = np.clip(mesh.uv[:, 0] * width, 0, width - 1).astype(int)
    y = np.clip((1 - mesh.uv[:, 1]) * height, 0, height - 1).astype(int)
    expected = np.column_stack([mesh.vertices[:, 0], mesh.vertices[:, 1]]) * 255 / 30
    assert np.abs(image[y, x, :2].astype(float) - expected).max() < 16


def test_a_bake_without_texture_is_refused():
    vertices, faces = grid(6)
    for arguments in ({}, {"uv": vertices[:, :2]}, {"texture": np.zeros((4, 4, 3), np.uint8)}):
        with pytest.raises(UsageError, match="needs `texture` and `uv`"):
            drystone.simplify_mesh(vertices, faces, textures="bake", ratio=0.5, **arguments)
    for texture in (np.zeros((4, 4, 2), np.uint8), np.zeros((4, 4, 3)), np.zeros((0, 4, 3), np.uint8)):
        with pytest.raises(InputError, match="texture: expected uint8"):
            drystone.simplify_mesh(vertices, faces, uv=vertices[:, :2], texture=texture, textures="bake", ratio=0.5)
    with pytest.raises(UsageError, match="which is missing"):
        drystone.simplify_mesh(vertices, faces, uv=vertices[:, :2], texture={0: 1}, textures="bake", ratio=0.5)
    image, labels = np.zeros((4, 4, 3), np.uint8), np.arange(len(faces)) % 2
    for texture, words in [({0: image}, "no image for material 1"), ({"0": image}, "found '0'"), ({0.5: image}, "0.5"), ({None: image}, "None")]:
        with pytest.raises(UsageError, match=words):
            drystone.simplify_mesh(vertices, faces, uv=vertices[:, :2], face_material=labels, texture=texture, textures="bake", ratio=0.5)
    with pytest.raises(UsageError, match="needs `textures='bake'`"):
        drystone.simplify_mesh(vertices, faces, uv=vertices[:, :2], texture=image, ratio=0.5)
    with pytest.raises(UsageError, match="images are `texture`"):
        drystone.simplify_mesh(vertices, faces, uv=vertices[:, :2], textures=image, ratio=0.5)


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint32, np.int64, np.uint64, np.float32, np.float64])
def test_colours_of_any_kind_keep_their_range(kind):
    vertices, faces = grid(6)
    top = np.iinfo(kind).max if np.issubdtype(kind, np.integer) else 1.0
    colors = np.zeros((len(vertices), 3), kind)
    colors[:, 0] = top
    mesh = drystone.simplify_mesh(vertices, faces, vertex_colors=colors, ratio=0.5)
    assert mesh.vertex_colors.dtype == kind
    assert np.all(mesh.vertex_colors == np.array([top, 0, 0], kind))


@pytest.mark.parametrize("mode", ["RGBA", "LA", "P", "array"])
def test_alpha_of_a_texture_is_left_out_with_a_warning(mode):
    image_class = pytest.importorskip("PIL.Image")
    vertices, faces = grid(6)
    pixels = np.full((8, 8, 4), [100, 100, 100, 255], np.uint8)

    def bake():
        image = image_class.fromarray(pixels)
        texture = pixels if mode == "array" else image if mode == "RGBA" else image.convert(mode)
        if mode == "P" and pixels[2, 2, 3] < 255:
            texture.info["transparency"] = 0
        return drystone.simplify_mesh(vertices, faces, uv=vertices[:, :2] / 6, texture=texture, textures="bake", ratio=0.5)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        opaque = bake()
    pixels[2:4, 2:4, 3] = 0
    with pytest.warns(UserWarning, match="alpha is left out"):
        found = bake()
    assert found.textures[0].shape[2] == 3
    assert np.array_equal(opaque.textures[0], found.textures[0])
    with pytest.raises(InputError, match=r"vertex_colors: expected an array of shape \(n, 3\)"):
        drystone.simplify_mesh(vertices, faces, vertex_colors=np.ones((len(vertices), 4)), ratio=0.5)


def test_messages_and_reports_name_arrays_and_no_file(tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    vertices, faces = grid(12)
    face_uv = faces.copy()
    face_uv[3, 1] = -1
    for work in (None, "a folder"):
        mesh = drystone.simplify_mesh(vertices, faces, uv=vertices[:, :2], face_uv=face_uv, ratio=0.3, work=work)
        (warning,) = mesh.report.warnings
        assert warning.startswith("partial texcoords: faces[3]: only some corners")
        assert mesh.report.input == mesh.report.inputs[0] == "the mesh" and mesh.report.output == "the result"
        assert mesh.report.options.work == (work and str(tmp_path / work))
        assert ".drystone" not in str(mesh.report.to_dict()) + caplog.text
    with pytest.raises(InputError, match="^the mesh: no faces"):
        drystone.simplify_mesh(vertices, [[0, 0, 1]], ratio=0.3)


def test_the_target_that_was_missed_has_the_mesh():
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]]
    with pytest.raises(drystone.TargetMissedError) as caught:
        drystone.simplify_mesh(corners, [[0, 1, 2], [1, 0, 3], [0, 1, 4]], face_count=1, topology="keep", borders="lock", strict=True)
    assert caught.value.mesh.faces.shape == (3, 3)


def test_files_of_others_in_the_work_folder_stay(tmp_path):
    vertices, faces = grid(12)
    names = ["input.drystone", "result.drystone", "input-0.png", "notes.txt"]
    for name in names:
        (tmp_path / name).write_text("mine")
    image = np.full((8, 8, 3), 100, np.uint8)
    for options in ({}, {"uv": vertices[:, :2] / 12, "texture": image, "textures": "bake"}):
        drystone.simplify_mesh(vertices, faces, ratio=0.3, work=tmp_path, **options)
        assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
        assert all((tmp_path / name).read_text() == "mine" for name in names)
    (tmp_path / "empty").mkdir()
    drystone.simplify_mesh(vertices, faces, ratio=0.3, work=tmp_path / "empty")
    assert list((tmp_path / "empty").iterdir()) == []


def test_a_work_folder_may_have_any_name(tmp_path):
    work = tmp_path / "input-meshes" / "input-0"
    work.mkdir(parents=True)
    vertices, faces = grid(12)
    drystone.simplify_mesh(vertices, faces, ratio=0.3, work=work)
    assert list(work.iterdir()) == [] and [path.name for path in tmp_path.iterdir()] == ["input-meshes"]


def test_half_written_files_of_dead_processes_of_this_machine_go(tmp_path):
    (host,) = {name.split(".")[1] for name in half_written(tmp_path)}
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        dead = process.pid
    alive = os.getpid()
    names = {
        f"input-ab_1.{host}.{dead}.partial": False,
        f"image-ab_1.{host}.{dead}.partial": False,
        f"input-ab_1.{host}.{alive}.partial": True,
        f"input-ab_1.elsewhere.{dead}.partial": True,
        f"input-ab_1.{dead}.partial": True,
        f"notes.{host}.{dead}.partial": True,
    }
    for name in names:
        (tmp_path / name).write_text("")
    vertices, faces = grid(12)
    drystone.simplify_mesh(vertices, faces, ratio=0.3, work=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {name for name, stays in names.items() if stays}


def half_written(folder):
    """Names of the files in a folder while a job writes its input there."""
    job = array_job.ArrayJob(folder)
    with job._named("input-", ".drystone"):
        names = [path.name for path in folder.iterdir()]
    (path,) = folder.iterdir()
    path.unlink()
    return names


@pytest.mark.skipif(sys.platform == "win32", reason="ctypes asks the system there")
@pytest.mark.parametrize("handle, code, error, is_alive", [(0, 0, 87, False), (0, 0, 5, True), (7, 0, 0, False), (7, 259, 0, True)])
def test_whether_a_process_runs_on_windows_is_asked_without_a_signal(monkeypatch, handle, code, error, is_alive):
    closed = []

    def exit_code(_, found):
        found._obj.value = code
        return 1

    def open_process(*_):
        return handle

    kernel = SimpleNamespace(OpenProcess=open_process, GetExitCodeProcess=exit_code, CloseHandle=closed.append)
    monkeypatch.setattr(ctypes, "WinDLL", lambda *_, **__: kernel, raising=False)
    monkeypatch.setattr(ctypes, "get_last_error", lambda: error, raising=False)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(os, "kill", lambda *_: pytest.fail("a signal"))
    assert array_job._is_alive(4711) == is_alive
    assert len(closed) == (handle > 0)


def test_what_is_refused_leaves_nothing_in_the_work_folder(tmp_path):
    vertices, faces = grid(12)
    for arguments in ({"ratio": 2}, {}, {"ratio": 0.5, "memory": "1MiB"}, {"ratio": 0.5, "faces": faces + 500}):
        with pytest.raises(ValueError):
            drystone.simplify_mesh(**{"vertices": vertices, "faces": faces, **arguments}, work=tmp_path / "work")
        assert not (tmp_path / "work").exists()


def test_a_work_folder_that_cannot_be(tmp_path):
    vertices, faces = grid(6)
    (tmp_path / "file").write_text("")
    for work in (tmp_path / "file", tmp_path / "file" / "below", "/proc/nowhere"):
        with pytest.raises(drystone.IoError):
            drystone.simplify_mesh(vertices, faces, ratio=0.5, work=work)


def test_nothing_is_left_in_the_temporary_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    import tempfile

    monkeypatch.setattr(tempfile, "tempdir", None)
    vertices, faces = grid(12)
    drystone.simplify_mesh(vertices, faces, ratio=0.3)
    with pytest.raises(InputError):
        drystone.simplify_mesh(vertices, faces + 100, ratio=0.3)
    assert list(tmp_path.iterdir()) == []
    drystone.simplify_mesh(vertices, faces, ratio=0.3, work=tmp_path / "work")
    assert list(tmp_path.iterdir()) == []


def test_an_array_file_is_a_mesh_for_every_command(tmp_path, town):
    drystone.simplify(TOWN, tmp_path / "a.drystone", ratio=0.2)
    drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.2)
    compared = drystone.compare(tmp_path / "a.obj", tmp_path / "a.drystone", samples=1000)
    assert compared.geometry.symmetric.max < 1e-3
    assert drystone.inspect(tmp_path / "a.drystone").triangles == drystone.inspect(tmp_path / "a.obj").triangles
    start = (tmp_path / "a.drystone").read_bytes()[:16]
    assert struct.unpack("<8sQ", start) == (b"drystone", 1)


numbers = st.floats(-1e6, 1e6) | st.sampled_from([np.nan, np.inf, -0.0, 1e300, 5e-324])


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_whatever_the_arrays_hold_the_result_is_sound_or_the_fault_is_named(data):
    count = data.draw(st.integers(0, 12))
    width = data.draw(st.integers(3, 5))
    vertices = data.draw(st.lists(st.lists(numbers, min_size=3, max_size=3), min_size=count, max_size=count))
    rows = st.lists(st.integers(-2, count + 1), min_size=width, max_size=width)
    faces = data.draw(st.lists(rows, max_size=12))
    labels = data.draw(st.none() | st.lists(st.integers(-5, 5), min_size=len(faces), max_size=len(faces)))
    uv = data.draw(st.none() | st.lists(st.lists(st.floats(0, 1), min_size=2, max_size=2), min_size=1, max_size=4))
    face_uv = None if uv is None else data.draw(st.lists(st.lists(st.integers(-2, len(uv)), min_size=width, max_size=width), min_size=len(faces), max_size=len(faces)))
    arrays = {
        "vertices": np.array(vertices, float).reshape(-1, 3),
        "faces": np.array(faces, int).reshape(-1, width),
        "uv": uv,
        "face_uv": None if face_uv is None else np.array(face_uv, int).reshape(-1, width),
        "face_material": labels,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", drystone.TargetMissed)
        try:
            mesh = drystone.simplify_mesh(**arrays, ratio=data.draw(st.sampled_from([0.1, 0.5, 1.0])), threads=1)
        except InputError as error:
            assert error.row is None or f"[{error.row}]" in str(error)
            return
    assert np.isfinite(mesh.vertices).all()
    assert 0 <= mesh.faces.min() and mesh.faces.max() < len(mesh.vertices)
    assert set(mesh.faces.ravel()) == set(range(len(mesh.vertices)))
    if mesh.face_uv is not None:
        assert -1 <= mesh.face_uv.min() and mesh.face_uv.max() < len(mesh.uv)
    if labels is not None:
        assert set(mesh.face_material) <= set(labels)
