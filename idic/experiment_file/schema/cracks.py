"""[[crack]]: a cut of a sheet that grows along a path.

``name``; ``path_mm``: corner points in the axes of the mesh, the first one where it begins (on or beside an edge, or
inside), the last one where it cannot get beyond; ``length_mm``: of the open part, a number or ``{ value = 3, identify =
true }``; ``knots``: frames between which the length is linear in time, each with a length of its own (before the first
and after the last one it stays); ``lengths_mm``: where those start, ``length_mm`` unless given. Degrees of freedom
``crack.NAME.length``, with knots ``crack.NAME.length_knot[FRAME]``.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from idic.experiment_file.schema.base import NotNegative, Pair, Strict, as_value_table, refuse
from idic.experiment_file.schema.materials import ParameterTable


class CrackTable(Strict):
    """A crack, see above."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]
    path_mm: Annotated[list[Pair], Field(min_length=2)]
    length_mm: Annotated[ParameterTable, BeforeValidator(as_value_table)]
    knots: list[int] = []
    lengths_mm: list[NotNegative] = []

    @model_validator(mode="after")
    def _lengths_of_knots(self):
        if self.knots != sorted(set(self.knots)):
            raise refuse("knots that do not increase", "numbers of frames in increasing order, each once",
                         "sort the knots", str(self.knots))
        if self.lengths_mm and self.length_mm.unit is not None:
            raise refuse("lengths in two units", "lengths_mm, and length_mm without a unit", "leave the unit out",
                         self.length_mm.unit)
        if self.lengths_mm and len(self.lengths_mm) != len(self.knots):
            raise refuse("another number of lengths than of knots", f"{len(self.knots)} lengths",
                         "give one length per knot, or leave lengths_mm out", f"{len(self.lengths_mm)}")
        return self
