"""The Zarr store of a study and the page drawn from it.

::

    DIR/study.zarr/images/NAME/frames       noise-free images of a virtual test
    DIR/study.zarr/cases/GROUP/NAME/...     arrays of a finished case; attribute ``facts``: every other value
    DIR/study.html, figures/*.png, tables.md, goals.json

A record appears whole or not at all: a writer may be killed at any time.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
import zarr

from idic.images import Stack
from idic.run import RunStore, ZarrStack, read_array, write_array
from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.study_page import write_page_files
from idic_studies.cases.study import Study

STORE_NAME, PAGE, GOALS = "study.zarr", "study.html", "goals.json"
CASES, IMAGES = "cases", "images"


class StudyStore(RunStore):
    """Access to ``DIR/study.zarr``; `claim` it to write, as a `RunStore`."""

    def __init__(self, out: Path | str):
        super().__init__(out)
        self.path = self.run / STORE_NAME

    # images ---------------------------------------------------------------------------------------
    def keep_images(self, name: str, stack: Stack, source: str) -> None:
        """Copy a stack unless it is there already; `source` identifies its origin."""
        ZarrStack.of(self, stack, source=source, name=f"{IMAGES}/{name}")

    def has_images(self, name: str, source: str) -> bool:
        """Whether the images `name`, made from `source`, are there."""
        folder = self.finished(f"{IMAGES}/{name}")
        return folder is not None and zarr.open_group(store=str(folder), mode="r").attrs["ident"]["source"] == source

    def images(self, name: str) -> ZarrStack:
        """The images `name`; `Damaged` where they are not there."""
        return ZarrStack(self.group(f"{IMAGES}/{name}"))

    # cases ----------------------------------------------------------------------------------------
    def write_case(self, key: str, ident: Mapping, facts: Mapping, arrays: Mapping[str, np.ndarray]) -> None:
        """Store the record of a case, in place of an older one.

        ident : what it was computed from; facts : JSON values
        """
        with self.building(f"{CASES}/{key}", ident) as folder:
            for name, values in arrays.items():
                write_array(folder, name, values)
            zarr.open_group(store=str(folder), mode="r+").attrs.update({"facts": dict(facts)})

    def has_case(self, key: str, ident: Mapping) -> bool:
        """Whether the case is finished and was computed from exactly `ident`."""
        return self.finished(f"{CASES}/{key}", ident) is not None

    def read_case(self, key: str) -> CaseRecord:
        """The record of a finished case; `Damaged` where it is not there."""
        folder = self.group(f"{CASES}/{key}")
        names = sorted(file.parent.name for file in folder.glob("*/zarr.json"))
        facts = zarr.open_group(store=str(folder), mode="r").attrs["facts"]
        return CaseRecord(key, facts, {name: read_array(folder, name) for name in names})


def write_page(store: StudyStore, study: Study) -> Path:
    """Draw the finished cases of a study and write its page, figures, tables and goals; returns the page."""
    finished = [case for case in study.cases if store.has_case(case.key, case.ident(study.rendering(case.images)))]
    page = study.draw({case.key: store.read_case(case.key) for case in finished})
    if len(finished) < len(study.cases):
        page = page.with_remark(f"{len(finished)} of {len(study.cases)} cases are finished.")
    goals = json.dumps([asdict(goal) for goal in page.goals], indent=1, ensure_ascii=False)
    (store.run / GOALS).write_text(f"{goals}\n", encoding="utf-8")
    return write_page_files(page, store.run / PAGE, f"# {page.title} ({study.size})\n\n")
