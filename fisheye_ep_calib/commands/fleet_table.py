"""All devices of a fleet in one table, and which of them are unlike the others."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.pipeline.writing import RECORD
from fisheye_ep_calib.plain_text import one_line
from fisheye_ep_calib.storage.camera_content import camera_content
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.json_text import read_json

ANGLES = (30, 60, 80)
FEWEST = 4  # devices, before any of them can be called odd
ODD = 3.5  # robust standard deviations, in a large fleet
RMS_SPREAD = 0.05  # of the logarithm: noise differs by that much between recordings

# Quantity → the columns of its value and its standard deviation. k1..k4 trade with one another: r(θ) is compared.
COMPARED = {
    **{name: (name, f"{name}_sigma") for name in ("fx", "fy", "cx", "cy")},
    **{f"r({angle}°)": (f"r{angle}_px", f"r{angle}_sigma_px") for angle in ANGLES},
    **{f"E({angle}°)": (f"E{angle}_mm", f"E{angle}_sigma_mm") for angle in ANGLES},
}
FIRST_COLUMNS = ("device", "camera", "status", "odd", "reason")
Row = dict[str, Any]


def device_rows(device: str, folder: Path) -> list[Row]:
    """A row a camera of a finished device. Raises InputError where its results cannot be read."""
    record = folder / RECORD
    try:
        content = read_json(record)
        rows = [_row(device, name, figures, folder) for name, figures in content["cameras"].items()]
        failed = {name: str(reason) for name, reason in content.get("failed", {}).items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"{one_line(record)} is not what a calibration writes: delete it to calibrate anew") from None
    return rows + [failed_row(device, failed[name], name) for name in failed if name not in content["cameras"]]


def is_finished(folder: Path) -> bool:
    """Whether a device has results, and none of its cameras failed. What cannot be read is for a person to see."""
    if not (folder / RECORD).exists():
        return False
    try:
        content = read_json(folder / RECORD)
    except InputError:
        return True
    return not (isinstance(content, dict) and content.get("failed"))


def failed_row(device: str, reason: str, camera: str = "") -> Row:
    return {"device": device, "camera": camera, "status": "failed", "odd": "", "reason": reason}


def _row(device: str, name: str, content: Mapping[str, Any], folder: Path) -> Row:
    row: Row = {
        "device": device,
        "camera": name,
        "status": "done" if content["converged"] else "not converged",
        "odd": "",
        "reason": "",
        **{key: content[key] for key in ("model", "views", "points", "rejected_points", "rms_px", "noise_px")},
        "supported": content["entrance_pupil_supported"],
        "source": content["inputs"]["source"],
        "yaml": content["yaml"] or "",
    }
    if not content["yaml"]:
        return row
    try:
        camera = camera_content(read_camera_file(folder / Path(content["yaml"]).name))
    except CalibrationError as error:
        return row | {"status": "failed", "reason": str(error)}
    sigma = camera["sigma"]
    for key in ("fx", "fy", "cx", "cy", "skew"):
        row |= {key: camera[key], f"{key}_sigma": sigma.get(key, 0.0)}
    for number, value in enumerate(camera["radial"], start=1):
        row |= {f"k{number}": value, f"k{number}_sigma": sigma.get(f"k{number}", 0.0)}
    for angle in ANGLES:
        if angle < len(camera["theta_deg"]):  # beyond, nothing was seen
            row |= {f"E{angle}_mm": 1e3 * camera["E_m"][angle], f"E{angle}_sigma_mm": 1e3 * camera["E_sigma_m"][angle]}
            row |= {f"r{angle}_px": camera["r_px"][angle], f"r{angle}_sigma_px": camera["r_sigma_px"][angle]}
    return row | {"theta_max_deg": camera["theta_max_deg"]}


def mark_odd(rows: Sequence[Row]) -> None:
    """Say in the column ``odd`` in what a camera differs from the same camera of the other devices, worst first.

    Robust z = (value − median) / √(s² + σ²): s = 1.4826 median|value − median| over the fleet, σ the camera's own
    standard deviation. Odd is |z| beyond ``threshold``. The RMS counts by its logarithm, and only where it is high.
    """
    done = [row for row in rows if row["status"] == "done"]
    several = len({row["device"] for row in done}) < len(done)
    groups: dict[str, list[Row]] = {}
    for row in done:
        groups.setdefault(row["camera"] if several else "", []).append(row)
    for group in groups.values():
        remarks: dict[int, list[tuple[float, str]]] = {number: [] for number in range(len(group))}
        for quantity, (column, sigma) in COMPARED.items():
            members = [number for number, row in enumerate(group) if column in row and _has(row, quantity)]
            values = np.array([group[number][column] for number in members])
            z = robust_z(values, np.array([group[number][sigma] for number in members]))
            for number, score in zip(members, z, strict=True):
                if abs(score) > threshold(len(members)):
                    remarks[number].append((abs(score), f"{quantity} {score:+.1f}"))
        rms = np.maximum([row["rms_px"] for row in group], 1e-9)
        z = robust_z(np.log(rms), np.full(len(group), RMS_SPREAD))
        for number, score in enumerate(z):
            if score > threshold(len(group)):
                remarks[number].append((score, f"RMS {score:+.1f}"))
        most = 2 * sum(row["supported"] for row in group) > len(group)
        for number, row in enumerate(group):
            texts = [text for _, text in sorted(remarks[number], reverse=True)]
            if len(group) >= FEWEST and most and not row["supported"]:
                texts.append("pupil not supported")
            row["odd"] = "; ".join(texts)


def _has(row: Row, quantity: str) -> bool:
    return row["model"] != "kannala" or not quantity.startswith("E")


def robust_z(values: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """How far each of values (n,) with standard deviations sigma (n,) is from the others' middle, in deviations."""
    if len(values) == 0:
        return values
    away = values - np.median(values)
    spread = 1.4826 * np.median(np.abs(away))
    result: np.ndarray = away / np.maximum(np.sqrt(spread**2 + sigma**2), 1e-9 * max(1.0, float(np.abs(values).max())))
    return result


def threshold(devices: int) -> float:
    """|z| from which on one of so many devices is odd: as rare in Student's t with devices − 1 degrees of freedom as
    3.5 is in the normal distribution, for the spread of few devices is not well known; 10.5 for 5, 4.2 for 20."""
    from scipy.special import ndtr, stdtrit

    return -float(stdtrit(devices - 1, ndtr(-ODD))) if devices >= FEWEST else np.inf


_BEGIN_FORMULAS = tuple("=+-@" + "\uff1d\uff0b\uff0d\uff20")  # the last four: full-width ones


def as_csv(rows: Sequence[Row]) -> str:
    """Every column that some row has; empty where one has not. Texts are in quotes: some divide at semicolons."""
    names = dict.fromkeys(FIRST_COLUMNS) | dict.fromkeys(name for row in rows for name in row)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(names), restval="", lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC)
    writer.writeheader()
    writer.writerows({name: _as_text_cell(cell) for name, cell in row.items()} for row in rows)
    return text.getvalue()


def _as_text_cell(cell: Any) -> Any:
    """A name from outside must not become a formula where a spreadsheet opens the table; numbers stay numbers."""
    if not isinstance(cell, str):
        return cell
    line = one_line(cell)
    return f"'{line}" if line.lstrip().startswith(_BEGIN_FORMULAS) else line


def as_text(rows: Sequence[Row]) -> str:
    """The table for a person."""
    columns = ["fx", "fy", "cx", "cy", "E30_mm", "E60_mm", "E80_mm", "rms_px", "views"]
    layout = ["{:.2f}"] * 4 + ["{:+.3f}"] * 3 + ["{:.3f}", "{:d}"]
    table = [["device", "camera", *(name.removesuffix("_px") for name in columns), "supported", ""]]
    for row in rows:
        cells = [form.format(row[name]) if name in row else "" for name, form in zip(columns, layout, strict=True)]
        supported = "" if row.get("supported") is None else "yes" if row["supported"] else "no"
        remark = f"ODD: {row['odd']}" if row["odd"] else "" if row["status"] == "done" else row["status"]
        table.append([row["device"], row["camera"], *cells, supported, remark])
    widths = [max(len(line[i]) for line in table) for i in range(len(table[0]))]
    lines = []
    for line in table:
        left = [cell.ljust(width) for cell, width in zip(line[:2], widths[:2], strict=True)]
        right = [cell.rjust(width) for cell, width in zip(line[2:-1], widths[2:-1], strict=True)]
        lines.append("  ".join([*left, *right, line[-1]]).rstrip())
    return "\n".join(lines + [f"{row['device']}: {row['reason']}" for row in rows if row["reason"]])
