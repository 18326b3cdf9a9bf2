"""``trial.html``: scores beside targets, the confusion matrix, every trial in one line; and the same as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from idic.store.result_file import write_json
from idic.validation.pages.study_page import StudyPage, StudySection, Table, markdown_table, render_study
from idic.validation.trial.judge import Record, judged
from idic.validation.trial.pictures import confusion_picture, decoy_picture, place_and_onset
from idic.validation.trial.scores import goals
from idic.validation.trial.seal import Folder, answered, opened
from idic.validation.trial.strength import STRENGTHS

PAGE, RECORDS, SCORES, TABLES = "trial.html", "records.json", "scores.json", "tables.md"


def write_page(folder: Folder) -> Path:
    """Judge everything that is answered and draw it; returns the page."""
    answers = answered(folder)
    records = sorted((judged(folder, number, opened(folder, number), answer) for number, answer in answers.items()),
                     key=_place)
    page = trial_page(folder, records)
    (folder.out / "figures").mkdir(exist_ok=True)
    for picture in page.pictures:
        (folder.out / "figures" / f"{picture.name}.png").write_bytes(picture.png)
    write_json(folder.out / RECORDS, {"records": [record.content for record in records]})
    scores = [asdict(goal) for goal in page.goals]
    write_json(folder.out / SCORES, {"scores": scores, "runs": folder.register["runs"]})
    texts = [f"## {section.title}\n\n{table.title}\n\n{markdown_table(table)}\n\n{table.note}\n"
             for section in page.sections for table in section.tables]
    (folder.out / TABLES).write_text("\n".join(texts), encoding="utf-8")
    (folder.out / PAGE).write_text(render_study(page), encoding="utf-8")
    return folder.out / PAGE


def _place(record: Record) -> tuple:
    """Single effects by name and strength first, clean recordings last; the tenth after the ninth."""
    name, _, number = record.key.rpartition("-")
    if not number.isdigit():
        name, number = record.key.rsplit("/", 1)
    order = ("singles", "pairs", "twins", "outside", "clean")
    return order.index(record.group) if record.group in order else len(order), name, int(number)


def trial_page(folder: Folder, records: Sequence[Record]) -> StudyPage:
    register = folder.register
    tool = register["tool"]
    again = sum(record.attempt - 1 for record in records)
    first = (f"{len(records)} of {len(register['truths'])} sealed trials are answered; size {register['size']}, seed "
             f"{register['seed']}, tool {tool['commit'][:12] or tool['version']}"
             f"{' with local changes' if tool['changed'] else ''}; {_number_of(len(register['runs']), 'run')}, "
             f"{_number_of(again, 'answer')} given again.")
    pictures = tuple(p for p in (confusion_picture(records), place_and_onset(records), decoy_picture(records)) if p)
    return StudyPage("Blind trial of the diagnosis", first, goals(records), (
        StudySection("confusion", "What was true, what was said", "", (_by_strength(records),), pictures[:1]),
        StudySection("details", "When, where, and what noise alone does", "", (), pictures[1:]),
        StudySection("ablations", "With a part taken away", "What stands first in the screening alone, without refits, "
                     "and how often it raises an alarm on clean recordings.", (_ablations(records),)),
        StudySection("trials", "Every trial", "", (_all(records),)),
        StudySection("tool", "What was frozen", json.dumps(tool["thresholds"]), (_runs(register),))))


def _number_of(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _by_strength(records: Sequence[Record]) -> Table:
    rows = []
    for name in dict.fromkeys(r.truth[0] for r in records if r.group == "singles"):
        own = [r for r in records if r.group == "singles" and r.truth[0] == name]
        cells = []
        for strength in STRENGTHS:
            of = [r for r in own if r.strength == strength]
            cells.append(f"{sum(r.family_first for r in of)} / {sum(r.inside for r in of)} of {len(of)}" if of else "–")
        rows.append((name, own[0].solver, *cells))
    return Table("Right family first / truth inside the reported set", ("effect", "solver", *STRENGTHS), tuple(rows))


def _ablations(records: Sequence[Record]) -> Table:
    known = [r for r in records if r.ablations]
    rows = []
    for name, title in (("whole", "as it is"), ("no_reference", "without the reference image's noise"),
                        ("no_projection", "without projection"), ("size", "the residual's size only")):
        clean = [r for r in known if r.group == "clean"]
        single = [r for r in known if r.group == "singles"]
        alarms = sum(bool(r.ablations[name]["alarm"]) for r in clean)
        seen = sum(bool(r.ablations[name]["alarm"]) for r in single)
        right = sum(r.ablations[name].get("name") in r.truth for r in single)
        rows.append((title, f"{alarms} of {len(clean)}", f"{seen} of {len(single)}",
                     "–" if name == "size" else f"{right} of {len(single)}"))
    return Table("Alarms at a family-wise 1 %, and the true effect first", ("screening", "alarms on clean",
                                                                       "alarms on single effects", "true effect first"),
                 tuple(rows))


def _all(records: Sequence[Record]) -> Table:
    def number(value, digits=2):
        return "–" if value is None else f"{value:.{digits}g}"

    rows = [(r.key, r.verdict, ", ".join(r.reported) or "–", number(r.onset_error), number(r.overlap),
             number(r.excess_ratio), number(r.bias_before), number(r.bias_ratio), number(r.drop_ratio, 3),
             number(r.cpu_s, 3)) for r in records]
    return Table("", ("trial", "verdict", "reported", "onset error", "overlap", "excess after / before",
                      "bias before (std)", "bias after / before", "achieved / predicted", "CPU s"), tuple(rows))


def _runs(register: dict) -> Table:
    frozen = register["tool"]["thresholds"]
    rows = [(run["began"], str(run["trials"]), str(run["already_answered"]), run["tool"]["commit"][:12],
             {True: "yes", False: "no"}.get(run["tool"]["changed"], "not known"),
             "yes" if run["tool"]["thresholds"] == frozen else "no") for run in register["runs"]]
    return Table("Runs of this trial", ("began", "trials", "answered before", "commit", "local changes",
                                        "thresholds as frozen"), tuple(rows))
