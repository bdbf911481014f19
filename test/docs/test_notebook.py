"""docs/notebooks/tour.ipynb runs from its first cell to its last, and what it shows is true."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import matplotlib

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "notebooks" / "tour.ipynb"


def run_cell(source: str, names: dict, shown: list[str]) -> None:
    """As a kernel does it: the last expression of a cell is shown, by its HTML where it has one."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) and not source.rstrip().endswith(";") else None
    exec(compile(tree, str(NOTEBOOK), "exec"), names)
    if last is not None:
        value = eval(compile(ast.Expression(last.value), str(NOTEBOOK), "eval"), names)
        if value is not None:
            shown.append(value._repr_html_() if hasattr(value, "_repr_html_") else repr(value))


def test_the_tour_goes_from_images_to_a_judged_camera(capsys):
    matplotlib.use("agg")
    book = json.loads(NOTEBOOK.read_text("utf-8"))
    assert book["nbformat"] == 4
    names: dict = {"__name__": "tour"}
    shown: list[str] = []
    for cell in book["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [] and cell["execution_count"] is None, "outputs are not kept in the repository"
            run_cell("".join(cell["source"]), names, shown)
    told = capsys.readouterr().out
    result, judged = names["result"], names["judged"]
    truth = names["truth"]
    for degrees in (30, 60):
        theta = degrees * 3.141592653589793 / 180
        assert abs(result.camera.entrance_pupil(theta) - truth.entrance_pupil(theta)) < 0.1e-3
    assert "looking for the target: 16 of 16 images" in told and f"E({60}°) = " in told
    assert judged.rms_px < 0.5 * names["fec"].evaluate(names["central"], names["others"]).rms_px
    assert result.verdict.headline in shown[0] and "px RMS" in shown[1]
    assert (names["place"] / "report.html").stat().st_size > 100_000 and names["written"].exists()
    assert names["rectified"].shape == (300, 400) and names["rectified"].std() > 5
    names["plt"].close("all")
