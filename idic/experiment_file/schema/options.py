"""[options], [[stage]], [solver], [design] and gauges as strict models: settings of evaluation, test design and report.

``[[stage]]``
    ``free`` (names, or "all"), ``max_iterations``; ``lowpass_px`` blurs the images of this stage: the range
    of convergence grows; ``until_s`` ends its frames. The next stage starts from the result. A last stage without
    either key is appended automatically.
``[design]``
    Inputs of `idic design` before there are images or a log: ``image_px`` = [columns, rows], of scans also slices,
    ``n_frames``, ``duration_s``, ``noise_std_gv``, ``speckle_px``, ``contrast_gv`` (standard deviation of the pattern),
    and ``[design.program]`` with one course per column of the log, [[time_s, value], ...], in the column's unit.
``[solver]``
    An external program simulates: see docs/external-solver.md. Materials may then have
    ``law = "external"`` with parameters of any name, as used in the template of the deck.
``[options]``: see `idic.model.records.experiment.Options`.
``[[probe]]``, ``[[extensometer]]``, ``[[line]]``, ``[[circle]]``
    Where the report reads fields off: ``at``, ``from`` and ``to``, or ``centre`` and ``radius``, with ``_mm`` (mesh
    coordinates) or ``_px`` (column and row of the reference image). They change nothing of the identification.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from idic.experiment_file.schema.base import Pair, Positive, Strict, refuse

FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")]  # no folder in it


class StageTable(Strict):
    free: Annotated[list[str], Field(min_length=1)] | Literal["all"] = "all"
    max_iterations: Annotated[int, Field(ge=1, le=100_000)] | None = None
    lowpass_px: Annotated[float, Field(gt=0, le=20)] | None = None
    until_s: Positive | None = None


class OptionsTable(Strict):
    interpolation: Literal["cubic", "quintic"] = "quintic"  # of volumes cubic
    lowpass_px: Annotated[float, Field(ge=0, le=5)] | None = None  # 0.6; height images 0
    camera_blur_px: Annotated[float, Field(ge=0, le=5)] = 12**-0.5
    border_px: Annotated[int, Field(ge=0, le=50)] | None = None  # 4 with the low-pass of 0.6 px, 0 without one
    edge_margin_px: Annotated[int, Field(ge=0, le=50)] = 3
    left_out_px: Annotated[list[Annotated[list[float], Field(min_length=3, max_length=3)]], Field(max_length=5000)] = []
    element_order: Literal["auto", "as_given", "quadratic"] = "auto"
    brightness: Literal["none", "frame", "patch", "tilt"] | None = None  # frame; height images none
    patch_px: Positive = 100.0
    defocus: Literal["none", "frame"] = "none"
    method: Literal["integrated", "two_step", "two_step_unweighted"] = "integrated"
    dic_regularisation: Literal["auto", "none", "mechanical", "gradient"] = "auto"
    weighting: Literal["noise", "paper"] = "noise"
    estimator: Literal["auto", "ordinary", "generalised"] = "auto"
    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.01
    step_limit: Positive | None = None
    trial_steps: Annotated[int, Field(ge=1, le=8)] = 1
    max_iterations: Annotated[int, Field(ge=1, le=100_000)] = 40
    search: Literal["auto", "never"] = "auto"
    schedule: Literal["all", "spectrum"] = "all"
    tolerance: Positive = 0.02
    substeps: Annotated[int, Field(ge=1, le=10_000)] | None = None  # 1; a rate-dependent law: by an error estimate
    perturbation: Annotated[float, Field(gt=0, le=0.1)] | None = None  # 1e-4; external solver 1e-3
    locking: Literal["auto", "none", "mean_dilatation"] = "auto"


class SolverTable(Strict):
    """``template``: the deck, written into a folder of each run without its ending ``.template``; ``files``: copied
    next to it; ``mesh``: the mesh of the experiment is written there under this name, with these ``element_types``;
    ``command``: arguments, with {job} and {deck}; ``reader``: format of the results; ``time``: time unit of the deck.
    """

    kind: Literal["external"]
    template: str
    files: list[str] = []
    mesh: FileName | None = None
    element_types: dict[Literal["tri3", "tri6", "quad4", "quad8", "tet4", "tet10", "hex8", "hex20"],
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
            raise refuse("element_types without mesh", 'mesh = "mesh.inp" next to element_types',
                         "add mesh, or leave element_types out", "no mesh")
        return self


class DesignTable(Strict):
    """The recordings of a planned test; read by `idic design` and `idic simulate` only."""

    image_px: Annotated[list[Annotated[int, Field(ge=16, le=50000)]], Field(min_length=2, max_length=3)] | None = None
    n_frames: Annotated[int, Field(ge=2, le=100000)] | None = None
    duration_s: Positive | None = None
    noise_std_gv: Positive | None = None
    speckle_px: Annotated[float, Field(ge=1, le=100)] = 4.0
    contrast_gv: Positive = 50.0
    program: dict[str, Annotated[list[Pair], Field(min_length=2)]] = {}


class GaugeTable(Strict):
    """What all gauges have; without a name it is the kind with a number."""

    name: Annotated[str, Field(min_length=1, max_length=40)] | None = None


class ProbeTable(GaugeTable):
    at_mm: Pair | None = None
    at_px: Pair | None = None

    @model_validator(mode="after")
    def _one_unit(self):
        in_one_unit(self, ("at",), "at_mm = [10.0, 2.5]")
        return self


class ExtensometerTable(GaugeTable):
    from_mm: Pair | None = None
    to_mm: Pair | None = None
    from_px: Pair | None = None
    to_px: Pair | None = None

    @model_validator(mode="after")
    def _two_ends(self):
        unit = in_one_unit(self, ("from", "to"), "from_mm = [0.0, -5.0] and to_mm = [0.0, 5.0]")
        if getattr(self, f"from_{unit}") == getattr(self, f"to_{unit}"):
            raise refuse("the two ends are one point", "two points", "correct one of them", getattr(self, f"to_{unit}"))
        return self


class LineTable(ExtensometerTable):
    points: Annotated[int, Field(ge=2, le=10_000)] = 101


class CircleTable(GaugeTable):
    centre_mm: Pair | None = None
    radius_mm: Positive | None = None
    centre_px: Pair | None = None
    radius_px: Positive | None = None

    @model_validator(mode="after")
    def _one_unit(self):
        in_one_unit(self, ("centre", "radius"), "centre_mm = [0.0, 0.0] and radius_mm = 2.0")
        return self


def in_one_unit(table: GaugeTable, stems: tuple[str, ...], example: str) -> str:
    """"mm" or "px", in which all of these keys are given."""
    keys = [name for name in type(table).model_fields if name.endswith(("_mm", "_px"))
            and getattr(table, name) is not None]
    for unit in ("mm", "px"):
        if keys == [f"{stem}_{unit}" for stem in stems]:
            return unit
    keys_in_mm = " and ".join(f"{stem}_mm" for stem in stems)
    raise refuse("the place of a gauge is not complete", f"{keys_in_mm}, or the same with _px", f"write e.g. {example}",
                 ", ".join(keys) or "none of them")
