"""The gauge of the necking specimen as a mesh in pixels of its first image.

    python studies/evidence/real_cameras/necking_mesh.py mesh.inp [ELEMENT_PX]

The edges are the limits of the texture in the first image (frame 151), inclined by half a degree and slightly tapered.
"""

from __future__ import annotations

import sys
from pathlib import Path

from idic.fe import make_mesh
from idic.virtual_tests import Patch, mesh_patches, write_inp

TOP, BOTTOM = 260.0, 1600.0  # rows, between the fillets


def edges(row: float) -> tuple[float, float]:
    """Columns of the left and right edge in a row of the first image, px."""
    return 311.0 - 0.0075 * (row - 300.0), 552.0 - 0.0100 * (row - 300.0)


def gauge(element_px: float):
    """A mesh of 4-node elements; idic raises them to 8 nodes."""
    def shape(s, t):
        row = TOP + (BOTTOM - TOP) * t
        left_edge, right_edge = edges(row)
        return left_edge + (right_edge - left_edge) * s, row

    columns, rows = round(240.0 / element_px), round((BOTTOM - TOP) / element_px)
    nodes, cells = mesh_patches([Patch(shape, columns, rows)], "quad4")
    return make_mesh(nodes, [("quad4", cells)])


if __name__ == "__main__":
    size = float(sys.argv[2]) if len(sys.argv) > 2 else 30.0
    write_inp(gauge(size), Path(sys.argv[1]), "gauge of the necking specimen, px")
