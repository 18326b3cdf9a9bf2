"""[solver] as a strict model: an external program in place of the built-in solver."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from idic.experiment_file.schema_base import Positive, Strict, refuse

FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")]  # no folders: it lies beside the deck


class SolverTable(Strict):
    """``template``: the deck, written into a folder of each run without its ending ``.template``; ``files``: copied
    beside it; ``mesh``: the mesh of the experiment is written there under this name, with these ``element_types``;
    ``command``: arguments, with {job} and {deck}; ``reader``: who reads the results; ``time``: what the deck counts in.
    """

    kind: Literal["external"]
    template: str
    files: list[str] = []
    mesh: FileName | None = None
    element_types: dict[Literal["tri3", "tri6", "quad4", "quad8", "tet4", "tet10", "hex8"],
                        Annotated[str, Field(pattern=r"^[A-Za-z0-9_]{1,16}$")]] = {}
    command: Annotated[list[Annotated[str, Field(min_length=1, pattern=r"^[^\x00]*$")]], Field(min_length=1)]
    reader: Literal["calculix_frd", "calculix_dat", "csv"]
    time: Literal["seconds", "frames"] = "seconds"
    timeout_s: Positive = 3600.0
    retries: Annotated[int, Field(ge=0, le=10)] = 1
    environment: dict[str, str] = {}

    @model_validator(mode="after")
    def _mesh_types(self):
        if self.element_types and self.mesh is None:
            raise refuse("element types without a mesh to write", 'mesh = "mesh.inp" beside element_types',
                         "add mesh, or leave element_types out", "no mesh")
        return self
