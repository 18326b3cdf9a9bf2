"""What the files of a RUN hold, by name and type: a RUN may come from somebody else, with checksums that fit.

A file is checked when it is read and stays as it is. Keys that are not listed belong to parts of idic that read them
only to show them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from idic.errors import InputError

MAX_SHOWN_ERRORS = 3
MAX_WHOLE = 2**53  # of numbers that count something: larger ones are no counts
Number = float | None  # None: not finite, or not determined
Count = Annotated[int, Field(ge=0, le=MAX_WHOLE)]
Std = Annotated[float, Field(ge=0)] | None
Values = dict[str, Number]


def _of_hex(text: str) -> str:
    float.fromhex(text)
    return text


Hex = Annotated[str, AfterValidator(_of_hex)]  # an exact float
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=True)


class _Exact(BaseModel):
    """Without other keys: the record is built from it."""

    model_config = ConfigDict(extra="forbid", strict=True)


# run.json ---------------------------------------------------------------------------------------------
class _StoredNoise(_Part):
    std_gv: float
    source: str
    correlated: dict[str, Any] | None = None


class _Weights(_Part):
    kind: str
    image: float
    image_noise: float
    channels: list[float]
    channel_noise: list[float]
    cameras: list[float]
    camera_noise: list[float]


class _Boundary(_Part):
    values: dict[str, Hex]
    modes: list[str]
    notes: list[str]


class Description(_Part):
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


# state.json -------------------------------------------------------------------------------------------
class _Parallel(_Exact):
    values: dict[str, Hex]
    damping: Hex
    halvings: int


class _Trial(_Exact):
    values: dict[str, Hex]
    parallel: list[_Parallel]
    re_evaluation: bool
    tries_activation: bool
    new_increments: bool


class _Accepted(_Exact):
    values: dict[str, Hex]
    number: Annotated[int, Field(ge=-1, le=MAX_WHOLE)]
    phi: Hex | None


class _Trust(_Exact):
    radius: Hex
    damping: Hex
    rejections: Count


class _Schedule(_Exact):
    stage: Count
    iterations: Count


class _Activation(_Exact):
    active: list[str]
    reactivated: list[str]
    rejections: Count


class _Estimator(_Exact):
    kind: str
    ordinary_solution: dict[str, Hex] | None


class _Increments(_Exact):
    per_frame: int | None
    status: str
    coarser: dict[str, Hex] | None
    change: dict[str, Hex] | None


class _Ending(_Exact):
    status: str
    reason: str
    limit: str | None


class _Evaluated(_Part):
    """An entry of the history."""

    evaluation: Count
    stage: Count
    accepted: bool
    damping: Number
    phi: Number
    message: str | None = None


class _EvaluatedExactly(_Evaluated):
    values: dict[str, Hex]


class State(_Exact):
    """``state.json``: where the identification stands (`idic.identification.LoopState`)."""

    trial: _Trial
    accepted: _Accepted | None
    trust: _Trust
    schedule: _Schedule
    activation: _Activation
    estimator: _Estimator
    increments: _Increments
    evaluations: Count
    parallel_evaluations: Count
    iteration: Count
    status: str
    history: list[_EvaluatedExactly]
    end: _Ending | None

    @model_validator(mode="after")
    def _of_the_same_parameters(self) -> State:
        accepted = [self.accepted] if self.accepted else []
        points: list[Any] = [self.trial, *self.trial.parallel, *self.history, *accepted]
        if any(point.values.keys() != self.trial.values.keys() for point in points):
            raise ValueError("points of other parameters")
        return self


class Names(_Exact):
    """``joint.json``: the experiments of a RUN of several."""

    names: Annotated[list[Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]], Field(min_length=2)]

    @model_validator(mode="after")
    def _once_each(self) -> Names:
        if len(set(self.names)) < len(self.names):
            raise ValueError("an experiment is named twice")
        return self


# result.json ------------------------------------------------------------------------------------------
class _Parameter(_Part):
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


class _Matrix(_Part):
    names: list[str]
    matrix: list[list[Number]]

    @model_validator(mode="after")
    def _square(self) -> _Matrix:
        if any(len(row) != len(self.names) for row in self.matrix) or len(self.matrix) != len(self.names):
            raise ValueError(f"not a matrix of {len(self.names)} names")
        return self


class _Noise(_Part):
    std_gv: Number = None
    source: str | None = None
    unit: str | None = None


class _FreeDic(_Part):
    frames: list[Count]
    chi2_dof: Number
    model_chi2_dof: Number


class _Local(_Part):
    is_cluster: bool = False
    chi2: Number = None
    typical_chi2: Number = None
    z: Number = None
    p_value: Number = None
    column: Number = None
    row: Number = None
    share: Number = None


class _Discrepancy(_Part):
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


class _Remedy(_Part):
    setting: str
    chi2_before: Number
    chi2_after: Number


class _CameraFloor(_Part):
    px: Number = None
    bound_px: Number = None
    length_px: Number = None
    frames: list[Count] = []
    labels: list[str] = []
    drift_px: list[Number] = []
    source: str | None = None


class _Undetermined(_Part):
    name: str
    reason: str
    together_with: list[str] = []


class _ShownIncrements(_Part):
    rate_dependent_laws: list[str] = []
    path_dependent_laws: list[str] = []
    words: str | None = None


class _Residual(_Part):
    image_rms_gv: Number
    image_chi2_dof: Number
    lost_pixels: Count | None
    channel_rms: Values
    channel_chi2_dof: Values
    channel_noise_std: Values
    local: _Local | None = None
    free_dic_shown: _FreeDic | None = None


class _Frame(_Part):
    frame: Count
    label: str
    status: str
    reference: bool
    rms_gv: Number
    chi2_dof: Number
    n_pixels: Count | None


class _ShownEntry(_Evaluated):
    values: Values


class _End(_Part):
    reason: str
    limit: str | None


class Result(_Part):
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
    experiments: dict[str, dict[str, Any]] = {}

    @model_validator(mode="after")
    def _of_the_same_parameters(self) -> Result:
        if any(entry.values.keys() != self.parameters.keys() for entry in self.history):
            raise ValueError("a history of other parameters")
        return self


# files of a diagnosis and of a batch that are read again --------------------------------------------------------------
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _RefittedCandidate(_Part):
    name: str
    edits: str
    values: dict[str, Finite | None]


class Undecided(_Part):
    """``diagnosis.json``: the candidates that were refitted, and those among which it does not decide."""

    refits: list[_RefittedCandidate] = []
    set_: Annotated[list[str] | None, Field(alias="set")] = None
    indistinguishable: list[list[str]] = []
    named: list[str] = []


class StoredRefit(_Exact):
    """``diagnosis/*.npz``: a refit without its arrays."""

    name: str
    label: str
    status: str
    values: dict[str, float]
    stds: Values
    choice: float | None
    judgement: float | None
    evaluations: Count
    problem: str
    phi: float
    estimator: str


class _BatchParameter(_Exact):
    value: Finite | None
    std: Finite | None
    unit: str | None
    start: Finite | None


class BatchRow(_Exact):
    """``batch.json``: a run of a batch."""

    name: str
    experiment: str
    set_: Annotated[dict[str, Any], Field(alias="set")]
    run: str
    status: str
    reason: str
    iterations: Count | None
    image_chi2_dof: Finite | None
    wall_s: Finite | None
    parameters: dict[str, _BatchParameter]


# run.zarr ---------------------------------------------------------------------------------------------
class _ImageFile(_Part):
    name: str
    size: Count
    mtime_ns: int
    sha256: Sha256


class IngestedImages(_Part):
    """Attributes of the stored images."""

    finished: Literal[True]
    frame_crc32: list[Annotated[int, Field(ge=0, lt=2**32)]]
    files: list[_ImageFile] = []


def refuse_other_types(content: object, kind: type[BaseModel], file: Path | str) -> None:
    """Check a content against its schema.

    Raises
    ------
    InputError
        A key is missing, a value has another type, or a text has no encoding.
    """
    try:
        _adapter(kind).validate_python(content)
        json.dumps(content, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InputError("a text that no file can hold", file=file, expected="whole characters of Unicode",
                         found="a half of a surrogate pair", remedy="do not use this folder") from None
    except ValidationError as problem:
        errors = problem.errors(include_url=False, include_context=False, include_input=False)
        listing = "; ".join(f"{'.'.join(map(str, error['loc'])) or 'the content'}: {error['msg']}"
                          for error in errors[:MAX_SHOWN_ERRORS])
        raise InputError("the file does not hold what idic writes into it", file=file,
                         expected=f"keys and types of {(kind.__doc__ or '').split(':')[0].split(';')[0].strip('`.')}",
                         found=listing,
                         remedy="do not use this folder if it comes from somebody else; otherwise run the command "
                                "again with --resume, or identify into another --out") from None
    except (RecursionError, OverflowError) as problem:
        raise InputError("the file does not hold what idic writes into it", file=file, found=type(problem).__name__,
                         remedy="do not use this folder") from None


@cache
def _adapter(kind: type[BaseModel]) -> TypeAdapter:
    return TypeAdapter(kind)


BY_SCHEMA: Mapping[str, type[BaseModel]] = {
    "idic.run-description/1": Description, "idic.state/2": State, "idic.joint/1": Names}
