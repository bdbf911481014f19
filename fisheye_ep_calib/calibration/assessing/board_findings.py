"""What a calibration says of the board that it was shown."""

from __future__ import annotations

from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.target.shape.measured import BoardShape

_ASPECT_SIGMAS, _LEAST_ASPECT = 4.0, 0.02  # σ and %: a smaller difference between a board's scales is not told


def board_bent(board: BoardShape) -> Finding:
    """That it is bent limits nothing where its shape was estimated, but a stiff board would need no estimate."""
    values = {"height_rms_mm": board.height_rms_mm, "height_mm": board.bow_mm, "scatter_mm": board.rough_rms_mm}
    if not board.bent:
        return Finding("board_bent", values, False, "the views say nothing of a bend in the board")
    return Finding(
        "board_bent",
        values,
        True,
        f"the board is bent by {board.bow_mm:.2f} mm from its lowest to its highest point; its shape has been "
        "estimated, but glue it to glass or an aluminium plate to be sure that it keeps it",
    )


def board_scale(board: BoardShape) -> Finding:
    """Printers feed paper faster or slower than they should: x against y; the size of the whole cannot be seen."""
    aspect, sigma = board.aspect_percent, board.aspect_sigma_percent
    values = {"aspect_percent": aspect, "sigma_percent": sigma}
    if abs(aspect) < max(_ASPECT_SIGMAS * sigma, _LEAST_ASPECT):
        return Finding("board_scale", values, False, "the board is as long against its width as its file says")
    longer, shorter = ("x", "y") if aspect > 0 else ("y", "x")
    return Finding(
        "board_scale",
        values,
        True,
        f"against its file the paper is {abs(aspect):.2f} % longer in {longer} than in {shorter}; the calibration has "
        "allowed for that, but cannot see the size of the whole: measure the print and put its size into the target's "
        "file",
    )
