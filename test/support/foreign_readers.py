"""Exports read back as their programs read them: layouts and projections written down a second time.

Each reader takes the written files by path and gives cameras: what projects points in the camera's frame, metres, to
pixels whose (0, 0) is the centre of the top-left pixel, the image's size, and the camera from the first one.
"""

from __future__ import annotations

import ast
import json
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import yaml
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Read:
    project: Callable[[np.ndarray], np.ndarray]
    size: tuple[int, int]
    camera_from_reference: np.ndarray = field(default_factory=lambda: np.eye(4))
    topic: str | None = None


def kannala_brandt(fx, fy, cx, cy, radial, p=(0.0, 0.0)) -> Callable[[np.ndarray], np.ndarray]:
    """OpenCV's fisheye, any number of terms, decentering p[0], p[1] as Aria's p0, p1."""

    def project(points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        rho = np.hypot(x, y)
        theta = np.arctan2(rho, z)
        radius = theta + sum(k * theta ** (2 * i + 3) for i, k in enumerate(radial))
        a, b = radius * x / rho, radius * y / rho
        square, dot = a * a + b * b, 2 * (a * p[0] + b * p[1])
        a, b = a + dot * a + square * p[0], b + dot * b + square * p[1]
        return np.stack([fx * a + cx, fy * b + cy], axis=-1)

    return project


def double_sphere(fx, fy, cx, cy, xi, alpha) -> Callable[[np.ndarray], np.ndarray]:
    """Usenko, Demmel and Cremers (2018), equation 40."""

    def project(points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        d1 = np.sqrt(x * x + y * y + z * z)
        d2 = np.sqrt(x * x + y * y + (xi * d1 + z) ** 2)
        scale = alpha * d2 + (1 - alpha) * (xi * d1 + z)
        return np.stack([fx * x / scale + cx, fy * y / scale + cy], axis=-1)

    return project


def cahvore(fx, fy, cx, cy, alpha, beta, r0, r1, r2, e0, e1, e2, linearity=0.0) -> Callable[[np.ndarray], np.ndarray]:
    """mrcal's LENSMODEL_CAHVORE; CAHVOR with linearity 1 and no pupil. The angle by bisection, point by point."""
    axis = np.array([np.sin(alpha) * np.cos(beta), np.sin(beta), np.cos(alpha) * np.cos(beta)])

    def one(point: np.ndarray) -> np.ndarray:
        zeta = point @ axis
        across = point - zeta * axis
        length = np.linalg.norm(across)

        def equation(theta: float) -> float:
            shift = (theta - np.sin(theta)) * (e0 + e1 * theta**2 + e2 * theta**4)
            return float(zeta * np.sin(theta) - length * np.cos(theta) - shift)

        theta = brentq(equation, 0.0, np.arctan2(length, zeta) + 0.6, xtol=1e-15)
        bend = np.tan if linearity > 0 else np.sin
        chi = bend(linearity * theta) / linearity if linearity else theta
        turned = axis * length / chi + across * (1 + r0 + r1 * chi**2 + r2 * chi**4)
        return np.array([fx * turned[0] / turned[2] + cx, fy * turned[1] / turned[2] + cy])

    return lambda points: np.array([one(point) for point in points])


def read_kalibr(paths: list[Path]) -> list[Read]:
    found: list[Read] = []
    for number, (name, camera) in enumerate(yaml.safe_load(paths[0].read_text()).items()):
        assert name == f"cam{number}" and camera["rostopic"] and isinstance(camera["cam_overlaps"], list)
        values, pose = camera["intrinsics"], np.eye(4)
        if number:
            pose = np.array(camera["T_cn_cnm1"]) @ found[-1].camera_from_reference
        if camera["camera_model"] == "ds":
            assert camera["distortion_model"] == "none" and camera["distortion_coeffs"] == []
            project = double_sphere(*values[2:], *values[:2])
        else:
            assert (camera["camera_model"], camera["distortion_model"]) == ("pinhole", "equidistant")
            project = kannala_brandt(*values, camera["distortion_coeffs"])
        found.append(Read(project, tuple(camera["resolution"]), pose, camera["rostopic"]))
    return found


def read_openvins(paths: list[Path]) -> list[Read]:
    """By cv::FileStorage, as OpenVINS does."""
    storage, found = cv2.FileStorage(str(paths[0]), cv2.FILE_STORAGE_READ), []
    while not (camera := storage.getNode(f"cam{len(found)}")).empty():

        def row(node) -> list[float]:
            return [node.at(i).real() for i in range(node.size())]

        pose = np.array([row(camera.getNode("T_imu_cam").at(i)) for i in range(4)])
        assert camera.getNode("distortion_model").string() == "equidistant"
        assert camera.getNode("camera_model").string() == "pinhole"
        assert camera.getNode("timeshift_cam_imu").isReal()
        project = kannala_brandt(*row(camera.getNode("intrinsics")), row(camera.getNode("distortion_coeffs")))
        width, height = (int(value) for value in row(camera.getNode("resolution")))
        found.append(Read(project, (width, height), np.linalg.inv(pose), camera.getNode("rostopic").string()))
    return found


def read_basalt(paths: list[Path]) -> list[Read]:
    """What cereal asks for by name; quaternion (x, y, z, w)."""
    content = json.loads(paths[0].read_text())["value0"]
    lengths = {"calib_accel_bias": 9, "calib_gyro_bias": 12, "accel_noise_std": 3, "gyro_noise_std": 3}
    lengths |= {"accel_bias_std": 3, "gyro_bias_std": 3}
    assert all(len(content[name]) == length for name, length in lengths.items())
    assert {"imu_update_rate", "cam_time_offset_ns", "vignette"} <= set(content)
    found = []
    for pose, camera, size in zip(content["T_imu_cam"], content["intrinsics"], content["resolution"], strict=True):
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat([pose[name] for name in ("qx", "qy", "qz", "qw")]).as_matrix()
        matrix[:3, 3] = [pose[name] for name in ("px", "py", "pz")]
        values = camera["intrinsics"]
        grid = [values[name] for name in ("fx", "fy", "cx", "cy")]
        if camera["camera_type"] == "ds":
            project = double_sphere(*grid, values["xi"], values["alpha"])
        else:
            assert camera["camera_type"] == "kb4"
            project = kannala_brandt(*grid, [values[f"k{i}"] for i in range(1, 5)])
        found.append(Read(project, tuple(size), np.linalg.inv(matrix)))
    return found


def read_orbslam3(paths: list[Path]) -> list[Read]:
    """By cv::FileStorage, with the checks of Settings::readParameter: real numbers must be real."""
    storage = cv2.FileStorage(str(paths[0]), cv2.FILE_STORAGE_READ)
    assert storage.getNode("File.version").string() == "1.0"
    assert storage.getNode("Camera.type").string() == "KannalaBrandt8"
    whole = ("Camera.width", "Camera.height", "Camera.fps", "Camera.RGB", "ORBextractor.nFeatures")
    for name in (*whole, "ORBextractor.nLevels", "ORBextractor.iniThFAST", "ORBextractor.minThFAST"):
        assert storage.getNode(name).isInt(), name
    viewer = ("KeyFrameSize", "KeyFrameLineWidth", "GraphLineWidth", "PointSize", "CameraSize", "CameraLineWidth")
    for name in (*viewer, "ViewpointX", "ViewpointY", "ViewpointZ", "ViewpointF"):
        assert storage.getNode(f"Viewer.{name}").isReal(), name
    size = tuple(int(storage.getNode(name).real()) for name in whole[:2])
    found, pose = [], np.eye(4)
    for number in (1, 2):
        nodes = [storage.getNode(f"Camera{number}.{name}") for name in ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")]
        if nodes[0].empty():
            break
        assert all(node.isReal() for node in nodes)
        values = [node.real() for node in nodes]
        if number == 2:
            left_from_right = storage.getNode("Stereo.T_c1_c2").mat()
            assert left_from_right.dtype == np.float32 and storage.getNode("Stereo.ThDepth").isReal()
            pose = np.linalg.inv(left_from_right.astype(float))
            assert storage.getNode("Camera2.overlappingEnd").isInt()
        found.append(Read(kannala_brandt(*values[:4], values[4:]), size, pose))
    return found


def read_vins(paths: list[Path]) -> list[Read]:
    storage = cv2.FileStorage(str(paths[0]), cv2.FILE_STORAGE_READ)
    if storage.getNode("num_of_cam").empty():
        return [_camodocal(paths[0])]
    found = []
    for number in range(int(storage.getNode("num_of_cam").real())):
        file = paths[0].parent / storage.getNode(f"cam{number}_calib").string()
        assert file in paths
        pose = storage.getNode(f"body_T_cam{number}").mat()
        camera = _camodocal(file)
        topic = storage.getNode(f"image{number}_topic").string()
        found.append(Read(camera.project, camera.size, np.linalg.inv(pose), topic))
    return found


def _camodocal(path: Path) -> Read:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("model_type").string() == "KANNALA_BRANDT"
    node = storage.getNode("projection_parameters")
    values = {name: node.getNode(name).real() for name in ("mu", "mv", "u0", "v0", "k2", "k3", "k4", "k5")}
    size = tuple(int(storage.getNode(name).real()) for name in ("image_width", "image_height"))
    radial = [values[name] for name in ("k2", "k3", "k4", "k5")]
    return Read(kannala_brandt(values["mu"], values["mv"], values["u0"], values["v0"], radial), size)


def read_colmap(paths: list[Path]) -> list[Read]:
    """COLMAP's (0, 0) is the corner of the top-left pixel."""
    lines = [line.split() for line in paths[0].read_text().splitlines() if not line.startswith("#")]
    poses = [np.eye(4)] * len(lines)
    if len(lines) > 1:
        (rig,) = json.loads(paths[1].read_text())
        assert [camera.get("ref_sensor", False) for camera in rig["cameras"]] == [True] + [False] * (len(lines) - 1)
        for number, camera in enumerate(rig["cameras"][1:], start=1):
            w, x, y, z = camera["cam_from_rig_rotation"]
            poses[number] = np.eye(4)
            poses[number][:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
            poses[number][:3, 3] = camera["cam_from_rig_translation"]
        assert [camera["camera_params"] for camera in rig["cameras"]] == [list(map(float, one[4:])) for one in lines]
    found = []
    for number, (words, pose) in enumerate(zip(lines, poses, strict=True), start=1):
        assert int(words[0]) == number
        fx, fy, cx, cy, *rest = map(float, words[4:])
        if words[1] == "OPENCV_FISHEYE":
            project = kannala_brandt(fx, fy, cx - 0.5, cy - 0.5, rest)
        else:
            assert words[1] == "RAD_TAN_THIN_PRISM_FISHEYE" and len(rest) == 12 and not any(rest[8:])
            project = kannala_brandt(fx, fy, cx - 0.5, cy - 0.5, rest[:6], rest[6:8])
        found.append(Read(project, (int(words[2]), int(words[3])), pose))
    return found


def read_nerfstudio(paths: list[Path]) -> list[Read]:
    content = json.loads(paths[0].read_text())
    assert content["camera_model"] == "OPENCV_FISHEYE"
    found = []
    for frame in content["frames"] or [content]:
        grid = [frame["fl_x"], frame["fl_y"], frame["cx"] - 0.5, frame["cy"] - 0.5]
        pose = np.array(frame.get("transform_matrix", np.diag([1.0, -1, -1, 1])))  # world from OpenGL's camera
        pose = np.linalg.inv(pose @ np.diag([1.0, -1, -1, 1]))
        project = kannala_brandt(*grid, [frame[f"k{i}"] for i in range(1, 5)])
        found.append(Read(project, (frame["w"], frame["h"]), pose))
    return found


def read_opencv(paths: list[Path]) -> list[Read]:
    """Projected by cv2.fisheye itself, which is right in front of the camera."""
    storage = cv2.FileStorage(str(paths[0]), cv2.FILE_STORAGE_READ)
    assert storage.getNode("fisheye_model").real() == 1
    found = []
    for number in [""] if storage.getNode("K1").empty() else ["1", "2", "3"]:
        names = (f"K{number}", f"D{number}") if number else ("camera_matrix", "distortion_coefficients")
        matrix, distortion = (storage.getNode(name).mat() for name in names)
        if matrix is None:
            break
        pose = np.eye(4)
        if number > "1":
            pose[:3, :3] = storage.getNode(f"R1{number}").mat()
            pose[:3, 3:] = storage.getNode(f"T1{number}").mat()
        size = tuple(int(storage.getNode(f"{name}{number}").real()) for name in ("image_width", "image_height"))

        def project(points: np.ndarray, matrix=matrix, distortion=distortion) -> np.ndarray:
            return cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), matrix, distortion)[0][:, 0]

        found.append(Read(project, size, pose))
    return found


def read_mrcal(paths: list[Path]) -> list[Read]:
    found = []
    for path in paths:
        content = ast.literal_eval(path.read_text())
        assert content["lensmodel"] == "LENSMODEL_CAHVORE_linearity=0.00"
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(content["extrinsics"][:3]).as_matrix()
        pose[:3, 3] = content["extrinsics"][3:]
        found.append(Read(cahvore(*content["intrinsics"]), tuple(content["imagersize"]), pose))
    return found


def read_camera_info(paths: list[Path]) -> list[Read]:
    """The second camera's place from R and P: x_rectified,right = x_rectified,left + (Tx/f, 0, 0)."""
    infos = [yaml.safe_load(path.read_text()) for path in paths]
    found = []
    for info in infos:
        assert info["distortion_model"] == "equidistant"
        fx, skew, cx, _, fy, cy, *_ = info["camera_matrix"]["data"]
        assert skew == 0
        project = kannala_brandt(fx, fy, cx, cy, info["distortion_coefficients"]["data"])
        found.append(Read(project, (info["image_width"], info["image_height"])))
    if len(infos) == 1:
        assert infos[0]["rectification_matrix"]["data"] == np.eye(3).ravel().tolist()
        return found
    turns = [np.reshape(info["rectification_matrix"]["data"], (3, 3)) for info in infos]
    left, right = (np.reshape(info["projection_matrix"]["data"], (3, 4)) for info in infos)
    assert left[0, 3] == 0 > right[0, 3] and np.array_equal(left[:, :3], right[:, :3])
    pose = np.eye(4)
    pose[:3, :3] = turns[1].T @ turns[0]
    pose[:3, 3] = turns[1].T @ [right[0, 3] / right[0, 0], 0, 0]
    return [found[0], Read(found[1].project, found[1].size, pose)]


def read_static_transform(path: Path) -> dict[str, np.ndarray]:
    """Child frame → parent from child, of the arguments of static_transform_publisher."""
    found = {}
    for line in path.read_text().splitlines():
        if not line.startswith("ros2 run tf2_ros static_transform_publisher "):
            continue
        words = shlex.split(line.removesuffix(" &"))[4:]
        given = dict(zip([word.removeprefix("--") for word in words[::2]], words[1::2], strict=True))
        assert given["frame-id"] == "left_optical_frame"
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat([float(given[f"q{axis}"]) for axis in "xyzw"]).as_matrix()
        pose[:3, 3] = [float(given[axis]) for axis in "xyz"]
        found[given["child-frame-id"]] = pose
    return found


def read_urdf(path: Path) -> dict[str, np.ndarray]:
    """rpy as R_z(yaw) R_y(pitch) R_x(roll), written out."""
    robot, found = ElementTree.parse(path).getroot(), {}
    for joint in robot.iter("joint"):
        assert joint.get("type") == "fixed" and joint.find("parent").get("link") == "left_optical_frame"
        origin = joint.find("origin")
        (cr, cp, cy), (sr, sp, sy) = (f([float(word) for word in origin.get("rpy").split()]) for f in (np.cos, np.sin))
        pose = np.eye(4)
        pose[:3, :3] = (
            np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
            @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
            @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        )
        pose[:3, 3] = [float(word) for word in origin.get("xyz").split()]
        found[joint.find("child").get("link")] = pose
    assert {link.get("name") for link in robot.iter("link")} == {"left_optical_frame", *found}
    return found


PLACE_READERS = {"static_transform": read_static_transform, "urdf": read_urdf}
READERS = {
    "camera_info": read_camera_info,
    "kalibr": read_kalibr,
    "openvins": read_openvins,
    "basalt": read_basalt,
    "orbslam3": read_orbslam3,
    "vins": read_vins,
    "colmap": read_colmap,
    "nerfstudio": read_nerfstudio,
    "opencv": read_opencv,
    "mrcal": read_mrcal,
}
