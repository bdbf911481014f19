"""The texts that cv::FileStorage writes, YAML and XML, as plain data: read without OpenCV, whose parser is not for
files of strangers."""

from __future__ import annotations

import math
import re
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from fisheye_ep_calib.errors import InputError, first_line

MOST_VALUES = 1 << 16  # of one matrix


class _Loader(yaml.SafeLoader):
    """Safe YAML with OpenCV's matrices."""


def _matrix(loader: yaml.SafeLoader, node: yaml.Node) -> np.ndarray:
    if not isinstance(node, yaml.MappingNode):
        raise InputError("an opencv-matrix is not a list of keys and values")
    return matrix_of(loader.construct_mapping(node, deep=True))


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def matrix_of(keys: dict[Any, Any]) -> np.ndarray:
    """The matrix (rows, cols) of the keys rows, cols and data. Raises InputError."""
    rows, columns, data = keys["rows"], keys["cols"], keys["data"]
    sizes_known = isinstance(rows, int) and isinstance(columns, int) and isinstance(data, list)
    if not sizes_known or not 0 <= rows * columns <= MOST_VALUES or len(data) != rows * columns:
        raise InputError("a matrix whose data do not fit its rows and cols")
    return np.array([float(value) for value in data]).reshape(rows, columns)


def plain_data(text: str) -> dict[str, Any]:
    """Keys and values of OpenCV's or anybody's YAML, matrices as arrays. Raises InputError."""
    text = re.sub(r"\A\s*%YAML[: ]1\.[0-9][^\n]*\n", "", text)
    text = text if re.match(r"\s*---", text) else f"---\n{text}"
    try:
        content = yaml.load(text, _Loader)  # a safe loader's kind
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError(f"not valid YAML: {first_line(error)}") from None
    if not isinstance(content, dict):
        raise InputError("not a list of keys and values")
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
        rows, columns = (int(element.findtext(key, "")) for key in ("rows", "cols"))
        data: list[Any] = (element.findtext("data") or "").split()
        return matrix_of({"rows": rows, "cols": columns, "data": data})
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
