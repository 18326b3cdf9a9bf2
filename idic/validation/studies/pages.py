"""What a person looks at: ``study.html``, ``figures/*.png``, ``tables.md``, ``goals.json``, from the stored records."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from idic.validation.pages.study_page import markdown_table, render_study
from idic.validation.studies.store import StudyStore
from idic.validation.studies.study import Study

PAGE, FIGURES, TABLES, GOALS = "study.html", "figures", "tables.md", "goals.json"


def write_page(store: StudyStore, study: Study) -> Path:
    """Draw what is finished; returns the page."""
    finished = [case for case in study.cases if store.has_case(case.key, case.ident(study.rendering(case.images)))]
    page = study.draw({case.key: store.read_case(case.key) for case in finished})
    if len(finished) < len(study.cases):
        page = page.with_remark(f"{len(finished)} of {len(study.cases)} cases are finished.")
    folder = store.run / FIGURES
    folder.mkdir(exist_ok=True)
    for picture in page.pictures:
        (folder / f"{picture.name}.png").write_bytes(picture.png)
    texts = [f"## {section.title}\n\n{table.title}\n\n{markdown_table(table)}\n\n{table.note}\n"
             for section in page.sections for table in section.tables]
    (store.run / TABLES).write_text(f"# {page.title} ({study.size})\n\n" + "\n".join(texts), encoding="utf-8")
    goals = json.dumps([asdict(goal) for goal in page.goals], indent=1, ensure_ascii=False)
    (store.run / GOALS).write_text(f"{goals}\n", encoding="utf-8")
    (store.run / PAGE).write_text(render_study(page), encoding="utf-8")
    return store.run / PAGE
