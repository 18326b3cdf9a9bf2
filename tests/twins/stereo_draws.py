"""Repeats of a stereo test: one truth, and noise of images, force and grip and an error of the calibration per draw.

The truth is the simulation on the mesh and with the increments of the model, so that errors are those of noise and
calibration alone; images are by ray tracing. Every estimate is one step of Gauss and Newton from the truth: the
simulation and its derivatives are common to all draws.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic.correlation import (
    CorrelationContext, CorrelationSystem, FrameResponse, build_experiment_reference, camera_at, closed_system,
    frame_system, reduce_systems, with_all_cameras,
)
from idic.measure import surface_motion
from idic.experiment_file import load_experiment
from idic.identification import noise_weights, scaled_system
from idic.images import ArrayStack
from idic.model import Experiment, build_forward
from idic.parameters import JointPrior, ParameterSet
from idic.virtual_tests import PlateTest, Scene, Sensor, record

FOCAL_SHARE, ANGLE_DEG = 0.003, 0.1  # standard deviations of the calibration
MATERIAL = tuple(PlateTest.TRUTH)


@dataclass(frozen=True, eq=False)
class Repeats:
    """What all draws have in common.

    clean : per camera (n_frames, ny, nx) grey values without noise; responses : of the frames after the reference, at
    the truth; force : (n_frames,) N; prior : of the calibration, its mean the truth
    """

    test: PlateTest
    experiment: Experiment
    parameters: ParameterSet
    responses: tuple[FrameResponse, ...]
    clean: tuple[np.ndarray, ...]
    sensor: Sensor
    prior: JointPrior


@dataclass(frozen=True, eq=False)
class Draw:
    """One repeat.

    experiment : its images and force; grip_error : (n_frames,) mm of the log; mean : (n,) the calibration that the file
    states
    """

    experiment: Experiment
    grip_error: np.ndarray
    mean: np.ndarray


def build_repeats(folder: Path, test: PlateTest, write: Callable[..., Path] = PlateTest.write) -> Repeats:
    """Simulate and trace the test once.

    test : its mesh, rig and grip are used; write : makes the experiment folder of a test, with `deviations` of the
    calibration
    """
    fx = test.rig.cameras[0].fx
    stated = {f"{n}.{name}": FOCAL_SHARE * fx for n in (0, 1) for name in ("fx", "fy")} | {"1.rotation_y": ANGLE_DEG}
    at_rest = replace(test, displacements=0.0 * test.displacements)
    file = write(at_rest, folder, deviations=stated)
    text = file.read_text().replace('calibration = "calibration.json"',
                                    'calibration = "calibration.json"\nidentify_calibration = true')
    file.write_text(f"{text}\n[options]\nsubsteps = {PlateTest.INCREMENTS}\n")
    experiment = load_experiment(file)
    parameters = experiment.model.parameters.with_values(PlateTest.TRUTH)
    forward = build_forward(experiment)
    moving = tuple(name for name in parameters.free if forward.moves(name))
    logged = next(entry.drive.values for entry in experiment.model.prescribed if entry.nodes == "RIGHT"
                  and entry.component == "x")
    states = forward.march(parameters, moving, (test.grip - logged)[:, None], None, True)
    responses = tuple(FrameResponse.of(at, experiment.model.reference) for at in states)
    mesh = test.mesh
    test = replace(test, displacements=np.array([at.u for at in responses]),
                   force=np.array([at.channels[0] for at in responses]),
                   scene=Scene(mesh.nodes, *(mesh.face_cells(mesh.edge_sets[name]) for name in ("FRONT", "REST"))))
    texture = test.size.speckle(np.random.default_rng(0).spawn(1)[0])
    noise = experiment.recording.noise.std_gv
    sensor = Sensor(test.size.shape, background=0.1 * 256.0, noise_std=float(np.sqrt(noise**2 - 1.0 / 12.0)))
    clean = tuple(np.array([test.scene.image(u, camera, texture.value, sensor) for u in test.displacements])
                  for camera in test.rig.cameras)
    prior, = experiment.model.parameters.joint
    return Repeats(test, experiment, parameters, responses[1:], clean, sensor, prior)


def draw(repeats: Repeats, rng: np.random.Generator) -> Draw:
    """Noise of every image, force and grip, and what the calibration file says."""
    experiment, n = repeats.experiment, repeats.experiment.model.n_frames
    stacks = [ArrayStack([record(image, repeats.sensor, rng) for image in images]) for images in repeats.clean]
    channel, = experiment.model.channels
    force = repeats.test.force + PlateTest.FORCE_NOISE_N * rng.standard_normal(n)
    noisy = replace(experiment, recording=replace(experiment.recording, stack=stacks[0]),
                    model=replace(experiment.model, channels=(replace(channel, values=force),)),
                    cameras=(replace(experiment.cameras[0], stack=stacks[1]),))
    mean = rng.multivariate_normal(repeats.prior.mean, repeats.prior.covariance)
    return Draw(noisy, PlateTest.GRIP_NOISE_MM * rng.standard_normal(n), mean)


def scored(repeats: Repeats, number: int, compared: bool) -> dict:
    """One draw with all its estimates: ``scores``, errors over standard deviations; where it is compared, ``alone`` and
    ``steps``, errors with the calibration known and by two steps, and ``stated``, their deviations of two cameras and
    of one.

    number : of the draw, which decides its noise
    """
    one = draw(repeats, np.random.default_rng((1, number)))
    _, error, std = integrated(repeats, one)
    found = {"scores": error / std}
    if compared:
        found |= {"alone": of_material(repeats, one)[0], "steps": two_steps(repeats, one),
                  "stated": np.array([of_material(repeats, one, both)[1] for both in (True, False)])}
    return found


def without_noise(repeats: Repeats) -> Draw:
    """The recording with nothing of it: what is off then is the interpolation of the traced images."""
    experiment = repeats.experiment
    stacks = [ArrayStack(list(images)) for images in repeats.clean]
    channel, = experiment.model.channels
    quiet = replace(experiment, recording=replace(experiment.recording, stack=stacks[0]),
                    model=replace(experiment.model, channels=(replace(channel, values=repeats.test.force),)),
                    cameras=(replace(experiment.cameras[0], stack=stacks[1]),))
    return Draw(quiet, np.zeros(experiment.model.n_frames), np.array(repeats.prior.mean))


def integrated(repeats: Repeats, one: Draw) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names, errors and stated standard deviations of all free degrees of freedom, both scaled  # (n,), (n,)"""
    names = repeats.parameters.free
    system, gram = _summed(repeats, one, one.experiment, names)
    believed = ParameterSet(repeats.parameters.values(), (replace(repeats.prior, mean=one.mean),))
    return names, *_step(system, believed, gram, one.experiment)


def of_material(repeats: Repeats, one: Draw, both: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Errors and stated standard deviations of the material, scaled, where the calibration is known
    # (n_material,), (n_material,)

    both : from two cameras, or from the first alone
    """
    experiment = one.experiment if both else replace(one.experiment, cameras=())
    system, gram = _summed(repeats, one, experiment, MATERIAL)
    return _step(system, ParameterSet(repeats.parameters.values()), gram, experiment)


def _summed(repeats: Repeats, one: Draw, experiment: Experiment, names: tuple[str, ...]):
    """The equations of all frames at the truth, and the Gram matrix of the reference."""
    parameters, forward = repeats.parameters, build_forward(experiment)
    moving = tuple(name for name in names if forward.moves(name))
    camera = camera_at(experiment, parameters)
    context = with_all_cameras(CorrelationContext(
        experiment, parameters, names, moving, camera, build_experiment_reference(experiment, camera),
        noise_weights(experiment).as_generalised(), forward.drives.local_precision,
        local_scatter=forward.drives.local_scatter))
    systems = [frame_system(context, response, -one.grip_error[[response.frame]]) for response in repeats.responses]
    return closed_system(context, reduce_systems(systems))


def _step(system: CorrelationSystem, believed: ParameterSet, gram: np.ndarray, experiment: Experiment):
    """Errors of one step from the truth and their stated standard deviations, scaled  # (n,), (n,)"""
    scaled = scaled_system(system, believed, gram, noise_weights(experiment).image_noise)
    found = scaled.spectrum()
    return found.inverse @ scaled.b, np.sqrt(np.diagonal(scaled.covariance(found)))


def two_steps(repeats: Repeats, one: Draw) -> np.ndarray:
    """Errors of the material, scaled, by free stereo FE-DIC and then FEMU, every node alike; the calibration is known
    # (n_material,)"""
    measured = surface_motion(one.experiment)
    weight = 1.0 / np.sqrt(np.mean(measured.noise_mm**2))
    slopes = np.array([repeats.parameters[name].slope() for name in MATERIAL])
    m, frames = len(MATERIAL), len(repeats.responses)
    rows, rhs = [], []
    for t, response in enumerate(repeats.responses):
        at = measured.nodes
        grip = np.zeros((3 * len(at), frames))
        grip[:, t] = response.local_du[at].reshape(-1)
        rows.append(weight * np.hstack([response.du[at].reshape(-1, m) * slopes, grip]))
        rhs.append(weight * (measured.u_mm[response.frame] - response.u[at]).ravel())
        own = np.zeros((2, m + frames))
        own[0, :m], own[0, m + t] = response.dchannels[0] * slopes, response.local_dchannels[0, 0]
        own[0] /= PlateTest.FORCE_NOISE_N
        own[1, m + t] = 1.0 / PlateTest.GRIP_NOISE_MM  # the log says true + error, the simulation holds the true one
        rows.append(own)
        force = one.experiment.model.channels[0].values[response.frame]
        rhs.append(np.array([(force - response.channels[0]) / PlateTest.FORCE_NOISE_N,
                             one.grip_error[response.frame] / PlateTest.GRIP_NOISE_MM]))
    found, *_ = np.linalg.lstsq(np.vstack(rows), np.concatenate(rhs), rcond=None)
    return found[:m]
