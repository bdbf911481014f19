"""The texts that cv::FileStorage writes, YAML and XML, as plain data: read without OpenCV, whose parser is not for
files of strangers."""

from __future__ import annotations

import math
import re
from typing import Any
from xml.etree import ElementTree

import numpy as np

from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.file_values import matrix, needed
from fisheye_ep_calib.yaml_file import parse_yaml

MOST_VALUES = 1 << 16  # of one matrix


def matrix_of(keys: dict[Any, Any]) -> np.ndarray:
    """The matrix (rows, cols) of the keys rows, cols and data, as OpenCV writes one. Raises InputError."""
    rows, columns, data = (needed(keys, key) for key in ("rows", "cols", "data"))
    sizes_known = isinstance(rows, int) and isinstance(columns, int) and isinstance(data, list)
    if not sizes_known or not 0 <= rows * columns <= MOST_VALUES or len(data) != rows * columns:
        raise InputError("a matrix whose data do not fit its rows and cols")
    return matrix(data, "data", rows, columns)


def plain_data(text: str) -> dict[str, Any]:
    """Keys and values of OpenCV's or anybody's YAML. Raises InputError."""
    content = parse_yaml(re.sub(r"\A\s*%YAML[: ]1\.[0-9][^\n]*\n", "", text), "it", ("opencv-matrix",))
    if not isinstance(content, dict):
        raise InputError("it is not a list of keys and values")
    return content


def xml_data(text: str) -> dict[str, Any]:
    """Keys and values of OpenCV's XML, one level deep. Raises InputError."""
    if re.search(r"<!(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise InputError("XML with definitions of its own is not read")
    try:
        root = ElementTree.fromstring(text.encode())
    except (ElementTree.ParseError, RecursionError, ValueError) as error:
        raise InputError(f"not valid XML: {first_line(error)}") from None
    return {child.tag: _value(child) for child in root}


def _value(element: ElementTree.Element) -> Any:
    if element.get("type_id") == "opencv-matrix":
        rows, columns = (_number(element.findtext(key, "")) for key in ("rows", "cols"))
        data: list[Any] = (element.findtext("data") or "").split()
        return {"rows": rows, "cols": columns, "data": data}
    if len(element):
        return {child.tag: _value(child) for child in element}
    words = (element.text or "").split()
    values = [_number(word) for word in words]
    return values[0] if len(values) == 1 else values if values and not isinstance(values[0], str) else " ".join(words)


def _number(word: str) -> float | int | str:
    try:
        return int(word)
    except ValueError:
        pass
    try:
        value = float(word)
    except ValueError:
        return word
    return value if math.isfinite(value) else word
