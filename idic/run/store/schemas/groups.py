"""Schemas of the attributes of groups of ``run.zarr``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from idic.run.store.schemas.types import Count, Finite, Hex, Part, Sha256


class StoredSystem(Part):
    """``ident`` of an evaluated system."""

    generalised: bool
    predicts: bool
    increments: int


class StoredSimulation(Part):
    """``ident`` of a simulation."""

    values: dict[str, Hex]


class StoredDiscrepancy(Part):
    """``ident`` of the normal equations of a discrepancy, or why there are none."""

    reason: str
    names: list[str] = []
    components: list[str] = []
    motion_px: dict[str, Finite] = {}
    may_be_rough: bool = False
    mesh_size_only: bool = False

    @model_validator(mode="after")
    def _of_parameters(self) -> StoredDiscrepancy:
        if not self.reason and not (self.names and self.motion_px):
            raise ValueError("normal equations of no parameters")
        return self


class _ImageFile(Part):
    name: str
    size: Count
    mtime_ns: int
    sha256: Sha256


class IngestedImages(Part):
    """Attributes of the stored images."""

    finished: Literal[True]
    frame_crc32: list[Annotated[int, Field(ge=0, lt=2**32)]]
    files: list[_ImageFile] = []
