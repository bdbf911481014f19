"""How long to go on where no image has shown the target yet: a refusal should not take longer than a look at the file.

The bound counts pixels, not seconds: the same images are looked at for any number of workers and on any machine.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Searching costs 0.05 to 0.2 s of processor time a megapixel where there is no target, 0.35 at worst (chessboards in
# noise), hence 3 to 20 s in all.
MOST_PIXELS = 60e6
FEWEST_IMAGES, FEWEST_OF_EACH = 6, 3  # looked at in any case, in all and of each camera


def worth_a_look(images: Sequence[int] | np.ndarray, pixels: Sequence[int], at_once: int = 1) -> list[int]:
    """Of images planned, those to look at although nothing was found in any so far; none: give up.

    pixels: of each image looked at so far, of all cameras, 0 where it could not be read. at_once: images that one of
    ``images`` stands for, one of each camera. Those given back are spread evenly.
    """
    if not pixels:
        return evenly_spread(images, max(FEWEST_OF_EACH, -(-FEWEST_IMAGES // at_once)))
    usual = sum(pixels) / len(pixels)
    if usual == 0:
        return evenly_spread(images, len(images))  # to learn that an image cannot be read costs next to nothing
    return evenly_spread(images, int((MOST_PIXELS - sum(pixels)) / usual / at_once))


def evenly_spread(images: Sequence[int] | np.ndarray, most: int) -> list[int]:
    """Up to ``most`` of the images: the middle ones of as many equal parts."""
    if len(images) <= most:
        return [int(image) for image in images]
    return [int(images[(2 * part + 1) * len(images) // (2 * most)]) for part in range(most)]
