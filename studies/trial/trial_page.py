"""The page of the blind trial: scores and targets, confusion matrix, one line per trial; the same as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from idic.run import write_json
from idic_studies.pages.study_page import StudyPage, StudySection, Table, write_page_files
from idic_studies.trial.evaluation import TrialRecord, evaluated
from idic_studies.trial.scores import goals
from idic_studies.trial.seal import Folder, answered, opened
from idic_studies.trial.strength import STRENGTHS
from idic_studies.trial.trial_figures import confusion_picture, decoy_picture, place_and_onset
from idic_studies.trial.world_scores import world_goals

PAGE, RECORDS, SCORES = "trial.html", "records.json", "scores.json"


def write_trial_page(folder: Folder) -> Path:
    """Evaluate the answered trials and write the page; returns it."""
    answers = answered(folder)
    records = sorted((evaluated(folder, number, opened(folder, number), answer) for number, answer in answers.items()),
                     key=_place)
    page = trial_page(folder, records)
    write_json(folder.out / RECORDS, {"records": [record.content for record in records]})
    scores = [asdict(goal) for goal in page.goals]
    write_json(folder.out / SCORES, {"scores": scores, "runs": folder.register["runs"]})
    return write_page_files(page, folder.out / PAGE)


def _place(record: TrialRecord) -> tuple:
    """Order of the table: single effects by name and strength first, clean recordings last, numbers as numbers."""
    name, _, number = record.key.rpartition("-")
    if not number.isdecimal():
        name, number = record.key.rsplit("/", 1)
    order = ("singles", "pairs", "twins", "outside", "clean")
    return order.index(record.group) if record.group in order else len(order), name, int(number)


def trial_page(folder: Folder, records: Sequence[TrialRecord]) -> StudyPage:
    register = folder.register
    tool = register["tool"]
    n_repeated = sum(record.attempt - 1 for record in records)
    first = (f"{len(records)} of {len(register['truths'])} sealed trials are answered; size {register['size']}, seed "
             f"{register['seed']}, tool {tool['commit'][:12] or tool['version']}"
             f"{' with local changes' if tool['changed'] else ''}; {_number_of(len(register['runs']), 'run')}, "
             f"{_number_of(n_repeated, 'repeated answer')}.")
    pictures = tuple(p for p in (confusion_picture(records), place_and_onset(records), decoy_picture(records)) if p)
    scored = world_goals(records) if any(record.world for record in records) else goals(records)
    return StudyPage("Blind trial of the diagnosis", first, scored, (
        StudySection("confusion", "True effect and first name", "", (_by_strength(records),), pictures[:1]),
        StudySection("details", "Onset, place, decoys", "", (), pictures[1:]),
        StudySection("ablations", "Ablations", "First candidate of the screening without refits, and its alarms on "
                     "clean recordings.", (_ablations(records),)),
        StudySection("trials", "Every trial", "", (_all(records),)),
        StudySection("tool", "The frozen tool", "", (_runs(register), _thresholds(tool["thresholds"])))))


def _number_of(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _by_strength(records: Sequence[TrialRecord]) -> Table:
    rows = []
    for name in dict.fromkeys(r.truth[0] for r in records if r.group == "singles"):
        of_effect = [r for r in records if r.group == "singles" and r.truth[0] == name]
        cells = []
        for strength in STRENGTHS:
            of = [r for r in of_effect if r.strength == strength]
            cells.append(f"{sum(r.family_first for r in of)} / {sum(r.inside for r in of)} of {len(of)}" if of else "–")
        rows.append((name, of_effect[0].solver, *cells))
    return Table("Right family first / truth inside the reported set", ("effect", "solver", *STRENGTHS), tuple(rows))


def _ablations(records: Sequence[TrialRecord]) -> Table:
    ablated = [r for r in records if r.ablations]
    rows = []
    for name, title in (("whole", "complete"), ("no_reference", "without the noise of the reference image"),
                        ("no_projection", "without projection"), ("size", "size of the residual only")):
        clean = [r for r in ablated if r.group == "clean"]
        single = [r for r in ablated if r.group == "singles"]
        alarms = sum(bool(r.ablations[name]["alarm"]) for r in clean)
        n_alarms = sum(bool(r.ablations[name]["alarm"]) for r in single)
        right = sum(r.ablations[name].get("name") in r.truth for r in single)
        rows.append((title, f"{alarms} of {len(clean)}", f"{n_alarms} of {len(single)}",
                     "–" if name == "size" else f"{right} of {len(single)}"))
    return Table("Alarms at a family-wise 1 %, and the true effect first", ("screening", "alarms on clean",
                                                                       "alarms on single effects", "true effect first"),
                 tuple(rows))


def _all(records: Sequence[TrialRecord]) -> Table:
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
             _as_frozen(run["tool"]["thresholds"], frozen)) for run in register["runs"]]
    return Table("Runs of this trial", ("began", "trials", "answered before", "commit", "local changes",
                                        "thresholds as frozen"), tuple(rows))


def _thresholds(frozen: Mapping[str, float]) -> Table:
    modules: dict[str, list[str]] = {}
    for name, value in frozen.items():
        module, _, constant = name.rpartition(".")
        modules.setdefault(module, []).append(f"{constant} = {value:g}")
    rows = tuple((module, ", ".join(constants)) for module, constants in modules.items())
    return Table("Thresholds", ("module", "constants"), rows)


def _as_frozen(thresholds: Mapping[str, float], frozen: Mapping[str, float]) -> str:
    """Whether the thresholds of a run are the frozen ones, by the names that both versions of the tool have."""
    common = thresholds.keys() & frozen.keys()
    if not common:
        return "not known"
    return "yes" if all(thresholds[name] == frozen[name] for name in common) else "no"
