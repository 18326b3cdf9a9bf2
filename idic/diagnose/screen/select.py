"""From score tests to a shortlist: significance, practical size, indistinguishable candidates.

A candidate passes with a family-wise p below 1 % *and* an effect of practical size (`screen.practical`): interpolation
and discretisation leave patterns below it of which every candidate explains a little. The null of the p-value is noise
and the errors of the simulation that the model does not count (`Scores.beyond_errors`). What does not pass is excluded
with a bound where the test would have seen it, and left open where it would not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Variant
from idic.diagnose.residual.evidence import Columns, Evidence
from idic.diagnose.residual.grey_value_effects import BLUR
from idic.diagnose.residual.score import Scores, null_model, score
from idic.diagnose.residual.thinning import COPY_VARIANCE_FACTOR, drop_on_copy
from idic.diagnose.screen.effect_sizes import columns_together, effect_sizes, sum_of
from idic.diagnose.screen.free_courses import course_stem, fewest_knots
from idic.diagnose.screen.practical import ASSUMED_SIZE, EffectSize, PracticalSize
from idic.diagnose.screen.score_columns import ScoreColumn
from idic.diagnose.screen.significance import Significance, significances
from idic.model import TEMPERATURE

MAX_FAMILYWISE_P = 0.01  # family-wise
MIN_PROBE_Z = 5.0  # a probe of so many standard deviations would have been seen
MIN_SEPARATION_CHI2 = 9.0  # D = S (1 - rho^2), three standard deviations
MAX_SHORTLIST = 5
MIN_MATERIAL_GAIN = 0.8  # of the gain of a candidate's best material: another one is refitted as well
MIN_GAIN_SHARE = 0.02  # of the best predicted gain: a candidate that promises less is screened again in the next round
MIN_COURSE_SHARE = 0.5  # of the promise of a free course: a screened course that promises as much is refitted first
EQUAL_DIGITS = 6  # of two statistics that are the same
MAX_HIDDEN_VISIBILITY = 0.05  # visibility below which the parameters hide an effect


@dataclass(frozen=True)
class Ranked:
    """How a candidate stands after the screening.

    subject : the material that it is about, where there are several: one that yields is another cause than another
    best : column number; variant, name : what it is; amplitude, std : expected change in amplitudes of the column (1 =
    the probe) or, for direct variants, in units of the degree of freedom; gain : predicted drop of chi-square of the
    variant on a copy, where it is refitted; effect_px, effect_channel : rms of what the model in hand leaves of it,
    px and standard deviations of a reading; local_px : the same where and when it acts; standing : "significant" |
    "small" | "inadmissible" | "excluded" | "cannot_tell"; largest_probe_z : standard deviations by which a plausible
    effect would stand out, of the variant that shows most; moves : change of the identified parameters per unit of the
    amplitude; start : values of the knots of a free course, by the score
    """

    candidate: Candidate
    best: int
    variant: Variant
    label: str
    statistic: float
    p_familywise: float
    amplitude: float
    std: float
    visibility: float
    gain: float
    effect_px: float
    effect_channel: float
    bias: Mapping[str, float]
    standing: str
    material: str = ""
    largest_probe_z: float = np.inf
    moves: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    local_px: float = 0.0

    @property
    def key(self) -> tuple[str, str]:
        return self.candidate.name, self.material

    @property
    def called(self) -> str:
        """Its name, and where there are several materials the one that it is about."""
        return self.candidate.name.replace("_", " ") + (f" of {self.material}" if self.material else "")

    @property
    def probe_size(self) -> float:
        """Amplitude of a plausible effect, infinite where none is known."""
        return _probe_size(self.variant)

    @property
    def bound(self) -> float:
        """|amplitude| that is excluded with 95 %."""
        return abs(self.amplitude) + 1.96 * self.std


@dataclass(frozen=True)
class Screening:
    """All candidates, best first, and the joint table they come from.

    untestable : (candidate, why this record cannot tell it from its rivals), which are not among them
    practical : the size below which none is named
    """

    ranked: tuple[Ranked, ...]
    trials: tuple[ScoreColumn, ...]
    scores: Scores
    untestable: tuple[tuple[Candidate, str], ...] = ()
    practical: PracticalSize = field(kw_only=True)

    def of(self, name: str) -> Ranked:
        return next(r for r in self.ranked if r.candidate.name == name)

    def free_course_of(self, variant: Variant) -> Variant | None:
        """The variant with the same pattern and a course that the data give, of the fewest knots.

        All materials share one temperature, but each expansion is a pattern of its own.
        """
        stem = course_stem(variant)
        variants = [trial.variant for trial in self.trials if trial.variant.free_course and trial.variant.new
                    and trial.name == trial.variant.label and course_stem(trial.variant) == stem
                    and (stem != TEMPERATURE or f"material.{variant.new[0]}" in trial.variant.edits)]
        return variants[0] if variants else None

    @property
    def significant(self) -> tuple[Ranked, ...]:
        return tuple(r for r in self.ranked if r.standing == "significant")

    @property
    def shortlist(self) -> tuple[Ranked, ...]:
        """What is worth a refit: the significant ones by predicted gain, `MAX_SHORTLIST` candidates.

        Of each all materials that promise nearly as much: what is far from linear hardly tells them apart.
        """
        return self._worth_a_refit(0)

    @property
    def reserve(self) -> tuple[Ranked, ...]:
        """The next `MAX_SHORTLIST` candidates: a large effect is beyond first order, and so is the order of
        promises."""
        return self._worth_a_refit(MAX_SHORTLIST)

    def _worth_a_refit(self, first_name: int) -> tuple[Ranked, ...]:
        best = max((r.gain for r in self.significant), default=0.0)
        worth = sorted((r for r in self.significant if r.gain >= MIN_GAIN_SHARE * best), key=lambda r: -r.gain)
        names = list(dict.fromkeys(r.candidate.name for r in worth))[first_name:first_name + MAX_SHORTLIST]
        first = {name: next(r.gain for r in worth if r.candidate.name == name) for name in names}
        return tuple(r for r in worth if r.candidate.name in names
                     and r.gain >= MIN_MATERIAL_GAIN * first[r.candidate.name])

    def separation_chi2(self, first: Ranked, second: Ranked) -> float:
        """D = S (1 - rho^2), S of the better: chi-square by which a copy prefers one pattern over the other."""
        rho = self.scores.correlation[first.best, second.best]
        return float(max(first.statistic, second.statistic) ** 2 * max(1.0 - rho**2, 0.0)) / COPY_VARIANCE_FACTOR


def screen_candidates(evidence: Evidence, parameters: Columns, trials: Sequence[ScoreColumn], columns: Columns,
           seed: int = 0, materials: Sequence[str] = (), practical: PracticalSize = ASSUMED_SIZE,
           mesh: Columns | None = None, known_columns: tuple[Columns, float] | None = None,
           errors: Columns | None = None) -> Screening:
    """Score all columns and rank the candidates.

    Parameters
    ----------
    materials : element sets; of several, each is a subject of its own
    parameters : columns of the identified parameters, as gathered
    practical : size of the effects below which no candidate is named
    mesh : what a finer mesh has changed in the residual, one column: a candidate must explain more than that did along
        its own pattern, as the finer mesh has an error, too
    errors : of the simulation that the model does not count: a part of the null, each with an amplitude from 0 to 1
    """
    together, null = columns_together(trials), null_model(evidence, parameters)
    scores = score(evidence, null, columns, *([] if mesh is None else [mesh]),
                   *([] if errors is None else [errors]), *([] if known_columns is None else [known_columns[0]]))
    if known_columns is not None:
        blurs = np.array([trial.variant.pixels is not None and trial.variant.pixels[0] == BLUR for trial in trials])
        scores = scores.beside(known_columns[0].n, known_columns[1],
                               np.append(blurs, np.zeros(len(scores.U) - known_columns[0].n - len(blurs),
                                                                               dtype=bool)))
    n_errors = 0 if errors is None else errors.n
    by_errors = scores.information[:columns.n, len(scores.U) - n_errors:]  # (K, n)
    scores = scores.first(len(scores.U) - n_errors)
    scores, shared = (scores, np.zeros(columns.n)) if mesh is None else scores.split()
    joint = [fewest_knots(scores, members) if trials[members[0]].variant.new else members for members in together]
    ways = scores.ways(joint)
    shared, by_errors = shared @ ways, ways.T @ by_errors
    scores = scores.with_sums([trials[members[0]].variant.label for members in joint], joint)
    tested = scores.beyond_errors(by_errors)
    by_mesh = np.divide(shared**2, scores.own, out=np.zeros_like(scores.U), where=scores.own > 0)
    sums = {len(trials) + k: members for k, members in enumerate(together)}
    trials = (*trials, *(sum_of([trials[i] for i in members]) for members in joint))
    groups: dict[tuple[str, str, bool], list[int]] = {}
    for i, trial in enumerate(trials):
        is_free = trial.variant.free_course  # its knots are no tests of their own
        if i in sums or not is_free:
            groups.setdefault((trial.candidate.name, material_of_variant(trial.variant, materials), is_free),
                              []).append(i)
    signs = np.array([trial.variant.sign for trial in trials])
    standings = significances(tested, groups, signs, np.random.default_rng(seed), sums) if groups else {}
    standings = {key: replace(standing,
                              p_familywise=min(1.0, trials[standing.best].variant.searched * standing.p_familywise))
                 for key, standing in standings.items()}
    best = [standings[key].best for key in groups]
    amplitudes = scores.expected_change[best]
    sizes = effect_sizes(evidence, parameters, columns, ways[:, best] * amplitudes, scores.moves[:, best] * amplitudes)
    ranked = [replace(_ranked(trials, scores, standings[key], members, size, practical, columns.n, by_mesh),
                      material=key[1])
              for (key, members), size in zip(groups.items(), sizes, strict=True)]
    ranked = [admissible(replace(r, start=dict(zip(r.variant.new,
                                                   scores.together(joint[r.best - columns.n]).tolist(), strict=True))))
              if r.variant.free_course and r.variant.new else r for r in ranked]
    return Screening(tuple(sorted(proposed(ranked), key=_place)), tuple(trials), scores, practical=practical)


def _place(ranked: Ranked) -> tuple[float, bool]:
    """In the ranking: of candidates that the same column speaks for, a limit comes before what it is a limit of."""
    return -round(ranked.statistic, EQUAL_DIGITS), bool(ranked.candidate.limits)


def admissible(ranked: Ranked) -> Ranked:
    """A free course whose knots have, on the whole, the sign of its cause; of another sign it is inadmissible: a
    friction that pushes."""
    wrong = ranked.variant.sign * sum(ranked.start.values()) < 0.0
    return replace(ranked, standing="inadmissible") if wrong and ranked.standing == "significant" else ranked


def proposed(ranked: Sequence[Ranked]) -> list[Ranked]:
    """One entry per candidate and material: its free course stands for it where no screened course of any candidate
    promises half as much, and it is significant.

    A free course takes a part of almost every mismatch; where a ramp, a jump or a law promises as much with one
    unknown, that is refitted, and the course is freed where it leaves something
    (`idic.diagnose.selection.moves.own_course`).
    """
    plain = {r.key: r for r in ranked if not r.variant.free_course}
    bar = max((r.gain for r in plain.values() if r.standing == "significant"), default=0.0) / MIN_COURSE_SHARE
    best: dict[tuple[str, str], Ranked] = {}
    for r in ranked:
        if r.variant.free_course and r.standing == "significant" and r.gain > bar:
            best[r.key] = r
    return list((plain | best).values())


def material_of_variant(variant: Variant, materials: Sequence[str]) -> str:
    """The material that a variant is about; "" for all other variants, and where there is one material only."""
    head = variant.new[0].partition(".")[0] if variant.new else ""
    return head if len(materials) > 1 and head in materials else ""


def _ranked(trials: Sequence[ScoreColumn], scores: Scores, standing: Significance, members: Sequence[int],
            size: EffectSize, practical: PracticalSize, n_columns: int, by_mesh: np.ndarray) -> Ranked:
    """size : of the expected change; n_columns : without the sums behind them; by_mesh : chi-square that a finer mesh
    changed along every column"""
    best = standing.best
    trial = trials[best]
    members_of_refit = [i for i in members if of_one_refit(trials[i].variant, trial.variant)
                        and i < n_columns] or [best]
    amplitude, std = float(scores.expected_change[best]), float(scores.std[best])
    gain = drop_on_copy(scores.gain(members_of_refit), len(members_of_refit))
    is_large = practical.is_reached(size) or trial.variant.least > 0.0
    matters = (is_large and scores.z[best] ** 2 > by_mesh[best] and abs(amplitude) > trial.variant.least)
    return Ranked(trial.candidate, best, trial.variant, trial.name, standing.statistic, standing.p_familywise,
                  amplitude, std, float(scores.visibility[best]), gain, size.px, size.channel_std,
                  scores.bias_uncovered(best), _cell(standing, trial.variant, amplitude, std, matters),
                  largest_probe_z=max(_stands_out(trials[i].variant, float(scores.std[i])) for i in members),
                  moves=dict(zip(scores.parameters, scores.moves[:, best].tolist(), strict=True)),
                  local_px=size.local_px)


def of_one_refit(first: Variant, second: Variant) -> bool:
    """Whether the same refit frees the unknowns of both: they promise together what they explain together."""
    return first is second or (bool(first.refit) and first.refit == second.refit and first.new != second.new)


def _cell(standing: Significance, variant: Variant, amplitude: float, std: float, matters: bool) -> str:
    """Significant or not, with or without the power to see: the four cells."""
    if standing.p_familywise < MAX_FAMILYWISE_P:
        if variant.sign * amplitude < 0:
            return "inadmissible"
        return "significant" if matters else "small"
    probe = _probe_size(variant)
    return "excluded" if np.isfinite(std) and probe > MIN_PROBE_Z * std else "cannot_tell"


def _stands_out(variant: Variant, std: float) -> float:
    """Standard deviations of a plausible effect, 0 where it is invisible."""
    return _probe_size(variant) / std if np.isfinite(std) else 0.0


def _probe_size(variant: Variant) -> float:
    """Amplitude of a plausible effect: 1 for finite probes; of direct ones the probe's value, if it names one."""
    if not variant.direct or variant.free_course:
        return 1.0
    return max((abs(variant.probe[n] - variant.null.get(n, 0.0)) for n in variant.new if n in variant.probe),
               default=np.inf)
