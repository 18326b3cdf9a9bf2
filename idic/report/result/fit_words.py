"""Whether the images are explained, judged against the free FE-DIC on the same mesh and by the local test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from idic.identification import z_text
from idic.parameters import digits_text

NOISE_CHI2 = (0.9, 1.1)  # image chi² per pixel that camera noise explains: its own uncertainty is below 1 %,
#                          the rest is the uncertainty of the estimate of sigma
MIN_CHI2_OF_FIELDS = 0.8  # where their noise is correlated (an unknown takes more than one component) and not stated
MAX_FREE_DIC_CHI2 = 2.0  # times the χ² of the model: above, the free FE-DIC failed to match the pattern in some frames
MAX_CHI2_OVER_FREE = 0.03  # χ² per pixel that a free motion may save before the model is said to lack one
MAX_SHARE_OVER_FREE = 0.15  # of the χ² above noise that a free motion saves, where the model follows as well as it does
MIN_SHOWN_PART = 1e-3  # of a standard deviation: a smaller error is none
MIN_REMEDY_SHARE = 0.2  # of the χ² above noise that a remedy removes before it is recommended
MAX_P_OF_EQUAL_SPECIMENS = 0.01  # probability of the seen scatter among equal specimens: below, they differ
IN_TIME = {0: "in the first quarter of the frames", 1: "in the second quarter of the frames",
           2: "in the third quarter of the frames", 3: "in the last quarter of the frames"}

WORDS_OF_FIELDS = (  # what is said of images, and of measured fields in their place
    ("The image residual is", "The residual of the fields is"), ("mean image residual", "mean residual of the fields"),
    ("Image residual per frame", "Residual of the fields per stage"), ("image residual", "residual of the fields"),
    ("stated camera noise", "stated noise of the fields"), ("estimated camera noise", "estimated noise of the fields"),
    ("than camera noise", "than their noise"),
    ("to camera noise", "to their noise"), ("is camera noise", "is their noise"), ("camera noise alone", "noise alone"),
    ("camera noise", "noise of the fields"), ("per pixel", "per component"),
    ("a free FE-DIC of the images", "a free fit of the fields"), ("a free FE-DIC", "a free fit of the fields"),
    ("The free FE-DIC", "The free fit of the fields"), ("free FE-DIC", "free fit"),
    ("noise of one image", "noise of a component"),
    ("camera's floor", "floor of the fields"), ("camera&#39;s floor", "floor of the fields"),
    (", after interpolation and low-pass", ""),
    ("f + h − g(x + u) in the reference image; ", "The compared components of a point, rms. "),
    ("residual of image noise alone", "noise alone"),
    ("pixels off the image or in gaps", "points that are missing"),
    ("light or aliasing is left", "the fields are not smooth"),
    ("motion or brightness (height)", "motion"),
    ("Residuals: measured images and channels minus simulated ones",
     "Residuals: measured fields and channels minus simulated ones"),
    ("Motion in images at rest", "Motion in stages at rest"), ("in images at rest", "in stages at rest"),
    ("Its causes are light, air, focus or aliasing, in loaded frames too",
     "Its cause is the other system, in loaded stages too"),
    ("Rigid motion, image noise and", "Rigid motion, noise and"), (">image noise<", ">noise<"),
    ("no image at rest", "no stage at rest"), ("from a still image with", "from a stage at rest with"),
    ("rises (over the size of a pixel)", "rises"), (">image<", ">stage<"), (">pixels<", ">components<"),
    ("averaged over 9 × 9 px", "averaged over 9 × 9 distances of neighbours"),
    ("its images, fields and channels", "its fields and channels"),
    ("the image does not match the reference", "no smooth motion follows the points"),
    ("from the noise of images and channels", "from the noise of fields and channels"),
    ("Image with the simulated mesh, and the residual", "Points with the simulated mesh, and the residual"),
    ("Motion of the pattern", "Motion of the points"), ("How far the pattern moves", "How far the points move"),
    ("over the reference image", "over the points"),
    ("explains the images better", "explains the fields better"),
    ("it changes neither images nor channels", "it changes neither "
     "fields nor channels"), ("the noise of the images", "the noise of the fields"),
     ("a camera shows only", "a field shows only"),
    ("from camera and channel noise", "from the noise of fields and channels"),
    ("the same motion in the images", "the same motion in the fields"),
    ("motion of the pattern", "motion of the points"), ("as images determine only", "as fields determine only"),
    ("images only", "fields only"), ("images and channels", "fields and channels"),
    ("noise of the reference image", "noise of the reference stage"),
)


def noise_chi2(result: Mapping) -> tuple[float, float]:
    """The range of χ² per pixel or component that noise explains."""
    estimated = result.get("quantity") == "displacement" and result.get("noise", {}).get("source") != "given"
    return (MIN_CHI2_OF_FIELDS if estimated else NOISE_CHI2[0]), NOISE_CHI2[1]


def in_words_of(result: Mapping, text: str) -> str:
    """A text on the fit of images in the words of what was measured: unchanged for images."""
    if result.get("quantity") != "displacement":
        return text
    for of_images, of_fields in WORDS_OF_FIELDS:
        text = text.replace(of_images, of_fields)
    return text


@dataclass(frozen=True)
class AgainstFree:
    """χ² per pixel of the model and of a free FE-DIC on the same frames and mesh; failed : the latter did not match;
    floor : below, a motion without a law follows noise (of fields, whose noise is correlated)."""

    model_chi2: float
    free_chi2: float
    failed: bool
    floor: float = 0.0

    @property
    def follows(self) -> bool:
        """Whether a free motion would explain next to nothing more than the model."""
        saved = self.model_chi2 - max(self.free_chi2, self.floor)
        return not self.failed and saved <= max(MAX_CHI2_OVER_FREE, MAX_SHARE_OVER_FREE * (self.model_chi2 - 1.0))


def against_free(result: Mapping) -> AgainstFree | None:
    """The comparison over all frames, where a free FE-DIC of all was made, else over the shown ones; None: neither."""
    residual = result.get("residual", {})
    model_chi2, free_chi2 = residual.get("image_chi2_dof"), residual.get("free_dic_chi2_dof")
    if free_chi2 is None and (selected_frames := residual.get("free_dic_shown")) is not None:
        model_chi2, free_chi2 = selected_frames["model_chi2_dof"], selected_frames["chi2_dof"]
    if model_chi2 is None or free_chi2 is None:
        return None
    floor = min(model_chi2, 1.0) if result.get("quantity") == "displacement" else 0.0
    return AgainstFree(model_chi2, free_chi2, free_chi2 > MAX_FREE_DIC_CHI2 * max(model_chi2, 1.0), floor)


def cluster(result: Mapping) -> str:
    """Where the residual is raised locally, in half a sentence; empty where it is even."""
    local = result.get("residual", {}).get("local")
    if not local or not local["is_cluster"]:
        return ""
    when = f" {IN_TIME[local['part']]}" if local["part"] is not None else ""
    return (f"around column {local['column']:.0f}, row {local['row']:.0f} px{when} (χ² = {local['chi2']:.2f} there, "
            f"{local['typical_chi2']:.2f} elsewhere; {z_text(local['z'])} standard deviations; "
            f"{100.0 * local['share']:.2g} % of the specimen)")


def images(result: Mapping) -> tuple[str, str, str]:
    """The fit to the images: level "good" | "look", verdict in a few words, explanation in sentences."""
    chi2 = result.get("residual", {}).get("image_chi2_dof")
    if chi2 is None:
        return "look", "Look closer: the noise of the images is not known", ""
    free_fit, place, numbers = against_free(result), cluster(result), _numbers(result, chi2)
    local = f" The residual is raised {place}." if place else ""
    if chi2 < noise_chi2(result)[0]:
        is_stated = result.get("noise", {}).get("source", "given") == "given"
        noise, cause = ("stated", "overstated") if is_stated else ("estimated", "overestimated")
        return ("look", f"Look closer: the {noise} noise is larger than the image residual",
                f"The image residual is smaller than the {noise} camera noise ({numbers}). "
                f"The noise is {cause}, and so are the error bars.{local}")
    if free_fit is not None and not free_fit.failed and not free_fit.follows:
        return ("look",
                f"Look closer: a free motion explains the images better (χ² = {chi2_text(free_fit.free_chi2)}, model "
                f"{chi2_text(free_fit.model_chi2)})",
                f"The image residual is {'larger than' if chi2 > NOISE_CHI2[1] else 'close to'} camera noise "
                f"({numbers}), and "
                f"a motion without a law explains {_share(free_fit)} of what is above noise. "
                f"{_lacking(result, '')}{local}")
    if chi2 > NOISE_CHI2[1]:
        if free_fit is not None and free_fit.follows:
            return ("look", "Look closer: the model fits as well as any motion can; light or aliasing is left",
                    f"The image residual is larger than camera noise ({numbers}), for a free motion too: no law "
                    f"explains it. {remedies(result)}{local}".rstrip())
        return ("look", f"Look closer: the image residual has {chi2_text(chi2)} times the variance of the noise",
                f"The image residual is larger than camera noise ({numbers}). "
                f"{_lacking(result, ', or light or aliasing is left')}{local}")
    if place:
        return ("look", "Look closer: the residual is noise on the whole, not everywhere",
                f"The mean image residual is camera noise ({numbers}), but it is raised {place}. "
                f"{in_error_bars(result)} {remedies(result)}".rstrip())
    return "good", "Good fit: the residual is noise", f"The image residual is camera noise ({numbers})."


def _lacking(result: Mapping, alternative: str) -> str:
    """What a residual above noise means: at values that are not the best ones, it says nothing of the model."""
    if result.get("status", "converged") != "converged":
        return "The search has not ended: better values may explain it."
    return f"The model lacks an effect{alternative}. The residual maps show where."


def _lacking_bases(result: Mapping) -> dict[str, Mapping]:
    """``basis`` of each experiment whose compared frames do not stand for its dropped ones; "" is the name of a single
    experiment."""
    bases = {name: part.get("basis") for name, part in (("", result), *result.get("experiments", {}).items())}
    return {name: basis for name, basis in bases.items() if basis and not basis["sufficient"]}


def basis_verdict(result: Mapping) -> tuple[str, str]:
    """The verdict of a run whose loaded frames are dropped: level "bad" | "look", and a few words."""
    if any(not basis["compared"] for basis in _lacking_bases(result).values()):
        return "bad", "No loaded image is compared: do not use the values"
    return "look", "Look closer: most of the load is left out"


def missing_load(result: Mapping) -> str:
    """Which loaded frames are left out and what the values rest on, in sentences; empty where frames are enough."""
    sentences = []
    for experiment, basis in _lacking_bases(result).items():
        dropped, loaded, compared = basis["dropped"], basis["loaded"], basis["compared"]
        name = f" of {experiment}" if experiment else ""
        dropped_text = (f"The only loaded image{name} is left out" if loaded == 1
                        else f"{dropped} of {loaded} loaded images{name} are left out" if dropped > 1
                        else f"One of {loaded} loaded images{name} is left out")
        basis_text = f"{compared} loaded image{'' if compared == 1 else 's'}"
        if not compared:
            basis_text = "the readings and images at rest alone"
        elif basis["load_compared"] is not None:
            basis_text += f", up to {100 * basis['load_compared']:.0f} % of the largest load"
        sentences.append(f"{dropped_text}: the values rest on {basis_text}. Look at the images that do not match and "
                         "at the place of the mesh: idic check.")
    return " ".join(sentences)


def in_error_bars(result: Mapping) -> str:
    """Whether the error bars count the error of the model, in a sentence."""
    is_smooth = (result.get("discrepancy") or {}).get("significant")  # None: not estimated
    if is_smooth:
        return "The error bars count it as a smooth error of motion, stress and channels."
    counts_mesh = is_smooth is False and has_model_part(result)
    return ("The error bars count the error of the mesh, but not that." if counts_mesh else
            "The error bars do not include that.")


def has_model_part(result: Mapping) -> bool:
    """Whether an error of the model, that of the mesh above all, is seen in a standard deviation."""
    return any((entry.get("std_model") or 0.0) > MIN_SHOWN_PART * (entry.get("std") or inf)
               for entry in result.get("parameters", {}).values())


def remedies(result: Mapping) -> str:
    """Effect of the tried remedies on χ² at the same motion, in a sentence; empty where none was tried."""
    tried = result.get("remedies") or ()
    if not tried:
        return ""
    best = min(tried, key=lambda remedy: remedy["chi2_after"])
    chi2_before, chi2_after = best["chi2_before"], best["chi2_after"]
    drop = chi2_before - chi2_after
    if drop > max(MIN_REMEDY_SHARE * max(chi2_before - 1.0, 0.0), MAX_CHI2_OVER_FREE):
        return (f"With {best['setting']} it falls from χ² = {chi2_text(chi2_before)} to {chi2_text(chi2_after)} at the "
                "same motion: identify again with it under [options].")
    names = "; ".join(remedy["setting"] for remedy in tried)
    return f"None of the remedies tried at the same motion removes it ({names}): look at the light and at the pattern."


def chi2_text(chi2: float) -> str:
    """A χ² to hundredths, or to the digits that it needs: ``1.00``, ``23.4``, ``0.012``."""
    return f"{chi2:.2f}" if 0.1 <= chi2 < 10.0 else digits_text(chi2, 3 if chi2 > 1.0 else 2, zeros=True)


def _numbers(result: Mapping, chi2: float) -> str:
    rms, unit = result["residual"].get("image_rms_gv"), result.get("noise", {}).get("unit") or "grey values"
    text = f"χ² = {chi2_text(chi2)} per pixel" + ("" if rms is None else f", rms {digits_text(rms, zeros=True)} {unit}")
    free_fit = against_free(result)
    if free_fit is None:
        return text
    outcome = "failed" if free_fit.failed else f"has χ² = {chi2_text(free_fit.free_chi2)}"
    frames = "" if "free_dic_chi2_dof" in result["residual"] else " in the frames shown"
    return f"{text}; a free FE-DIC on the same mesh {outcome}{frames}"


def _share(free_fit: AgainstFree) -> str:
    drop = free_fit.model_chi2 - free_fit.free_chi2
    share = drop / max(free_fit.model_chi2 - 1.0, drop)
    return f"{100.0 * min(share, 1.0):.0f} %"
