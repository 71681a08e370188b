"""The committed fixtures are what tools/fixtures writes, and hold what their names say."""

import numpy as np
import pytest
from PIL import Image

import objlib
from miniatures import MINIATURES, checker, write_miniatures
from paint import TEXTURES, paint
from town import write_town

MINIATURE_FOLDER = objlib.FIXTURES / "miniatures"


def miniature(name):
    return objlib.read(MINIATURE_FOLDER / f"{name}.obj")


def test_miniatures_are_written_with_the_committed_bytes(tmp_path):
    write_miniatures(tmp_path, textures=False)
    for path in sorted(tmp_path.iterdir()):
        assert path.read_bytes() == (MINIATURE_FOLDER / path.name).read_bytes(), path.name


def test_town_is_written_with_the_committed_bytes(tmp_path):
    write_town(tmp_path, 2, 2, textures=False)
    for path in sorted(tmp_path.iterdir()):
        assert path.read_bytes() == (objlib.FIXTURES / "town" / path.name).read_bytes(), path.name


@pytest.mark.parametrize("material", TEXTURES)
def test_town_textures_show_what_is_painted(material):
    """Pixel for pixel in PNG; close to it in JPEG, whose encoders differ."""
    name = TEXTURES[material][0]
    committed = np.asarray(Image.open(objlib.FIXTURES / "town" / name).convert("RGB"), int)
    painted = np.asarray(paint(material), int)
    difference = np.abs(committed - painted)
    assert difference.max() == 0 if name.endswith("png") else difference.mean() < 8


def test_checker_shows_what_is_painted():
    assert np.array_equal(np.asarray(Image.open(MINIATURE_FOLDER / "checker.png")), np.asarray(checker()))


def test_every_miniature_reads_without_faults_and_is_small():
    for make in MINIATURES:
        mesh = miniature(make.__name__)
        assert not mesh.faults and 0 < len(mesh.face) < 400, make.__name__


def test_town_is_one_welded_manifold_with_seams_holes_and_four_materials(town):
    found = objlib.topology(town)
    assert found.pieces == 1 and found.non_manifold_edges == 0 and found.border_loops > 5
    assert set(town.material) == set(TEXTURES)
    assert len(objlib.seam_wedges(town)) > 0.2 * len(town.position)
    assert (objlib.uv_areas(town) > 0).all()
    assert town.position[:, 0].min() > 430_000 and town.position[:, 1].min() > 4_580_000


def test_blocks_of_a_larger_town_share_their_vertices(tmp_path):
    write_town(tmp_path, 3, 4, seed=5, textures=False)
    mesh = objlib.read(tmp_path / "town.obj")
    found = objlib.topology(mesh)
    assert found.pieces == 1 and found.non_manifold_edges == 0
    assert len(np.unique(mesh.position, axis=0)) == len(mesh.position)


def test_miniatures_hold_what_their_names_say():
    assert len(objlib.seam_wedges(miniature("seam_strip"))) == 13
    assert max(len(t) for t in objlib.seam_wedges(miniature("three_chart_corner")).values()) == 3
    assert objlib.topology(miniature("open_border_disk")).border_loops == 1
    assert objlib.topology(miniature("non_manifold_fin")).non_manifold_edges == 6
    assert len(miniature("cube_24_vertices").position) == 24
    assert set(miniature("two_materials_plane").material) == {"checker", "plain"}
    assert miniature("coloured_sphere").colour is not None
    assert len(miniature("normals_box").normal) == 6
    for closed in ("closed_sphere", "coloured_sphere", "cube_24_vertices", "normals_box", "ngons_concave"):
        found = objlib.topology(miniature(closed))
        assert found.border_edges == 0 and found.euler == 2, closed
