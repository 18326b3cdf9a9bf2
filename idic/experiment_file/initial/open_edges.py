"""`idic init`: the free edges around points as degrees of freedom, as the points do not reach them."""

from __future__ import annotations

from collections.abc import Sequence

from idic.fe import EDGE_STD_SHARE, OUTLINE
from idic.readers import PointOutline


def open_edges(point_outline: PointOutline, pitch: float, ends: Sequence[str]) -> str:
    """The tables [[dof]] of the free edges, each with a distance of its own.

    ends : names of the driven sides, which do not move
    """
    driven_edges = {number for name, numbers in point_outline.ends.items() if name in ends
                    for number in numbers}
    names = [*(f"EDGE{k}" for k in range(1, len(point_outline.outline) + 1) if k not in driven_edges),
             *(f"HOLE{k}" for k in range(1, len(point_outline.holes) + 1))]
    lines = ["# facets end half their width before an edge, and their grid shows it within half a distance: how far",
             "# the free edges lie outside of this mesh is identified, too; leave it out where outline_mm draws them"]
    for name in names:
        lines += ["[[dof]]", f'name = "{OUTLINE}.{name}"',
                  f"prior = {{ mean = 0.0, std = {EDGE_STD_SHARE * pitch:.2g} }}"]
    return "\n".join([*lines, ""])


def open_rectangle(pitch: float) -> str:
    """The table [[dof]] of the free edges of a rectangle around the points, all with one distance."""
    return "\n".join([
        "# facets end half their width before an edge: how far the free edges lie outside of this mesh is open, too;",
        "# a plain strip hardly tells it, and ± of E by the force counts it; with the true margins above, leave it out",
        "[[dof]]", f'name = "{OUTLINE}"', f"prior = {{ mean = 0.0, std = {EDGE_STD_SHARE * pitch:.2g} }}", ""])
