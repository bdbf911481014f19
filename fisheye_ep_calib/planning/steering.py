"""From where a target is held to where it is wanted: which way to move, how to tip it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.planning.view_selection import ViewSignature

# Within these of what is wanted, it is reached.
PLACE, SIZE, TILT = 0.07, 0.35, 0.5  # as in view_selection.Novelty: of the image; powers of two; powers of two
_SIDES = {(1, 0): "right", (-1, 0): "left", (0, 1): "lower", (0, -1): "upper"}


@dataclass(frozen=True)
class Steering:
    """move (2,): of the image's width and height, right and down. nearer: 1 nearer, -1 farther, 0 as it is.

    tip: the side of the target, as the image shows it, to bring nearer to the camera; empty where it is tilted well.
    """

    move: tuple[float, float]
    nearer: int
    tip: str

    @property
    def reached(self) -> bool:
        return self.move == (0.0, 0.0) and self.nearer == 0 and not self.tip

    @property
    def sentence(self) -> str:
        """A few words for the person who holds the target."""
        x, y = self.move
        along = ("right" if x > 0 else "left") if abs(x) > PLACE / 2 else ""
        down = ("down" if y > 0 else "up") if abs(y) > PLACE / 2 else ""
        words = [" and ".join(filter(None, (down, along)))] if along or down else []
        words += [{1: "nearer", -1: "farther"}[self.nearer]] if self.nearer else []
        words += [f"{self.tip} side nearer"] if self.tip and not words else []
        return ", ".join(words) or "hold it there"


def steer(now: ViewSignature, wanted: ViewSignature) -> Steering:
    """What separates two views; each part is zero once it is within what counts as reached."""
    move = wanted.position - now.position
    size = wanted.size - now.size
    tilt = wanted.tilt - now.tilt
    place = (0.0, 0.0) if np.linalg.norm(move) < PLACE else (float(move[0]), float(move[1]))
    nearer = 0 if abs(size) < SIZE else int(np.sign(size))
    direction = tilt[2:]
    tip = ""
    if np.linalg.norm(direction) > TILT:
        axis = int(np.argmax(np.abs(direction)))
        sign = int(np.sign(direction[axis]))
        tip = _SIDES[(sign, 0) if axis == 0 else (0, sign)]
    return Steering(place, nearer, tip)
