"""FittedModel refits of a diagnosis under ``RUN/diagnosis``: what `idic diagnose --resume` does not compute again.

A refit is known by everything that goes into it; a changed edit, start or seed is another refit. Screenings are the
same numbers every time and are repeated.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np

from idic.diagnose.refit import Refit
from idic.diagnose.residual.heldout import Fit
from idic.run.diagnosis.refit_job import RefitJob

FOLDER = "diagnosis"


class RefitStore:
    """Refits by their jobs.

    Parameters
    ----------
    run : RUN folder
    resume : False forgets what an earlier diagnosis left
    """

    def __init__(self, run: str | Path, resume: bool):
        self.folder = Path(run) / FOLDER
        if not resume and self.folder.exists():
            shutil.rmtree(self.folder)

    def get(self, job: RefitJob) -> Refit | None:
        """The stored refit of this job, None without one."""
        path = self._path(job)
        if not path.exists():
            return None
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        plain = json.loads(str(arrays.pop("plain")))
        fits = {name: None if plain[name] is None else _fit(name, plain[name], arrays)
                for name in ("choice", "judgement")}
        return Refit(**(plain | fits), local=arrays["local"], steps=arrays.get("steps"))

    def put(self, job: RefitJob, refit: Refit) -> None:
        """Store a refit whole or not at all."""
        plain = {name: getattr(refit, name) for name in ("name", "label", "status", "evaluations", "problem", "phi",
                                                   "estimator")}
        plain |= {"values": dict(refit.values), "stds": dict(refit.stds)}
        arrays = {"local": refit.local} | ({} if refit.steps is None else {"steps": np.asarray(refit.steps)})
        for name in ("choice", "judgement"):
            one: Fit | None = getattr(refit, name)
            plain[name] = None if one is None else one.pixels
            arrays |= {} if one is None else {f"{name}.{part}": getattr(one, part) for part in _ARRAYS}
        self.folder.mkdir(parents=True, exist_ok=True)
        path, part = self._path(job), self.folder / f"{job.name}.part"
        with open(part, "wb") as file:
            np.savez(file, plain=np.array(json.dumps(plain)), **arrays)
        os.replace(part, path)

    def _path(self, job: RefitJob) -> Path:
        return self.folder / f"{job.name}-{_fingerprint(job)}.npz"


_ARRAYS = [field.name for field in fields(Fit) if field.name != "pixels"]


def _fit(name: str, pixels: float, arrays) -> Fit:
    return Fit(**{part: arrays[f"{name}.{part}"] for part in _ARRAYS}, pixels=pixels)


def _fingerprint(job: RefitJob) -> str:
    """Hash of a job; its keys and the form of ``race`` are part of stored file names."""
    stop = job.early_stop
    plain = {"source": dict(job.source.edits), "labels": job.labels, "edits": [dict(e) for e in job.edits],
             "values": [{name: float(v).hex() for name, v in values.items()} for values in job.values],
             "race": "None" if stop is None else f"Race(null={stop.null!r}, best={stop.best!r})", "copies": job.copies,
             "swapped": job.swapped, "borrowed": job.borrowed, "estimator": job.estimator,
             "to_its_end": job.unlimited, "seed": job.seed}
    text = json.dumps(plain, sort_keys=True, default=repr)
    arrays = (job.local, job.grid.at, job.grid.low, job.grid.extent, job.grid.cells)
    return hashlib.sha256(text.encode() + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()[:16]
