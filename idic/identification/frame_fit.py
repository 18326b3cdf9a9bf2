"""How well the identified model explains every frame and every channel, and which frames it does not explain."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.correlation import ResidualMap, TexturePair, Weights
from idic.identification.discrepancy.normal_equations import DiscrepancySystem
from idic.identification.judgement.basis import basis_content, load_of_frames
from idic.identification.noise.input_noise import noise_content
from idic.identification.result import build_result
from idic.identification.step.state import Evaluation, LoopState
from idic.model import Experiment

MIN_UNEXPLAINED_CHI2 = 2.0  # per pixel; a frame below is explained
MAX_CHI2_OVER_MEDIAN = 4.0  # chi2 of a frame over the median of all frames; above, this model does not explain it
MAX_CHI2_OVER_FREE_DIC = 3.0  # over that of a free FE-DIC of the frame: two thirds of it are due to the model


@dataclass(frozen=True)
class FrameFit:
    """How well one frame is explained: n pixels, rms (GV), mean of r² / [σ² (1 + w²)]."""

    frame: int
    n_pixels: int
    rms_gv: float
    chi2_dof: float

    @classmethod
    def of(cls, frame: int, residual: ResidualMap, sigma: float, n_fitted: float = 0.0) -> FrameFit:
        """The fit of a frame with this residual; sigma : noise of one image (GV); n_fitted : `FrameRecord.n_fitted`."""
        r = residual.r[residual.valid].astype(float)
        chi2 = residual.chi2_dof(sigma) * (len(r) / max(len(r) - n_fitted, 1.0) if n_fitted else 1.0)
        return cls(frame, len(r), float(np.sqrt(np.mean(r**2))) if len(r) else float("nan"), chi2)


@dataclass(frozen=True)
class PointFit:
    """How well a point explains a recording.

    frames : per camera, the fits of its frames
    channels : (n_frames, n_channels) measured minus simulated, of the correlated frames
    free_dics : per camera, ``chi2_dof`` and ``rms_gv`` of every frame of a free FE-DIC  # (n_frames,), None without one
    textures : pairs of cameras that were compared; notes : on the simulation
    """

    frames: Sequence[Mapping[int, FrameFit]]
    channels: np.ndarray
    free_dics: Sequence[Mapping[str, np.ndarray] | None]
    textures: Sequence[TexturePair] = ()
    notes: Sequence[str] = ()

    @property
    def free_chi2(self) -> list[np.ndarray | None]:
        """Per camera, chi² per pixel that a free FE-DIC leaves in every frame  # (n_frames,)"""
        return [None if dic is None else dic["chi2_dof"] for dic in self.free_dics]


def experiment_result(experiment: Experiment, state: LoopState, point: Evaluation | None, weights: Weights,
                      fit: PointFit, excluded_by_user: Collection[int], cost: Mapping,
                      discrepancy: DiscrepancySystem | str) -> dict:
    """The result of one experiment: `build_result` with its fit.

    Parameters
    ----------
    point : the accepted evaluation; None, or without a system, where no simulation converged
    weights : with the noise figures behind them
    excluded_by_user : frames
    cost, discrepancy : as of `build_result`
    """
    compared = None if point is None or point.system is None else point
    residual = residual_summary(experiment, fit.frames, fit.channels, weights.channel_noise,
                                None if compared is None else compared.system.n_lost, fit.free_dics[0])
    entries = frame_entries(experiment, fit.frames[0], excluded_by_user, fit.free_chi2[0])
    result = build_result(experiment, state, compared, weights.image_noise, residual, entries, cost, discrepancy)
    result["basis"] = basis_content(entries, load_of_frames(experiment))
    result["notes"] += fit.notes
    if experiment.cameras:
        result["cameras"] = camera_entries(experiment, compared, fit, excluded_by_user)
        result["notes"] += [pair.note() for pair in fit.textures]
    return result


def frame_entries(experiment: Experiment, fits: Mapping[int, FrameFit], excluded_by_user: Collection[int],
                  free_chi2: np.ndarray | None = None) -> list[dict]:
    """Status of every frame: ok, excluded (by the user), unexplained, lost; references are ok.

    The residual of an unexplained frame is much larger than that of most others, or than that of a free FE-DIC: where
    the model fails in half of the frames, the median says nothing.

    free_chi2 : (n_frames,) chi² per pixel of a free FE-DIC, NaN where it is unknown
    """
    model, recording = experiment.model, experiment.recording
    references = recording.averaged or (model.reference,)
    correlated = [k for k in fits if k not in recording.excluded and fits[k].n_pixels]
    typical = float(np.median([fits[k].chi2_dof for k in correlated])) if correlated else float("nan")
    entries = []
    for frame in range(model.n_frames):
        fit, reference = fits.get(frame), frame in references
        of_free = np.inf if free_chi2 is None else MAX_CHI2_OVER_FREE_DIC * free_chi2[frame]
        allowed = max(MIN_UNEXPLAINED_CHI2, np.fmin(MAX_CHI2_OVER_MEDIAN * typical, of_free))
        if reference:
            status = "ok"
        elif frame < model.reference or frame in excluded_by_user:
            status = "excluded"
        elif frame in recording.excluded:
            status = "lost" if fit is not None and fit.n_pixels == 0 else "unexplained"
        elif fit is not None and fit.n_pixels == 0:
            status = "lost"
        elif fit is not None and fit.chi2_dof > allowed:
            status = "unexplained"
        else:
            status = "ok"
        entries.append({
            "frame": frame, "label": recording.labels[frame], "status": status, "reference": reference,
            "rms_gv": 0.0 if frame == model.reference else fit.rms_gv if fit else None,
            "chi2_dof": None if reference or fit is None else fit.chi2_dof,
            "n_pixels": None if fit is None else fit.n_pixels, "used": frame in correlated})
    return entries


def camera_entries(experiment: Experiment, point: Evaluation | None, fit: PointFit,
                   excluded_by_user: Collection[int]) -> dict:
    """Noise, fit and frames of every camera of several, by name."""
    entries = {}
    for number, view in enumerate(experiment.views):
        used = used_fits(view, fit.frames[number])
        lost = None if point is None else int(sum(record.cameras[number, 1] for record in point.system.frames))
        entries[view.recording.camera_name] = {
            "noise": noise_content(view.recording),
            "residual": {"image_rms_gv": mean_rms(used), "image_chi2_dof": mean_chi2(used), "lost_pixels": lost},
            "frames": frame_entries(view, fit.frames[number], excluded_by_user, fit.free_chi2[number])}
    for pair in fit.textures:
        entries[pair.second]["texture"] = pair.entry()
    return entries


def used_fits(experiment: Experiment, fits: Mapping[int, FrameFit]) -> list[FrameFit]:
    """The fits of the correlated frames in which the pattern is seen."""
    frames = experiment.correlated_frames(range(experiment.model.n_frames))
    return [fits[k] for k in frames if k in fits and fits[k].n_pixels]


def mean_rms(used: Sequence[FrameFit]) -> float | None:
    """Root mean square over the pixels of all frames, GV; None without any."""
    pixels = sum(fit.n_pixels for fit in used)
    return np.sqrt(sum(f.n_pixels * f.rms_gv**2 for f in used) / pixels) if pixels else None


def mean_chi2(used: Sequence[FrameFit]) -> float | None:
    """chi² per pixel over all frames; None without any."""
    pixels = sum(fit.n_pixels for fit in used)
    return sum(f.n_pixels * f.chi2_dof for f in used) / pixels if pixels else None


def residual_summary(experiment: Experiment, fits: Sequence[Mapping[int, FrameFit]], channels: np.ndarray,
                     channel_noise: np.ndarray, lost_pixels: int | None,
                     free_dic: Mapping[str, np.ndarray] | None) -> dict:
    """The fit of images and channels; chi2 over all cameras, the rms in grey values of the main one; rms and noise of a
    channel in the unit of its column.

    Parameters
    ----------
    fits : per camera, by frame
    channels : (n_frames, n_channels) measured minus simulated; channel_noise : (n_channels,)
    free_dic : ``chi2_dof`` and ``rms_gv`` of every frame of a free FE-DIC  # (n_frames,)
    """
    model = experiment.model
    used = used_fits(experiment, fits[0])
    factors = [channel.shown_factor for channel in model.channels]
    columns = [(i, channel.column) for i, channel in enumerate(model.channels) if len(channels)]
    summary = {
        "image_rms_gv": mean_rms(used),
        "image_chi2_dof": mean_chi2([fit for camera in fits for fit in used_fits(experiment, camera)]),
        "lost_pixels": lost_pixels,
        "channel_rms": {column: float(np.sqrt(np.mean(channels[:, i] ** 2))) / factors[i] for i, column in columns},
        "channel_chi2_dof": {column: float(np.mean(channels[:, i] ** 2) / channel_noise[i] ** 2)
                             for i, column in columns},
        "channel_noise_std": {c.column: float(channel_noise[i]) / factors[i]
                              for i, c in enumerate(model.channels)},
    }
    if free_dic is not None:
        frames = [fit.frame for fit in used]
        summary["free_dic_chi2_dof"] = float(np.nanmean(free_dic["chi2_dof"][frames])) if frames else None
        summary["free_dic_rms_gv"] = float(np.sqrt(np.nanmean(free_dic["rms_gv"][frames] ** 2))) if frames else None
    return summary
