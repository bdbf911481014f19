"""Installed by pip (without ROS, or with the extra [ros]) and by colcon as an ament_python package."""

import xml.etree.ElementTree as ElementTree
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "fisheye_ep_calib"
VERSION = ElementTree.parse(Path(__file__).resolve().with_name("package.xml")).findtext("version")

# calib-targets has wheels for these machines only; elsewhere OpenCV's whole-board detector finds chessboards.
HAS_CALIB_TARGETS = (
    "(platform_system == 'Linux' and platform_machine == 'x86_64')"
    " or (platform_system == 'Darwin' and platform_machine == 'arm64')"
    " or (platform_system == 'Windows' and platform_machine == 'AMD64')"
)

ROS = [
    "ros-jazzy-rclpy",
    "ros-jazzy-common-interfaces",
    "ros-jazzy-rmw-fastrtps-cpp",
]
CLUSTER = ["distributed>=2023.5"]
VIDEO = ["av>=12"]
WEB = ["aiohttp>=3.9"]
COMPLETION = ["argcomplete>=3.0"]
DOCS = ["sphinx>=7.2", "furo>=2024.1.29", "myst-parser>=3"]
TEST = [
    *CLUSTER,
    *COMPLETION,
    *VIDEO,
    *WEB,
    "pytest>=8",
    "pytest-timeout>=2.3",
    "pytest-xdist>=3.5",
    "hypothesis>=6.100",
    "jsonschema>=4.17",
    "ruff>=0.6",
    "mypy>=1.10",
    "types-PyYAML",
    "colcon-common-extensions>=0.3",
]

setup(
    name=NAME,
    version=VERSION,
    description="Fisheye camera calibration with the entrance pupil, from bags or live ROS 2 images",
    license="Apache-2.0",
    maintainer="fisheye_ep_calib maintainers",
    maintainer_email="maintainers@users.noreply.h-seed-848c94e0.example",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "report/templates/*", "web/static/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", glob("config/*.yaml") + glob("config/*.xml")),
        (f"share/{NAME}/config/targets", glob("config/targets/*.yaml")),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
    ],
    install_requires=[
        "numpy>=1.26",
        "scipy>=1.11",
        "opencv-python-headless>=4.6",
        "pyyaml>=6.0",
        "mcap>=1.1",
        "rosbags>=0.10.9",
        "tqdm>=4.60",
        "matplotlib>=3.6",
        "jinja2>=3.0",
        f"calib-targets>=0.15,<0.16; {HAS_CALIB_TARGETS}",
    ],
    extras_require={
        "cluster": CLUSTER,
        "completion": COMPLETION,
        "docs": DOCS,
        "ros": ROS,
        "test": TEST,
        "video": VIDEO,
        "web": WEB,
    },
    entry_points={
        "console_scripts": [
            "fisheye_ep_calib = fisheye_ep_calib.cli:main",
            "calibrate_bag = fisheye_ep_calib.cli:calibrate_bag_main",
            "calibrator = fisheye_ep_calib.ros.calibrator:main",
            "rectifier = fisheye_ep_calib.ros.rectifier:main",
        ],
    },
    zip_safe=True,
)
