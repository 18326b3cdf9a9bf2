"""experiment.toml as a strict model: unknown keys are refused.

docs/experiment-file.md names every key with its default.
"""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import model_validator

from idic.experiment_file.schema.base import Strict, refuse
from idic.experiment_file.schema.boundary import BoundaryTable, ChannelTable, SetTable
from idic.experiment_file.schema.cracks import CrackTable
from idic.experiment_file.schema.cameras import CameraTable, FurtherCameraTable, ScannerTable
from idic.experiment_file.schema.experiment import ExperimentTable, FieldsTable, SetupTable
from idic.experiment_file.schema.materials import DofTable, HeterogeneityTable, MaterialTable
from idic.experiment_file.schema.options import (
    CircleTable, DesignTable, ExtensometerTable, LineTable, OptionsTable, ProbeTable, SolverTable, StageTable,
)

_OF_THE_MAIN_CAMERA = ("images", "mask", "surface", "still_frames")
# first words of other degrees of freedom
_NOT_A_CAMERA = ("channel", "boundary", "geometry", "time", "placement", "crack")


class ExperimentFile(Strict):
    """All tables of experiment.toml."""

    experiment: ExperimentTable
    fields: FieldsTable | None = None
    camera: CameraTable | None = None  # the main one
    scanner: ScannerTable | None = None  # of volumes
    further_cameras: list[FurtherCameraTable] = []  # further [[camera]] tables
    material: dict[str, MaterialTable] = {}  # none: the motion is measured, and nothing simulated
    sets: dict[str, SetTable] = {}
    heterogeneity: list[HeterogeneityTable] = []
    crack: list[CrackTable] = []
    boundary: list[BoundaryTable] = []
    channel: list[ChannelTable] = []
    dof: list[DofTable] = []
    stage: list[StageTable] = []
    options: OptionsTable = OptionsTable()
    design: DesignTable | None = None
    solver: SolverTable | None = None
    setup: SetupTable = SetupTable()
    probe: list[ProbeTable] = []
    extensometer: list[ExtensometerTable] = []
    line: list[LineTable] = []
    circle: list[CircleTable] = []

    @model_validator(mode="before")
    @classmethod
    def _main_and_further(cls, raw: object) -> object:
        """[[camera]] tables: the first is the main camera, its images are those of [experiment]."""
        if not isinstance(raw, Mapping) or not isinstance(raw.get("camera"), list):
            return raw
        main, *further_tables = raw["camera"] or [{}]
        extra = [key for key in _OF_THE_MAIN_CAMERA if isinstance(main, Mapping) and key in main]
        if extra:
            raise refuse("the first [[camera]] is the main camera: its images belong in [experiment]",
                         f"{extra[0]} under [experiment]", f"move {', '.join(extra)} to [experiment]",
                         f"{extra[0]} in the first [[camera]]")
        return {**raw, "camera": main, "further_cameras": further_tables}

    @model_validator(mode="after")
    def _columns_of_fields(self):
        table = self.experiment
        if self.fields is None:
            return self
        if not table.fields:
            raise refuse("columns without fields", 'fields = "stages/*.csv" in [experiment]',
                         "name the exported stages", "[fields.columns] alone")
        if table.fields_format != "auto" or (table.fields_unit is not None and self.fields.columns.unit is not None):
            raise refuse("the columns of the fields are told twice", "[fields.columns] with its unit, or fields_format "
                         "and fields_unit", "leave out fields_format and fields_unit",
                         "both")
        return self

    @model_validator(mode="after")
    def _scanner_of_volumes(self):
        if self.experiment.volumes:
            extra = [name for name in ("camera", "further_cameras", "solver", "probe", "extensometer", "line",
                                       "circle") if getattr(self, name)]
            if extra:
                raise refuse("tables that volumes do not have", "[scanner] in the place of [camera]; no gauges "
                             "or external solver", f"leave out {', '.join(extra)}", ", ".join(extra))
            if self.options.method != "integrated":
                raise refuse("two steps on volumes", 'method = "integrated"', "leave method out", self.options.method)
            if self.options.defocus != "none":
                raise refuse("defocus of volumes", "no defocus", "leave defocus out", self.options.defocus)
            if self.options.left_out_px:
                raise refuse("circles that are left out of volumes", "no left_out_px", "leave them out", "left_out_px")
        elif self.scanner is not None:
            raise refuse("a scanner without volumes", 'volumes = "scans/*.tif" in [experiment]',
                         "name the scans, or write [camera]", "[scanner]")
        return self

    @model_validator(mode="after")
    def _camera_names(self):
        names = set(self.material) | set(_NOT_A_CAMERA)
        main = self.camera.name if self.camera else "camera"
        for name in (main, *(camera.name for camera in self.further_cameras)):
            if name in names:
                raise refuse("a camera name is taken", "for every camera a name that no other camera and "
                             "no material has", "choose another name", name)
            names.add(name)
        return self

    @model_validator(mode="after")
    def _textures(self):
        tables = {table.name: table for table in (self.camera or CameraTable(), *self.further_cameras)}
        pinhole = [name for name, table in tables.items() if table.lens]
        for name, table in tables.items():
            if table.texture is None:
                continue
            partners = [candidate for candidate in pinhole if candidate != name]
            if table is self.camera:
                raise refuse("the first camera is what others are compared with", "texture in a further [[camera]] "
                             "table: two cameras with a lens or more", f"leave texture out of {name}", table.texture)
            if name not in pinhole or table.texture not in partners:
                raise refuse(f"{name} has no texture to be compared with", 'the name of another camera, both with '
                             'model = "pinhole"', f"write one of {', '.join(partners) or 'none'}, or leave texture out",
                             f"texture = {table.texture!r}" + ("" if name in pinhole else f", {name} telecentric"))
            chain = [name]
            while (following := tables[chain[-1]].texture) is not None:
                if following in chain:
                    raise refuse("the same images are compared twice", "at least one camera without texture in a chain",
                                 f"leave texture out of {following}", " to ".join([*chain, following]))
                chain.append(following)
        if self.options.method != "integrated" and any(table.texture for table in self.further_cameras):
            raise refuse("two steps compare no texture", 'method = "integrated"', "leave texture out",
                         self.options.method)
        return self
