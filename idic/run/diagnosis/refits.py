"""Refits of a diagnosis: run side by side, and stored under ``RUN/diagnosis`` for `idic diagnose --resume`.

A refit is known by everything that enters its computation: another edit, start or seed is another refit. Screenings
are repeated: they give the same numbers.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

import idic
from idic.diagnose import Fit, Misfit, RefitJob, run_refit
from idic.inside import folder_inside, is_inside, read_inside, remove_inside, write_inside
from idic.run.store.schemas.diagnosis import StoredRefit
from idic.run.store.schemas.types import refuse_other_types
from idic.run.workers.runner import TaskRunner

FOLDER = "diagnosis"
FITS = ("choice", "judgement")


def run_refits(runner: TaskRunner, store: RefitStore | None, jobs: Sequence[RefitJob]) -> list[Fit]:
    """Refits side by side, in the order of the jobs; each is stored when it ends.

    Parameters
    ----------
    store : None stores nothing
    """
    stored = [None if store is None else store.get(job) for job in jobs]
    missing = [job for job, refitted in zip(jobs, stored, strict=True) if refitted is None]
    names = [f"refit-{job.name}-{number}" for number, job in enumerate(missing)]
    new_refits = []
    for job, refitted in zip(missing, runner.stream(run_refit, missing, names, retries=1, copies=True), strict=True):
        if store is not None:
            store.put(job, refitted)
        new_refits.append(refitted)
    queue = iter(new_refits)
    return [next(queue) if refitted is None else refitted for refitted in stored]


class RefitStore:
    """Refits by their jobs.

    Parameters
    ----------
    run : RUN folder
    resume : False deletes the refits of an earlier diagnosis
    """

    def __init__(self, run: str | Path, resume: bool):
        self.run = Path(run)
        if not resume:
            remove_inside(run, FOLDER)

    def get(self, job: RefitJob) -> Fit | None:
        """The stored refit of this job; None without one, or where its file cannot be read."""
        if not is_inside(self.run, name := self._name(job)):
            return None
        try:
            return _read(read_inside(self.run, name), self.run / name)
        except Exception:  # noqa: BLE001 - a damaged archive raises whatever comes; the refit is made again
            return None

    def put(self, job: RefitJob, refit: Fit) -> None:
        """Store a refit completely or not at all."""
        plain = {name: getattr(refit, name)
                 for name in ("name", "label", "status", "evaluations", "problem", "phi", "estimator")}
        plain |= {"values": dict(refit.values), "stds": dict(refit.stds)}
        arrays = {"local": refit.local} | ({} if refit.steps is None else {"steps": np.asarray(refit.steps)})
        for name in FITS:
            misfit: Misfit | None = getattr(refit, name)
            plain[name] = None if misfit is None else misfit.pixels
            arrays |= {} if misfit is None else {f"{name}.{part}": getattr(misfit, part) for part in _ARRAYS}
        content = io.BytesIO()
        np.savez(content, plain=np.array(json.dumps(plain)), **arrays)
        folder_inside(self.run, FOLDER)
        write_inside(self.run, self._name(job), content.getvalue(), lasting=True)

    def _name(self, job: RefitJob) -> str:
        return f"{FOLDER}/{job.name}-{job_hash(job)}.npz"


_ARRAYS = [field.name for field in fields(Misfit) if field.name != "pixels"]


def _read(content: bytes, file: Path) -> Fit:
    """A refit; whatever error where the archive does not hold what `RefitStore.put` writes."""
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files}
    plain = json.loads(str(arrays.pop("plain")))
    refuse_other_types(plain, StoredRefit, file)
    if any(array.dtype.kind not in "fiub" for array in arrays.values()):
        raise ValueError("arrays that hold no numbers")
    fits = {name: None if plain[name] is None else _fit(name, plain[name], arrays) for name in FITS}
    return Fit(**(plain | fits), local=arrays["local"], steps=arrays.get("steps"))


def _fit(name: str, pixels: float, arrays: Mapping[str, np.ndarray]) -> Misfit:
    misfit = Misfit(**{part: arrays[f"{name}.{part}"] for part in _ARRAYS}, pixels=pixels)
    if not misfit.frames.shape == misfit.gain.shape == misfit.rank.shape == misfit.channels.shape[:1]:
        raise ValueError("arrays of other numbers of frames")
    return misfit


def job_hash(job: RefitJob) -> str:
    """Hash of a job and of the version of idic, which may compute another refit of it."""
    stop = job.early_stop
    plain = {"idic": idic.__version__, "source": dict(job.source.edits), "labels": job.labels,
             "edits": [dict(e) for e in job.edits],
             "values": [{name: float(v).hex() for name, v in values.items()} for values in job.values],
             "race": "None" if stop is None else f"Race(null={stop.null!r}, best={stop.best!r})", "copies": job.copies,
             "swapped": job.swapped, "borrowed": job.borrowed, "estimator": job.estimator,
             "to_its_end": job.unlimited, "seed": job.seed} | ({"whole_std": True} if job.whole_std else {})
    plain |= {} if job.most_evaluations is None else {"most_evaluations": job.most_evaluations}
    error, begun = job.source.motion_error, job.begun
    arrays = [job.local, job.grid.at, job.grid.low, job.grid.extent, job.grid.cells,
              *(() if error is None else (error.u, error.channels))]
    if begun is not None:
        plain |= {"begun": {name: float(value).hex() for name, value in begun.values.items()}}
        arrays += [begun.local, begun.steps, *(array for at in begun.frames for array in (at.u, at.channels, at.du))]
    text = json.dumps(plain, sort_keys=True, default=repr)
    return hashlib.sha256(text.encode() + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()[:16]
