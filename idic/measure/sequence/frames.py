"""The images of one camera as a sequence, with what the log and their files say of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
import numpy as np

from idic.measure.sequence.lateness import check_pairing, course_of, frame_offset, sentence
from idic.measure.sequence.order import OrderEvidence
from idic.measure.sequence.repeats import Steps, lost_frames, repeated_frames
from idic.measure.sequence.thumbnails import Thumbnail, apart, distances, thumbnail
from idic.model import Column, Experiment, Remedies
from idic.readers import FileStack

MAX_FRAMES = 300  # that are compared with each other; of a longer test some
MIN_READING_CHANGE = 1e-9  # of the largest reading: a column that never changes tells nothing


@dataclass(frozen=True, eq=False)
class FrameSequence:
    """The frames of one camera that are compared, in the order of the experiment.

    experiment : the view of the camera; frames : their numbers; thumbnails : one per frame
    """

    experiment: Experiment
    frames: tuple[int, ...]
    thumbnails: tuple[Thumbnail, ...]

    @classmethod
    def of(cls, experiment: Experiment, region: np.ndarray) -> FrameSequence:
        """Read the images, of a long test some; region : (ny, nx) bool, True on the specimen."""
        frames, to_thumbnail = _thinned(_counted(experiment)), cls.maker(region)
        return cls(experiment, frames, tuple(to_thumbnail(experiment.recording.stack.frame(k)) for k in frames))

    @classmethod
    def of_thumbnails(cls, experiment: Experiment, thumbnails: Sequence[Thumbnail]) -> FrameSequence:
        """The sequence of all frames that are not excluded; thumbnails : one of each."""
        return cls(experiment, _counted(experiment), tuple(thumbnails))

    @staticmethod
    def maker(region: np.ndarray) -> Callable[[np.ndarray], Thumbnail]:
        """What makes the thumbnail of an image; region : (ny, nx) bool, True on the specimen."""
        rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
        return partial(thumbnail, box=(int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1))

    @staticmethod
    def has_order_to_confirm(experiment: Experiment) -> bool:
        """Whether each image has a file of its own, and the user has not stated their order."""
        recording = experiment.recording
        stack = getattr(recording.stack, "stack", recording.stack)
        return (isinstance(stack, FileStack) and not recording.stated_order
                and len({entry.path for entry in stack.entries}) == stack.n_frames)

    @property
    def labels(self) -> list[str]:
        """File names of the frames."""
        return [self.experiment.recording.labels[k] for k in self.frames]

    @cached_property
    def steps(self) -> Steps:
        """How far each frame is from the one before, in the images and in the log."""
        if len(self.courses):
            logged = self.courses
        else:
            logged = self.experiment.model.times[None, list(self.frames)]
        return Steps.of(apart(self.thumbnails), apart(self.thumbnails, 2), logged)

    @cached_property
    def order(self) -> OrderEvidence | None:
        """What says in which order the images are; None where it is stated, or each image has no file of its own."""
        stack = self.experiment.recording.stack
        stack = getattr(stack, "stack", stack)
        if not self.has_order_to_confirm(self.experiment):
            return None
        places = _thinned(tuple(range(len(self.frames))))
        frames = [self.frames[i] for i in places]
        return OrderEvidence(distances([self.thumbnails[i] for i in places]), self.courses[:, list(places)],
                             [stack.entries[k].path for k in frames], stack.orders(frames))

    @cached_property
    def courses(self) -> np.ndarray:
        """The logged columns that change, over their range  # (n_columns, n)"""
        model = self.experiment.model
        columns = [channel.values for channel in model.channels]
        drives = (*(entry.drive for entry in model.prescribed), *(load.drive for load in model.loads))
        columns += [drive.values for drive in drives if isinstance(drive, Column)]
        values = [np.asarray(column, float)[list(self.frames)] for column in columns]
        moving = [v for v in values if np.ptp(v) > MIN_READING_CHANGE * np.abs(v).max(initial=1e-300)]
        return np.array([(v - v.min()) / np.ptp(v) for v in moving]).reshape(len(moving), len(self.frames))

    def check_order(self) -> None:
        """InputError where the motion in the images contradicts the order of their names."""
        if self.order is not None:
            self.order.check()

    def order_warnings(self) -> list[str]:
        """Where times of the files propose another order than the names."""
        return [] if self.order is None else self.order.warnings()

    def repeated(self, equal: Sequence[int] = ()) -> list[str]:
        """Frames that repeat the one before although the log moves on; equal : numbers of those that are equal to the
        last grey value."""
        of_equal = {self.frames.index(k) for k in equal if k in self.frames}
        return repeated_frames(self.steps, self.labels, of_equal, len(self.courses) > 0,
                               lambda places: Remedies(self.experiment).exclusion([self.frames[i] for i in places]))

    def lost(self) -> list[str]:
        """Places where images are missing by the step of the motion."""
        recording, model = self.experiment.recording, self.experiment.model
        if not model.has_times or not (recording.is_log_interpolated or not len(self.courses)):
            return []
        remedy = Remedies(self.experiment).possible(
            "give the time of every image with image_times",
            otherwise="give the time of every image with image_times, in the place of the present times")
        return lost_frames(self.steps, self.labels, len(self.courses) > 0, remedy)


    @cached_property
    def course(self) -> np.ndarray:
        """The motion since the reference along its main direction  # (n,) px"""
        reference = self.experiment.model.reference
        return course_of(self.thumbnails, self.frames.index(reference) if reference in self.frames else 0)

    def late_against(self, main: FrameSequence) -> list[str]:
        """Whether this camera takes its images at other times than the main one, with the line that says so.

        Raises
        ------
        InputError
            So much later or earlier that images of the same number do not belong together.
        """
        counted = _counted(self.experiment)
        places = np.searchsorted(counted, self.frames)  # of a long test some frames are read
        offset = frame_offset(main.course, self.course, places) if self.frames == main.frames else None
        if offset is None:
            return []
        recordings = main.experiment.recording, self.experiment.recording
        names = recordings[0].camera_name, recordings[1].camera_name
        if self.experiment.time_offset not in self.experiment.model.parameters:
            first, second = ([recording.labels[k] for k in counted] for recording in recordings)
            check_pairing(names, (first, second), *offset)
        model = self.experiment.model
        interval_s = float(np.median(np.diff(model.times[list(counted)]))) if model.has_times else None
        return [sentence(names, *offset, interval_s)]


def _counted(experiment: Experiment) -> tuple[int, ...]:
    """The numbers of the frames that are not excluded."""
    return tuple(k for k in range(experiment.model.n_frames) if k not in experiment.recording.excluded)


def _thinned(frames: tuple[int, ...]) -> tuple[int, ...]:
    places = np.linspace(0, len(frames) - 1, min(len(frames), MAX_FRAMES)).astype(int)
    return tuple(frames[i] for i in np.unique(places))
