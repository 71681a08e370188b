"""One peer with a Python interface, from OBJ to OBJ in a process of its own: read, simplify, write.

    python3 tools/peers/simplify.py TOOL INPUT OUTPUT --ratio 0.1

Each tool reads and writes with the loader that comes with it; fast-simplification has none and takes VTK's. Prints one line
of JSON: triangles in and out, and seconds for the three steps. Nothing of the other tools is loaded.
"""

import argparse
import json
import os
import time

# Where Debian keeps the plugins without which PyMeshLab reads no JPEG, and takes all materials for one.
QT_PLUGINS = "/usr/lib/x86_64-linux-gnu/qt5/plugins"


class Steps:
    """Seconds between one call and the next."""

    def __init__(self):
        self.last, self.seconds = time.monotonic(), {}

    def done(self, name):
        now = time.monotonic()
        self.seconds[f"{name}_s"], self.last = round(now - self.last, 3), now


def pymeshlab(source, result, ratio, steps, filter_name="meshing_decimation_quadric_edge_collapse"):
    if os.path.isdir(QT_PLUGINS):
        os.environ.setdefault("QT_PLUGIN_PATH", QT_PLUGINS)
    import pymeshlab as library

    meshes = library.MeshSet(verbose=False)
    meshes.load_new_mesh(source)
    count = meshes.current_mesh().face_number()
    steps.done("read")
    meshes.apply_filter(filter_name, targetfacenum=int(count * ratio))
    steps.done("simplify")
    meshes.save_current_mesh(result, save_textures=False)
    return count, meshes.current_mesh().face_number()


def pymeshlab_texture(source, result, ratio, steps):
    return pymeshlab(source, result, ratio, steps, "meshing_decimation_quadric_edge_collapse_with_texture")


def open3d(source, result, ratio, steps):
    import open3d as library

    mesh = library.io.read_triangle_mesh(source)
    count = len(mesh.triangles)
    steps.done("read")
    mesh = mesh.simplify_quadric_decimation(int(count * ratio))
    steps.done("simplify")
    library.io.write_triangle_mesh(result, mesh, write_vertex_normals=False, write_triangle_uvs=False)
    return count, len(mesh.triangles)


def read_vtk(source):
    from vtkmodules.vtkCommonDataModel import vtkPolyData
    from vtkmodules.vtkIOGeometry import vtkOBJReader

    reader = vtkOBJReader()
    reader.SetFileName(source)
    reader.Update()
    # Places and triangles alone: the reader repeats vertices at seams and names materials in fields, on which the writer
    # crashes once triangles are gone.
    mesh = vtkPolyData()
    mesh.SetPoints(reader.GetOutput().GetPoints())
    mesh.SetPolys(reader.GetOutput().GetPolys())
    return mesh


def write_vtk(mesh, result):
    from vtkmodules.vtkIOGeometry import vtkOBJWriter

    writer = vtkOBJWriter()
    writer.SetFileName(result)
    writer.SetInputData(mesh)
    writer.Write()


def vtk(source, result, ratio, steps):
    from vtkmodules.vtkFiltersCore import vtkCleanPolyData, vtkQuadricDecimation

    mesh = read_vtk(source)
    steps.done("read")
    clean = vtkCleanPolyData()
    clean.SetInputData(mesh)
    clean.SetTolerance(0.0)
    clean.PointMergingOn()
    clean.Update()
    count = clean.GetOutput().GetNumberOfPolys()
    decimation = vtkQuadricDecimation()
    decimation.SetInputConnection(clean.GetOutputPort())
    decimation.SetTargetReduction(1.0 - ratio)
    decimation.Update()
    steps.done("simplify")
    write_vtk(decimation.GetOutput(), result)
    return count, decimation.GetOutput().GetNumberOfPolys()


def fast_simplification(source, result, ratio, steps):
    import fast_simplification as library
    import numpy
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    mesh = read_vtk(source)
    places = vtk_to_numpy(mesh.GetPoints().GetData())
    faces = vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    steps.done("read")
    # Vertices at one place are made one, or the mesh falls apart along the seams.
    places, index = numpy.unique(places, axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces].astype(numpy.int32)
    points, triangles = library.simplify(places, faces, target_count=int(len(faces) * ratio))
    steps.done("simplify")
    out, corners = vtkPolyData(), vtkCellArray()
    out_points = vtkPoints()
    out_points.SetData(numpy_to_vtk(numpy.ascontiguousarray(points), deep=True))
    out.SetPoints(out_points)
    corners.SetData(3, numpy_to_vtkIdTypeArray(numpy.ascontiguousarray(triangles, dtype=numpy.int64).reshape(-1), deep=True))
    out.SetPolys(corners)
    write_vtk(out, result)
    return len(faces), len(triangles)


def meshoptimizer(source, result, ratio, steps, flags=0):
    """Positions alone; `flags` as in meshoptimizer.h, or None for its sloppy mode."""
    import meshoptimizer as library
    import numpy

    places, faces = [], []
    with open(source, errors="replace") as lines:
        for line in lines:
            words = line.split()
            if words[:1] == ["v"]:
                places.append([float(word) for word in words[1:4]])
            elif words[:1] == ["f"]:
                corners = [int(word.split("/")[0]) for word in words[1:]]
                corners = [corner - 1 if corner > 0 else len(places) + corner for corner in corners]
                faces += [[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]
    places = numpy.array(places)
    centre = places.mean(axis=0)
    places, index = numpy.unique(places, axis=0, return_inverse=True)
    corners = index.reshape(-1)[numpy.array(faces).reshape(-1)].astype(numpy.uint32)
    local = numpy.ascontiguousarray(places - centre, dtype=numpy.float32)
    steps.done("read")
    kept = numpy.zeros_like(corners)
    target = dict(target_index_count=3 * int(len(faces) * ratio), target_error=1e9)
    if flags is None:
        count = library.simplify_sloppy(kept, corners, local, **target)
    else:
        count = library.simplify(kept, corners, local, options=flags, **target)
    steps.done("simplify")
    with open(result, "w") as out:
        out.writelines(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in places)
        out.writelines(f"f {a} {b} {c}\n" for a, b, c in kept[:count].reshape(-1, 3) + 1)
    return len(faces), count // 3


def meshoptimizer_permissive(source, result, ratio, steps):
    return meshoptimizer(source, result, ratio, steps, flags=1 << 5)


def meshoptimizer_sloppy(source, result, ratio, steps):
    return meshoptimizer(source, result, ratio, steps, flags=None)


TOOLS = {
    "meshoptimizer": meshoptimizer,
    "meshoptimizer-permissive": meshoptimizer_permissive,
    "meshoptimizer-sloppy": meshoptimizer_sloppy,
    "pymeshlab": pymeshlab,
    "pymeshlab-texture": pymeshlab_texture,
    "fast-simplification": fast_simplification,
    "open3d": open3d,
    "vtk": vtk,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tool", choices=TOOLS)
    parser.add_argument("input")
    parser.add_argument("output")
    parser.add_argument("--ratio", type=float, required=True)
    options = parser.parse_args()
    steps = Steps()
    faces_in, faces_out = TOOLS[options.tool](options.input, options.output, options.ratio, steps)
    steps.done("write")
    print(json.dumps({"faces_in": int(faces_in), "faces_out": int(faces_out), **steps.seconds}))


if __name__ == "__main__":
    main()
