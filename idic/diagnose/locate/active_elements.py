"""Place and time of the selected physics in the enriched model: elements that yield, or are damaged.

The map of sources asks the residual alone and knows no physics. Where forces are passed on through the whole body (a
membrane, a chain) every element answers alike; the model that was named says where it begins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.fe import PointValues
from idic.identification import Identification
from idic.model import Experiment

MIN_ACTIVE_STRAIN = 1e-7  # plastic strain, or strain beyond the threshold of damage
ACTIVE_STATES = {"plastic_strain": "yields", "largest_strain": "is damaged"}


@dataclass(frozen=True, eq=False)
class Activity:
    """What acts, and since when.

    verb : in words; since : (n_elements,) first frame of an element, -1 where it never acts; amount : (n_elements,)
    largest value of its points in the last frame
    """

    verb: str
    since: np.ndarray
    amount: np.ndarray

    @property
    def first_frame(self) -> int:
        return int(self.since[self.since >= 0].min())

    @property
    def first(self) -> np.ndarray:
        """Elements that begin first  # (n,) indices"""
        return np.flatnonzero(self.since == self.first_frame)


def activity(model: Identification) -> Activity | None:
    """March a model and watch its points; None where nothing in it yields or is damaged.

    Raises
    ------
    NotConverged
        If the model finds no equilibrium.
    """
    experiment, sections = model.experiment, model.forward.body.sections
    since = np.full(experiment.model.mesh.n_elements, -1)
    amount, verb = np.zeros(experiment.model.mesh.n_elements), ""
    for state in model.march():
        for points in state.points:
            law = sections[points.section].law.spec
            name = next((s for s in ACTIVE_STATES if s in law.state_names), None)
            if name is None:
                continue
            verb = ACTIVE_STATES[name]
            value = _beyond(points, law.state_names.index(name), experiment, sections[points.section].name,
                            model.parameters.as_values())
            amount[points.elements] = value
            activated = points.elements[(value > MIN_ACTIVE_STRAIN) & (since[points.elements] < 0)]
            since[activated] = state.frame + experiment.model.reference
    return Activity(verb, since, amount) if (since >= 0).any() else None


def _beyond(points: PointValues, index: int, experiment: Experiment, name: str, values) -> np.ndarray:
    """Largest value of every element's points, less the threshold where the law has one  # (n_el,)"""
    largest = points.state[:, index].reshape(len(points.elements), -1).max(axis=1)
    return np.maximum(largest - values.get(f"{name}.threshold", 0.0), 0.0)
