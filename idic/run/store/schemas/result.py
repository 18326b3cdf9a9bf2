"""Schema of ``result.json``."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from idic.run.store.schemas.state import Evaluated
from idic.run.store.schemas.types import Count, Number, Part, Std, Values


class _Parameter(Part):
    value: float
    std: Std
    unit: str
    start: Number
    is_free: Annotated[bool, Field(alias="free")]
    std_noise: Std = None
    std_model: Std = None
    systematic_std: Std = None
    discretisation_bias: Number = None
    time_bias: Number = None
    ci95: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None


class _Matrix(Part):
    names: list[str]
    matrix: list[list[Number]]

    @model_validator(mode="after")
    def _square(self) -> _Matrix:
        if any(len(row) != len(self.names) for row in self.matrix) or len(self.matrix) != len(self.names):
            raise ValueError(f"not a matrix of {len(self.names)} names")
        return self


class _Noise(Part):
    std_gv: Number = None
    source: str | None = None
    unit: str | None = None


class _FreeDic(Part):
    frames: list[Count]
    chi2_dof: Number
    model_chi2_dof: Number


class _Local(Part):
    is_cluster: bool = False
    chi2: Number = None
    typical_chi2: Number = None
    z: Number = None
    p_value: Number = None
    column: Number = None
    row: Number = None
    share: Number = None


class _Discrepancy(Part):
    significant: bool | None = None
    likelihood_ratio: Number = None
    std: Values = {}
    motion_px: Values = {}

    @model_validator(mode="after")
    def _with_its_size(self) -> _Discrepancy:
        sizes = [self.likelihood_ratio, *self.std.values(), *self.motion_px.values()]
        if self.significant and (not self.motion_px or None in sizes):
            raise ValueError("significant, but without its size")
        return self


class _Remedy(Part):
    setting: str
    chi2_before: Number
    chi2_after: Number


class _CameraFloor(Part):
    px: Number = None
    bound_px: Number = None
    length_px: Number = None
    frames: list[Count] = []
    labels: list[str] = []
    drift_px: list[Number] = []
    source: str | None = None


class _Undetermined(Part):
    name: str
    reason: str
    together_with: list[str] = []


class _ShownIncrements(Part):
    rate_dependent_laws: list[str] = []
    path_dependent_laws: list[str] = []
    words: str | None = None


class _Residual(Part):
    image_rms_gv: Number
    image_chi2_dof: Number
    lost_pixels: Count | None
    channel_rms: Values
    channel_chi2_dof: Values
    channel_noise_std: Values
    local: _Local | None = None
    free_dic_shown: _FreeDic | None = None


class _Frame(Part):
    frame: Count
    label: str
    status: str
    reference: bool
    rms_gv: Number
    chi2_dof: Number
    n_pixels: Count | None


class _Crack(Part):
    """Length and loads of a tip, per frame."""

    frames: list[Count]
    length_mm: list[float]
    length_mm_std: list[Std]
    K_I: list[Number]
    K_II: list[Number]
    J: list[Number]
    K_I_std: list[Std]
    K_II_std: list[Std]
    J_std: list[Std]
    why_not: str

    @model_validator(mode="after")
    def _of_all_frames(self) -> _Crack:
        lengths = {name: len(values) for name, values in self if isinstance(values, list)}
        if set(lengths.values()) != {len(self.frames)}:
            raise ValueError(f"not one value per frame: {lengths}")
        return self


class _ShownEntry(Evaluated):
    values: Values


class _End(Part):
    reason: str
    limit: str | None


class Result(Part):
    """``result.json``; meaning of every key: docs/quantities.md."""

    schema_: Annotated[str, Field(alias="schema")]
    status: str
    title: str
    parameters: dict[str, _Parameter]
    derived: dict[str, dict[str, Any]]
    iterations: Count
    evaluations: Count
    noise: _Noise
    residual: _Residual
    frames: list[_Frame]
    cost: Values
    notes: list[str]
    history: list[_ShownEntry]
    end: _End | None = None
    forward_runs: Count = 0
    quantity: str = ""
    correlation: _Matrix | None = None
    M: _Matrix | None = None
    eigenvalues: list[Number] = []
    eigenvectors: list[list[Number]] = []
    not_identifiable: list[_Undetermined] = []
    at_bound: Values = {}
    increments: _ShownIncrements | None = None
    discrepancy: _Discrepancy | str | None = None
    camera_floor: _CameraFloor | None = None
    remedies: list[_Remedy] = []
    cracks: dict[str, _Crack] = {}
    experiments: dict[str, dict[str, Any]] = {}

    @model_validator(mode="after")
    def _of_the_same_parameters(self) -> Result:
        if any(entry.values.keys() != self.parameters.keys() for entry in self.history):
            raise ValueError("a history of other parameters")
        return self
