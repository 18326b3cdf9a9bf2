"""Calibration files of five systems, written here by hand, are one and the same rig; what a file leaves open is
asked."""

import io
import json
import os
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from idic.errors import InputError
from idic.images import PinholeCamera, rotation_of
from idic.readers import CameraRig, Conventions, read_calibration, write_rig

SHARED = Path(os.environ.get("IDIC_SHARED_DATA", "../shared/data")) / "stereo"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="the shared stereo data are not here")

RELATIVE = Rotation.from_euler("xyz", [0.9, -18.03, -1.7], degrees=True).as_matrix()
SHIFT = np.array([130.754854, -0.610487, 17.132902])
TRUTH = (PinholeCamera(2468.5286, 2470.2530, 638.9130, 407.2947, skew=-0.1712, k1=0.0638, k2=-0.21, k3=0.4),
         PinholeCamera(2377.1077, 2376.9158, 628.6070, 394.5706, skew=0.2898, k1=0.0620, k2=0.13, k3=-0.3,
                       rotation=RELATIVE, translation_mm=SHIFT))
WORLD = Rotation.from_euler("xyz", [179.96, 9.015, 3.2], degrees=True).as_matrix(), np.array([-63.2, -0.34, 318.7])
POINTS = np.random.default_rng(4).uniform([-60, -40, 380], [20, 40, 460], (60, 3))  # in the frame of camera 0
TOLERANCE_PX = 1e-9


def same(rig, points=POINTS, truth=TRUTH):
    rig = rig.in_frame_of(0)
    assert len(rig.cameras) == len(truth)
    for camera, true in zip(rig.cameras, truth, strict=True):
        assert np.abs(camera.project(points) - true.project(points)).max() < TOLERANCE_PX


def intrinsic(camera):
    return [camera.cx, camera.cy, camera.fx, camera.fy, camera.skew, camera.k1, camera.k2, camera.k3]


def angles(matrix, order="xyz"):
    """about x, y, z in degrees; order "zyx": x acts last"""
    found = Rotation.from_matrix(matrix).as_euler(order, degrees=True)
    return found if order == "xyz" else found[::-1]


def vic3d(truth=TRUTH):
    lines = []
    for number, camera in enumerate(truth):
        rotation = camera.rotation @ WORLD[0]
        shift = camera.rotation @ WORLD[1] + camera.translation_mm
        pose = " ".join(f"{v:.17g}" for v in (*angles(rotation), *shift))
        values = " ".join(f"{v:.17g}" for v in intrinsic(camera))
        lines.append(f'  <camera id="{number}">{values}<orientation>{pose}</orientation>\n  </camera>')
    body = "\n".join(lines)
    return ('<?xml version="1.0" encoding="ISO-8859-1"?>\n<!DOCTYPE vpml>\n<project dir="C:/Tests">\n'
            f' <calibration lri="calibration">\n{body}\n </calibration>\n</project>\n')


def matchid(truth=TRUTH, order="xyz"):
    lines = []
    for n, c in enumerate(truth):
        lines += [f"Cam{n}_Fx [pixels]; {c.fx!r}", f"Cam{n}_Fy [pixels]; {c.fy!r}", f"Cam{n}_Fs [pixels];{c.skew!r}"]
        lines += [f"Cam{n}_Kappa {i};{getattr(c, f'k{i}')!r}" for i in (1, 2, 3)]
        lines += [f"Cam{n}_P1;{c.p1!r}", f"Cam{n}_P2;{c.p2!r}", f"Cam{n}_Cx [pixels];{c.cx!r}",
                  f"Cam{n}_Cy [pixels];{c.cy!r}"]
    lines += [f"T{a} [mm];{v!r}" for a, v in zip("xyz", truth[1].translation_mm.tolist(), strict=True)]
    turned = angles(truth[1].rotation, order).tolist()
    lines += [f"{name} [deg];{v!r}" for name, v in zip(("Theta", "Phi", "Psi"), turned, strict=True)]
    return "\n".join(lines)


def pyvale(truth=TRUTH):
    lines = []
    for n, c in enumerate(truth):
        lines += [f"cam{n}_{name}_px,{v!r}" for name, v in
                  (("fx", c.fx), ("fy", c.fy), ("fs", c.skew), ("cx", c.cx), ("cy", c.cy))]
        lines += [f"cam{n}_{name},{getattr(c, name)!r}" for name in ("k1", "k2", "p1", "p2", "k3")]
    lines += [f"t{a}_mm,{v!r}" for a, v in zip("xyz", truth[1].translation_mm.tolist(), strict=True)]
    lines += [f"{name}_deg,{v!r}"
              for name, v in zip(("theta", "phi", "psi"), angles(truth[1].rotation).tolist(), strict=True)]
    return "\r\n".join(lines) + "\r\n"


def dice_xml(truth=TRUTH, relative=True, matrix=False, **extra):
    lines = ["<ParameterList>", '<Parameter name="xml_file_format" type="string" value="DICe_xml_camera_system_file"/>',
             '<Parameter name="system_type_3D" type="string" value="OPENCV"/>',
             f'<Parameter name="extrinsics_relative_camera_to_camera" type="bool" value="{str(relative).lower()}"/>']
    for n, c in enumerate(truth):
        rotation = c.rotation if relative else c.rotation @ WORLD[0]
        shift = c.translation_mm if relative else c.rotation @ WORLD[1] + c.translation_mm
        values = dict(zip(("CX", "CY", "FX", "FY", "FS", "K1", "K2", "K3"), intrinsic(c), strict=True))
        values |= {"P1": c.p1, "P2": c.p2} | dict(zip(("TX", "TY", "TZ"), shift, strict=True)) | extra
        if not matrix:
            values |= dict(zip(("ALPHA", "BETA", "GAMMA"), angles(rotation), strict=True))
        lines.append(f'<ParameterList name="CAMERA {n}">')
        lines += [f'<Parameter name="{name}" type="double" value="{float(v)!r}"/>' for name, v in values.items()]
        if matrix:
            lines.append('<ParameterList name="rotation_3x3_matrix">')
            lines += [f'<Parameter name="ROW {i}" type="string" value="{{ {", ".join(map(repr, row))} }}"/>'
                      for i, row in enumerate(rotation.tolist())]
            lines.append("</ParameterList>")
        lines += ['<Parameter name="LENS_DISTORTION_MODEL" type="string" value="OPENCV_LENS_DISTORTION"/>',
                  '<Parameter name="IMAGE_HEIGHT_WIDTH" type="string" value="{ 800, 1280 }"/>', "</ParameterList>"]
    return "\n".join([*lines, "</ParameterList>"])


def opencv_values(truth=TRUTH):
    values = {}
    for n, c in enumerate(truth, 1):
        values |= {f"K{n}": c.matrix, f"D{n}": np.array([[c.k1, c.k2, c.p1, c.p2, c.k3]])}
    return values | {"R": truth[1].rotation, "T": truth[1].translation_mm[:, None]}


def opencv_json(truth=TRUTH):
    return json.dumps({name: value.tolist() for name, value in opencv_values(truth).items()})


def opencv_yaml(path, truth=TRUTH):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in opencv_values(truth).items():
        storage.write(name, value)
    storage.release()


TEXTS = {"vic.xml": vic3d, "rig.caldat": matchid, "pyvale.txt": pyvale, "dice.xml": dice_xml, "cv.json": opencv_json,
         "dice_absolute.xml": lambda: dice_xml(relative=False), "dice_matrix.xml": lambda: dice_xml(matrix=True)}


@pytest.mark.parametrize("name", TEXTS)
def test_the_same_rig_is_one_camera_within_1e_9_px(tmp_path, name):
    (tmp_path / name).write_text(TEXTS[name]())
    same(read_calibration(tmp_path / name))


def test_vectors_that_opencv_writes_as_nd_matrices_are_read(tmp_path):
    storage = cv2.FileStorage(str(tmp_path / "cv.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in opencv_values(TRUTH).items():
        storage.write(name, np.ravel(value) if np.size(value) < 9 else np.asarray(value))
    storage.release()
    same(read_calibration(tmp_path / "cv.yml"))


@pytest.mark.parametrize("name", ["cv.yml", "cv.xml"])
def test_opencvs_own_storage_is_the_same_rig(tmp_path, name):
    opencv_yaml(tmp_path / name)
    same(read_calibration(tmp_path / name))


def test_npz_and_a_project_archive_are_the_same_rig(tmp_path):
    np.savez(tmp_path / "cv.npz", **opencv_values())
    same(read_calibration(tmp_path / "cv.npz"))
    with zipfile.ZipFile(tmp_path / "cal.z3d", "w") as archive:
        archive.writestr("thumbnail.png", b"no image")
        archive.writestr("project.xml", vic3d())
    same(read_calibration(tmp_path / "cal.z3d"))


def test_yaml_of_other_libraries_has_no_header_and_nested_matrices(tmp_path):
    c = TRUTH[0]
    (tmp_path / "ros.yaml").write_text(
        f"image_width: 1280\nimage_height: 800\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        f"  data: [{c.fx!r}, {c.skew!r}, {c.cx!r}, 0., {c.fy!r}, {c.cy!r}, 0., 0., 1.]\n"
        f"distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [{c.k1!r}, {c.k2!r}, 0., 0., {c.k3!r}]\n")
    rig = read_calibration(tmp_path / "ros.yaml")
    assert rig.image_size_px == ((1280, 800),)
    same(rig, truth=TRUTH[:1])


def test_tangential_distortion_keeps_its_order_in_every_format_that_has_it(tmp_path):
    truth = tuple(c.with_parameters({"p1": 1.1e-3, "p2": -2.3e-3}) for c in TRUTH)
    for name, text in (("a.caldat", matchid(truth)), ("b.txt", pyvale(truth)), ("c.xml", dice_xml(truth)),
                       ("d.json", opencv_json(truth))):
        (tmp_path / name).write_text(text)
        same(read_calibration(tmp_path / name), truth=truth)


def test_text_of_dice_with_angles_and_with_a_matrix(tmp_path):
    base = [*intrinsic(TRUTH[0]), *intrinsic(TRUTH[1])]
    for pose in (angles(RELATIVE), RELATIVE.ravel()):
        lines = [f"{v!r} # value" for v in map(float, (*base, *pose, *SHIFT))]
        (tmp_path / "cal.txt").write_text("\n".join([*lines, "800", "1280"]))
        rig = read_calibration(tmp_path / "cal.txt")
        assert rig.image_size_px == ((1280, 800),) * 2
        same(rig)


def test_skew_in_degrees_is_taken_as_such_where_the_name_or_the_user_says_so(tmp_path):
    degrees = [float(np.degrees(np.arctan(c.skew / c.fx))) for c in TRUTH]
    text = matchid()
    for n, c in enumerate(TRUTH):
        text = text.replace(f"Cam{n}_Fs [pixels];{c.skew!r}", f"Cam{n}_Fs [deg];{degrees[n]!r}")
    (tmp_path / "deg.caldat").write_text(text)
    same(read_calibration(tmp_path / "deg.caldat"))
    turned = tuple(PinholeCamera(c.fx, c.fy, c.cx, c.cy, skew=d, k1=c.k1, k2=c.k2, k3=c.k3, rotation=c.rotation,
                                 translation_mm=c.translation_mm) for c, d in zip(TRUTH, degrees, strict=True))
    (tmp_path / "deg.xml").write_text(vic3d(turned))
    same(read_calibration(tmp_path / "deg.xml", Conventions(skew="deg")))


def test_distortion_per_px_is_refused_until_its_unit_is_said(tmp_path):
    per_px = []
    for c in TRUTH:
        f = np.sqrt(c.fx * c.fy)
        per_px.append(PinholeCamera(c.fx, c.fy, c.cx, c.cy, skew=c.skew, k1=c.k1 / f**2, k2=c.k2 / f**4, k3=c.k3 / f**6,
                                    rotation=c.rotation, translation_mm=c.translation_mm))
    (tmp_path / "px.json").write_text(opencv_json(per_px))
    with pytest.raises(InputError, match='distortion = "px"'):
        read_calibration(tmp_path / "px.json")
    same(read_calibration(tmp_path / "px.json", Conventions(distortion="px")))


def test_the_order_of_the_angles_is_the_users_to_say(tmp_path):
    (tmp_path / "zyx.caldat").write_text(matchid(order="zyx"))
    same(read_calibration(tmp_path / "zyx.caldat", Conventions(angles="zyx")))
    wrong = read_calibration(tmp_path / "zyx.caldat").cameras[1]
    assert np.abs(wrong.project(POINTS) - TRUTH[1].project(POINTS)).max() > 1.0


@pytest.mark.parametrize("name, change, words", [
    ("rational.xml", lambda: dice_xml(K4=0.1), "K4"),
    ("mirrored.json", lambda: json.dumps({"camera_matrix": [[1000, 0, 5], [0, -1000, 5], [0, 0, 1]]}), "fy"),
    ("alone.json", lambda: json.dumps({n: v.tolist() for n, v in opencv_values().items() if n not in "RT"}), "pose"),
    ("huge.json", lambda: json.dumps({"K": [[900, 0, 640], [0, 900, 400], [0, 0, 1]], "dist": [250.0, 0, 0, 0, 0]}),
     "larger"),
    ("fisheye.json", lambda: json.dumps({"K": [[900, 0, 640], [0, 900, 400], [0, 0, 1]], "D": [0] * 7 + [0.2]}),
     "distortion"),
    ("oblique.json", lambda: json.dumps({"K": [[900, 90, 640], [0, 900, 400], [0, 0, 1]]}), "skew"),
    ("cut.caldat", lambda: "\n".join(matchid().splitlines()[:-1]), "psi"),
    ("rubbish.txt", lambda: "hello", "format"),
    ("empty.xml", lambda: "", "format"),
    ("broken.json", lambda: '{"K1": [[1,', "readable"),
    ("strange.json", lambda: json.dumps({"picture": 3}), "camera matrix"),
    ("numbers.txt", lambda: "1 2 3", "3 values"),
    ("noproject.xml", lambda: '<project><camera id="1">1 2 3<orientation>1</orientation></camera></project>',
     "camera 1"),
    ("words.caldat", lambda: matchid().replace("Cam0_P1;0.0", "Cam0_P1;none"), "P1"),
])
def test_what_is_no_calibration_of_a_pinhole_says_so(tmp_path, name, change, words):
    (tmp_path / name).write_text(change())
    with pytest.raises(InputError, match=words):
        read_calibration(tmp_path / name)


def test_damaged_archives_and_missing_files_say_so(tmp_path):
    buffer = io.BytesIO()
    np.savez(buffer, **opencv_values())
    (tmp_path / "cut.npz").write_bytes(buffer.getvalue()[:300])
    for name in ("cut.npz", "none.xml"):
        with pytest.raises(InputError, match=name):
            read_calibration(tmp_path / name)


@needs_shared
def test_a_real_rig_of_vic3d_is_the_same_in_the_relative_files_of_another_code():
    absolute = read_calibration(SHARED / "formats" / "cal_a.xml").in_frame_of(0)
    angular = read_calibration(SHARED / "formats" / "cal_a.txt")
    matrix = read_calibration(SHARED / "formats" / "cal_a_with_R.txt")
    points = np.random.default_rng(1).uniform([-130, -40, 300], [-20, 40, 400], (50, 3))
    for other in (angular, matrix):  # written with 4 to 6 digits: 18.03 degrees, 130.75 mm
        assert np.abs(other.cameras[0].project(points) - absolute.cameras[0].project(points)).max() < TOLERANCE_PX
        assert np.abs(other.cameras[1].project(points) - absolute.cameras[1].project(points)).max() < 0.1


@needs_shared
def test_every_real_calibration_file_is_read():
    names = [f"formats/{name}" for name in ("DICe_cal_a.xml", "cal_a.xml", "cal_b.xml", "cam_sys.xml")]
    rigs = [read_calibration(SHARED / name) for name in [*names, "stereo_auto/cal.xml"]]
    assert all(len(rig.cameras) == 2 for rig in rigs)
    assert rigs[3].image_size_px == ((2428, 1387), (8312, 2624))
    one, other = rigs[0].in_frame_of(0).cameras[1], rigs[1].in_frame_of(0).cameras[1]  # six digits of one calibration
    assert np.abs(one.translation_mm - other.translation_mm).max() < 1e-3
    single = read_calibration(SHARED / "calibration" / "left_cam_params.npz")
    assert 1100 < single.cameras[0].fx < 1300


def test_rotation_vectors_stand_for_matrices(tmp_path):
    values = opencv_values() | {"R": Rotation.from_matrix(RELATIVE).as_rotvec()}
    np.savez(tmp_path / "cv.npz", **values)
    same(read_calibration(tmp_path / "cv.npz"))
    assert np.abs(rotation_of(np.degrees(values["R"])) - RELATIVE).max() < 1e-14


def test_two_cameras_of_unlike_size_come_back_from_the_file_that_is_written(tmp_path):
    wide = PinholeCamera(fx=5000.0, fy=5000.0, cx=1200.0, cy=1000.0, rotation=np.eye(3), translation_mm=np.zeros(3))
    small = PinholeCamera(fx=3000.0, fy=3000.0, cx=640.0, cy=512.0, rotation=np.eye(3),
                          translation_mm=np.array([100.0, 0.0, 0.0]))
    for sizes in (((2448, 2048), (1280, 1024)), ((2448, 2048), (2448, 2048))):
        write_rig(tmp_path / "rig.json", CameraRig((wide, small), sizes), {})
        assert read_calibration(tmp_path / "rig.json").image_size_px == sizes
        assert ("image_size" in json.loads((tmp_path / "rig.json").read_text())) == (sizes[0] == sizes[1])
