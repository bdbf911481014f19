"""Which images of a recording to look at, before any is decoded: a few at first, then where the target moved.

Looking for the target costs far more than reading, and a recording at 10 to 30 Hz shows nearly the same view
again and again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.planning.image_information import most_informative
from fisheye_ep_calib.planning.view_selection import Novelty, ViewSignature, view_signature
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.detection import Detection

# Fixed, and not a matter of how many workers there are: the choice must not depend on the machine.
FRAMES_A_ROUND = 24
FIRST_LOOK = 1 / 3  # of the images that will be looked at
MOST_IMAGES = 150  # of a camera, where no number is asked for

# Worth of looking between two images, where 1 is a target that moved by the least that counts as new.
WORTH_AT_ENTRY = 2.0  # found in one of them: in between it crosses the edge of the field, where views are rare
WORTH_OF_NOTHING = 0.05  # found in neither


@dataclass(frozen=True)
class FrameChoice:
    """How to choose. max_views: look at this many images of a camera at most; None for the usual number, and for fewer
    where none of them shows the target.

    every: look at every n-th image instead, whatever it shows; 1 looks at all.
    """

    max_views: int | None = None
    every: int | None = None

    def __post_init__(self) -> None:
        if self.max_views is not None and self.max_views < 1:
            raise InputError(f"the number of views must be at least 1, not {self.max_views}")
        if self.every is not None and self.every < 1:
            raise InputError(f"every n-th image needs n of at least 1, not {self.every}")

    @property
    def most(self) -> int:
        """How many images of a camera to look at."""
        return MOST_IMAGES if self.max_views is None else self.max_views

    @property
    def gives_up(self) -> bool:
        """Whether to stop where nothing is found: nobody said how many images are to be looked at."""
        return self.max_views is None and self.every is None


def first_look(count: int, choice: FrameChoice) -> list[int]:
    """The images to look at first: all of them where they are few, else evenly spread from first to last."""
    if choice.every is not None:
        return list(range(0, count, choice.every))
    if count <= choice.most:
        return list(range(count))
    spread = max(2, round(FIRST_LOOK * choice.most))
    if choice.most == 1:
        return [count // 2]
    return sorted(set(np.round(np.linspace(0, count - 1, min(spread, choice.most))).astype(int).tolist()))


def room_left(looked_at: int, count: int, choice: FrameChoice) -> int:
    """How many images to look at in the next round."""
    if choice.every is not None:
        return 0
    return max(0, min(FRAMES_A_ROUND, choice.most - looked_at, count - looked_at))


def next_look(
    looked_at: Mapping[int, Detection | None],
    target: Target,
    image_size: tuple[int, int],
    count: int,
    choice: FrameChoice,
) -> list[int]:
    """The images to look at next: those that tell most about the camera, else those where the target moves.

    looked_at: image → what was found in it, or None; count: images there are. image_size: width, height, pixels.
    """
    room = room_left(len(looked_at), count, choice)
    if room == 0:
        return []
    detections = {image: detection for image, detection in looked_at.items() if detection is not None}
    chosen = most_informative(detections, sorted(looked_at), target, image_size, room)
    signatures = {
        image: view_signature(target.object_points[detection.point_index], detection.pixels, image_size)
        for image, detection in detections.items()
    }
    moved = closer_look({image: signatures.get(image) for image in looked_at}, room)
    return sorted(chosen + [image for image in moved if image not in chosen][: room - len(chosen)])


def closer_look(looked_at: Mapping[int, ViewSignature | None], room: int) -> list[int]:
    """Up to ``room`` images to look at next: the middles of the gaps that promise most.

    looked_at: image → how the target appeared in it, or None. Empty once nothing is to be gained.
    """
    looked = sorted(looked_at)
    gaps = [(a, b) for a, b in zip(looked, looked[1:], strict=False) if b - a > 1]
    worth = np.array([_worth(looked_at[a], looked_at[b]) for a, b in gaps])
    # Among gaps of equal worth the longest first; ties go to the earliest.
    lengths = np.array([b - a for a, b in gaps])
    order = np.lexsort((-lengths, -np.round(worth, 9)))
    promising = [gaps[i] for i in order if worth[i] >= 1 or worth[i] == WORTH_OF_NOTHING]
    return sorted((a + b) // 2 for a, b in promising[:room])


def _worth(first: ViewSignature | None, second: ViewSignature | None) -> float:
    """How much changed between two images, in multiples of the least that counts as new."""
    if first is None and second is None:
        return WORTH_OF_NOTHING
    if first is None or second is None:
        return WORTH_AT_ENTRY
    least = Novelty()
    return float(
        max(
            np.linalg.norm(first.position - second.position) / least.position,
            abs(first.size - second.size) / least.size,
            np.linalg.norm(first.tilt - second.tilt) / least.tilt,
        )
    )


def first_moments(count: int, most: int) -> np.ndarray:
    """Rows to begin with, of ``count``: all where they are not more than ``most``, or else half of ``most``, spread."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, max(2, most // 2)).round().astype(int))


def next_moments(looked: np.ndarray, shared: np.ndarray, most: int) -> np.ndarray:
    """Further rows, the nearest to shared ones first, until ``most`` have been looked at; none where none is shared.

    looked, shared (m,) bool: the rows looked at so far, and those of them in which two cameras saw the target.
    """
    left, good = np.flatnonzero(~looked), np.flatnonzero(shared)
    if not (len(left) and len(good)):
        return left[:0]
    distance = np.abs(np.subtract.outer(left, good)).min(axis=1)
    return left[np.argsort(distance, kind="stable")[: max(0, most - int(looked.sum()))]]
