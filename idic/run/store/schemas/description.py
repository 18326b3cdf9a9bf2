"""Schemas of ``run.json`` and ``joint.json``."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from idic.run.store.schemas.types import Count, Exact, Hex, Part


class _StoredNoise(Part):
    std_gv: float
    source: str
    correlated: dict[str, Any] | None = None


class _Weights(Part):
    kind: str
    image: float
    image_noise: float
    channels: list[float]
    channel_noise: list[float]
    cameras: list[float]
    camera_noise: list[float]


class _Boundary(Part):
    values: dict[str, Hex]
    modes: list[str]
    notes: list[str]


class Description(Part):
    """``run.json``: what is fixed before the first simulation."""

    experiment: str
    overrides: dict[str, Any]
    identity: str
    excluded: list[Count]
    excluded_by_user: list[Count]
    noise: _StoredNoise
    camera_noises: list[_StoredNoise]
    channel_noise_source: list[str]
    weights: _Weights
    boundary: _Boundary


class Names(Exact):
    """``joint.json``: the experiments of a RUN of several."""

    names: Annotated[list[Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]], Field(min_length=2)]

    @model_validator(mode="after")
    def _once_each(self) -> Names:
        if len(set(self.names)) < len(self.names):
            raise ValueError("an experiment is named twice")
        return self
