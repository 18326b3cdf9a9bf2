"""Evaluated systems on disk: M, b, objective and frame records, one group per evaluation."""

from __future__ import annotations

import numpy as np

from idic.correlation import CorrelationSystem, FrameRecord
from idic.identification import Evaluation
from idic.run.store.arrays import read_array, write_array
from idic.run.store.layout import group_name
from idic.run.store.run_store import RunStore
from idic.run.store.schemas.groups import StoredSystem

LABEL = "system"
_PER_FRAME = ("frame", "n_pixels", "n_lost", "rr", "channel_residual", "local_step", "local_slope", "brightness",
              "cameras", "channel_columns", "n_fitted", "channel_kept")
_OPTIONAL = ("end_noise", "retention")


def save_evaluation(store: RunStore, evaluation: Evaluation) -> None:
    """Store an evaluated point atomically; a failed simulation is stored without a system."""
    system = evaluation.system
    ident = {"number": evaluation.number, "names": list(system.names) if system else [],
             "failed": system is None, "message": evaluation.message,
             "generalised": system is not None and system.generalised,
             "predicts": system is not None and system.predicted is not None, "increments": evaluation.increments}
    with store.building(group_name(evaluation.number, LABEL), ident) as folder:
        if system is None:
            return
        predicted = system.M if system.predicted is None else system.predicted
        for name, values in (("M", system.M), ("predicted", predicted), ("b", system.b), ("spread", system.spread),
                             ("reference_gram", evaluation.reference_gram),
                             ("phi", np.array([system.phi, system.phi_image]))):
            write_array(folder, name, values)
        for name in _OPTIONAL:
            if (values := getattr(system, name)) is not None:
                write_array(folder, name, values)
        for name in _PER_FRAME:
            write_array(folder, f"frame_{name}", np.array([getattr(record, name) for record in system.frames]))


def load_evaluation(store: RunStore, number: int, names: tuple[str, ...]) -> Evaluation:
    """The stored point `number`, its degrees of freedom in the order `names` of the run."""
    folder = store.group(group_name(number, LABEL))
    phi, kind = read_array(folder, "phi"), store.ident(folder, StoredSystem)
    columns = {name: read_array(folder, f"frame_{name}") for name in _PER_FRAME}
    records = tuple(
        FrameRecord(int(columns["frame"][i]), int(columns["n_pixels"][i]), int(columns["n_lost"][i]),
                    float(columns["rr"][i]), n_fitted=float(columns["n_fitted"][i]),
                    **{name: columns[name][i] for name in _PER_FRAME[4:] if name != "n_fitted"})
        for i in range(len(columns["frame"])))
    system = CorrelationSystem(names, read_array(folder, "M"), read_array(folder, "b"), float(phi[0]), float(phi[1]),
                               read_array(folder, "spread"), np.zeros((0, len(names))), records,
                               generalised=bool(kind["generalised"]),
                               predicted=read_array(folder, "predicted") if kind["predicts"] else None,
                               **{name: read_array(folder, name) for name in _OPTIONAL if (folder / name).exists()})
    return Evaluation(number, system, read_array(folder, "reference_gram"), increments=int(kind["increments"]))
