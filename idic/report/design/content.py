"""What `idic design` writes: the content of design.json, and page, table and figures made from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from idic.correlation import view_of
from idic.identification import Design, JointDesign, VIRTUAL_SPECKLE
from idic.report.design.figures import PlanPictures
from idic.report.design.page import design_table, draw_design, render_design
from idic.report.design.summary import compare, joint_summary, summary
from idic.report.evidence.volumes.shown_mesh import ShownMesh

SCHEMA = "idic.design/1"
PAGE_FILE, TABLE_FILE = "design.html", "design.csv"


def design_content(designs: Sequence[Design], joint: JointDesign | None, patterns: Sequence[str],
                   paths: Sequence[Path | str], confusable: float) -> dict:
    """The content of design.json; joint : all plans identified together; patterns : what is measured, by plan."""
    content = {"schema": SCHEMA, "confusable_above": confusable,
               "plans": [summary(design, pattern, path, confusable)
                         for design, pattern, path in zip(designs, patterns, paths, strict=True)],
               "joint": None if joint is None else joint_summary(joint, confusable)}
    content["comparison"] = None if joint is None else compare(content)
    return content


def design_files(content: Mapping, pictures: Sequence[PlanPictures]) -> dict[str, bytes | str]:
    """Page, table and figures by their path in the folder; pictures : what is drawn of every plan (`plan_pictures`)."""
    sections = draw_design(content, pictures)
    figures = {f"figures/{picture.name}.png": picture.png for section in sections for picture in section.pictures}
    return figures | {TABLE_FILE: design_table(content), PAGE_FILE: render_design(content, sections)}


def plan_pictures(design: Design, pattern: str) -> PlanPictures:
    """Data of the figures of a plan that are not in its summary."""
    experiment = design.experiment
    picture_mesh = ShownMesh.seen_by(experiment, experiment.model.camera)
    is_volume = experiment.recording.quantity == "volume"
    has_maps = is_volume or view_of(experiment, experiment.model.camera).n_components == 2
    reference = None if pattern == VIRTUAL_SPECKLE else experiment.recording.picture(experiment.model.reference)
    return PlanPictures(reference, picture_mesh.points_px, picture_mesh.cells if has_maps else (),
                        tuple((f.name, f.frame, picture_mesh.of(f.phi), f.step / abs(design.parameters[f.name].factor))
                              for f in design.fields) if has_maps else ())
