"""Closed stays closed, and every miniature comes through with what it stands for."""

import numpy as np
import pytest

import objlib
from hostile import write_hostile
from miniatures import MINIATURES, sphere


def test_closed_sphere_stays_closed_in_many_clusters(drystone, tmp_path):
    position, face = sphere(6)
    source = tmp_path / "sphere.obj"
    objlib.write(source, position, face)
    run = drystone.simplify(source, tmp_path, "--ratio", 0.1, "--cluster-faces", 4000)
    assert run.report["passes"][0]["clusters"] >= 16
    mesh, found = run.mesh, objlib.topology(run.mesh)
    assert (found.border_edges, found.non_manifold_edges, found.euler, found.pieces) == (0, 0, 2, 1)
    assert abs(len(mesh.face) - round(0.1 * len(face))) <= 8
    assert np.abs(np.linalg.norm(mesh.position, axis=1) - 1).max() < 0.01


@pytest.fixture(scope="module")
def rooms(tmp_path_factory):
    source = tmp_path_factory.mktemp("rooms") / "rooms.obj"
    write_hostile(source, "rooms", 100_000)
    return source


@pytest.mark.parametrize("ratio, error", [(0.1, 0.05), (0.03, 0.05), (0.005, 1.0)])
def test_rooms_with_doubled_walls_and_t_junctions_come_to_their_target(drystone, tmp_path, rooms, ratio, error):
    """Rooms have a side of 4, their walls are rough by 0.03; at half a percent there are fewer triangles than walls."""
    run = drystone.simplify(rooms, tmp_path, "--ratio", ratio)
    was, now = objlib.topology(objlib.read(rooms)), objlib.topology(run.mesh)
    assert was.non_manifold_edges > 5000
    assert now.non_manifold_edges <= was.non_manifold_edges
    assert now.border_edges <= was.border_edges
    asked, got = run.report["faces"]["target"], len(run.mesh.face)
    assert asked - 2 <= got <= asked
    assert run.report["error"]["measured"]["rms"] < error


@pytest.fixture(params=[make.__name__ for make in MINIATURES])
def halved(request, drystone, tmp_path):
    """(name, input mesh, output mesh) at half the triangles; what cannot be halved says so with exit code 3."""
    source = objlib.FIXTURES / "miniatures" / f"{request.param}.obj"
    run = drystone.simplify(source, tmp_path, "--ratio", 0.5, codes=(0, 3))
    return request.param, objlib.read(source), run.mesh


def test_miniature_keeps_what_it_stands_for(halved):
    name, before, after = halved
    was, now = objlib.topology(before), objlib.topology(after)
    assert not after.faults and 0 < len(after.face) <= len(before.face)
    assert now.border_loops <= was.border_loops
    assert now.non_manifold_edges <= was.non_manifold_edges
    assert now.pieces == was.pieces
    assert set(after.material) == set(before.material)
    if was.border_edges == 0:
        assert (now.border_edges, now.euler) == (0, was.euler)
    if len(before.texcoord):
        assert (after.face_uv >= 0).all() and (objlib.uv_areas(after) >= -1e-9).all()
    if name == "coloured_sphere":
        # The colour of a point on this sphere is its position.
        assert np.abs(after.colour - (0.5 + 0.5 * after.position)).max() < 0.25
    if name == "normals_box":
        assert (after.face_normal >= 0).all()
        a, b, c = (after.position[after.face[:, k]] for k in range(3))
        flat = np.cross(b - a, c - a)
        flat /= np.linalg.norm(flat, axis=1)[:, None]
        assert (flat[:, None] * after.normal[after.face_normal]).sum(axis=2).min() > 0.99


def test_normals_can_be_dropped(drystone, tmp_path):
    source = objlib.FIXTURES / "miniatures" / "normals_box.obj"
    run = drystone.simplify(source, tmp_path, "--ratio", 0.5, "--normals", "drop", codes=(0, 3))
    assert len(run.mesh.normal) == 0


def test_closed_polygons_are_counted_as_triangles(drystone, tmp_path):
    source = objlib.FIXTURES / "miniatures" / "ngons_concave.obj"
    run = drystone.simplify(source, tmp_path, "--ratio", 0.5, codes=(0, 3))
    assert run.report["faces"]["input"] == 36
