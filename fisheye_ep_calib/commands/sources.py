"""The arguments that say what to look at and how, for every command that takes a SOURCE."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from fisheye_ep_calib.collection.progress import OnProgress, ProgressBars
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.pipeline.camera_source import CameraSource
from fisheye_ep_calib.pipeline.found_so_far import Log
from fisheye_ep_calib.pipeline.looking import Look, LookAgain, camera_sources
from fisheye_ep_calib.pipeline.names import camera_name, checked_topics, safe_name

__all__ = ["camera_name", "safe_name"]  # of the pipeline; here for the commands that still look for them here


def add_source_arguments(parser: argparse.ArgumentParser, many: bool) -> None:
    """What ``cameras_given`` reads."""
    kinds = "a bag (rosbag2 folder, .mcap, .db3, ROS 1 .bag), a folder of images, or an observation file .npz"
    parser.add_argument("source", nargs="+" if many else 1, metavar="SOURCE", help=kinds)
    parser.add_argument("--split", help="of an observation file, only the images with this mark, such as train")
    add_looking_arguments(parser)


def add_looking_arguments(parser: argparse.ArgumentParser) -> None:
    """What to look for, and in which images."""
    parser.add_argument("--target", type=Path, metavar="TARGET.yaml", help="the target; an .npz needs none")
    parser.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="NAME=TOPIC",
        help="image topic of camera NAME; repeat for several cameras",
    )
    looking = parser.add_argument_group("which images to look at")
    looking.add_argument(
        "--max-views",
        type=int,
        metavar="N",
        help="choose at most N a camera (default: 150, fewer if none shows it), unless:",
    )
    which = looking.add_mutually_exclusive_group()
    which.add_argument("--every", type=int, metavar="N", help="every N-th image, whatever it shows")
    which.add_argument("--all", action="store_true", help="every image")
    add_worker_arguments(looking)


class TakesArguments(Protocol):
    """A parser, or a group of its arguments."""

    def add_argument(self, *names: str, **options: Any) -> Any: ...


def add_worker_arguments(looking: TakesArguments) -> None:
    """Who looks at the images, and how strictly."""
    looking.add_argument("--strict", action="store_true", help="refuse damaged recordings and images")
    looking.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    looking.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="look on the workers of this Dask cluster instead; they read the recording at the same path "
        "(pip install 'fisheye_ep_calib[cluster]')",
    )


def add_resume_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--resume", action="store_true", help="go on from what an interrupted or failed run to the same DIR has found"
    )


@contextmanager
def look_given(arguments: argparse.Namespace, log: Log | None = None) -> Iterator[Look]:
    """How to look, by the arguments; with bars of its progress. log: where to keep what is found meanwhile."""
    with ProgressBars() as bars:
        yield Look(
            topics_given(arguments.topic),
            max_views=arguments.max_views,
            every=1 if arguments.all else arguments.every,
            strict=arguments.strict,
            workers=arguments.workers,
            scheduler=arguments.scheduler,
            log=log,
            on_progress=bars,
        )


@contextmanager
def cameras_given(
    arguments: argparse.Namespace,
    log: Log | None = None,
    before_looking: Callable[[list[str]], None] = lambda names: None,
    camera: str = "",
) -> Iterator[tuple[list[CameraSource], LookAgain | None, OnProgress]]:
    """``camera_sources`` of the arguments, and the bars that tell what is done with them.

    camera: of several, the one of this name is looked at alone.
    """
    with look_given(arguments, log) as look:
        look = replace(look, camera=camera)
        given = camera_sources(
            arguments.source, arguments.target, look, split=arguments.split, before_looking=before_looking
        )
        with given as (cameras, look_again):
            yield cameras, look_again, look.on_progress


def topics_given(given: list[str]) -> dict[str, str]:
    """Camera name → topic, from NAME=TOPIC or TOPIC arguments. Raises InputError."""
    named: dict[str, str] = {}
    for text in given:
        name, equals, topic = text.rpartition("=")
        name = name if equals else camera_name(topic)
        try:
            checked_topics({name: topic})
        except InputError:
            raise InputError(f"--topic {text}: a camera's name is made of letters, digits and _ . -") from None
        if name in named:
            raise InputError(f"--topic {text}: there are two cameras called {name}")
        named[name] = topic
    return named
