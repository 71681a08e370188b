"""Meshes for the tests: fixtures as files, and as arrays."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
TOWN = ROOT / "fixtures" / "town" / "town.obj"
MINIATURES = ROOT / "fixtures" / "miniatures"


@dataclass
class Obj:
    """The numbers of an OBJ, in its order; -1 for what a corner does not have."""

    vertices: np.ndarray
    colors: np.ndarray | None
    uv: np.ndarray | None
    faces: np.ndarray
    face_uv: np.ndarray | None
    materials: list[str]
    face_material: np.ndarray | None

    def arguments(self) -> dict[str, Any]:
        """Keywords of `simplify_mesh`."""
        return {
            "vertices": self.vertices,
            "faces": self.faces,
            "uv": self.uv,
            "face_uv": self.face_uv,
            "face_material": self.face_material,
            "vertex_colors": self.colors,
        }


def read_obj(path: Path) -> Obj:
    """Reads an OBJ of plain statements."""
    vertices, colors, uv, faces, face_uv, face_material = [], [], [], [], [], []
    materials: list[str] = []
    current = -1

    def index(word: str, known: list) -> int:
        return int(word) - 1 if int(word) > 0 else len(known) + int(word)

    for line in path.read_text(encoding="latin-1").splitlines():
        match line.split():
            case ["v", x, y, z, *rest]:
                vertices.append([float(x), float(y), float(z)])
                colors.append([float(c) for c in rest[:3]])
            case ["vt", u, v, *_]:
                uv.append([float(u), float(v)])
            case ["usemtl", name]:
                if name not in materials:
                    materials.append(name)
                current = materials.index(name)
            case ["f", *corners]:
                parts = [corner.split("/") for corner in corners]
                faces.append([index(part[0], vertices) for part in parts])
                face_uv.append([index(part[1], uv) if len(part) > 1 and part[1] else -1 for part in parts])
                face_material.append(current)

    def table(rows: list[list[int]]) -> np.ndarray:
        out = np.full((len(rows), max(3, *(len(row) for row in rows))), -1)
        for place, row in zip(out, rows):
            place[: len(row)] = row
        return out

    return Obj(
        np.array(vertices),
        np.array(colors) if all(colors) else None,
        np.array(uv) if uv else None,
        table(faces),
        table(face_uv) if uv else None,
        materials,
        np.array(face_material) if materials else None,
    )


@pytest.fixture(scope="session")
def town() -> Obj:
    return read_obj(TOWN)


def grid(side: int) -> tuple[np.ndarray, np.ndarray]:
    """A wavy square of 2 × side × side triangles."""
    x, y = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0))
    z = np.sin(x / 3) + np.cos(y / 5)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    lower, upper = [corner, corner + 1, corner + side + 2], [corner, corner + side + 2, corner + side + 1]
    faces = np.concatenate([np.column_stack(lower), np.column_stack(upper)])
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()]), faces
