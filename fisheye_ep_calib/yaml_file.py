"""Reading the YAML of somebody else: plain scalars in lists and mappings, every size bounded before anything is built.

The parser's events are counted as they come; an alias counts as what it stands for. Tags have no meaning here, so that
a file can make numbers, texts, true, false and null, and nothing else.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from os import PathLike
from typing import Any, TypeAlias

import yaml
from yaml import events

from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.outside import read_text_outside
from fisheye_ep_calib.plain_text import one_line, shown

MOST_BYTES = 1 << 20
_MOST_NODES = 150_000  # a camera file has some thousand numbers
_CHARACTERS_A_NODE = 64  # a text counts as a node for so many
_DEEPEST = 50
_LONGEST_KEY = 200
_MOST_DIGITS = 20  # 64 bits without a sign
_MOST_DIRECTIVES = 10
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_CORE = "tag:yaml.org,2002:"

_WORDS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys((one for word in ("yes", "true", "on") for one in (word, word.title(), word.upper())), True),
    **dict.fromkeys((one for word in ("no", "false", "off") for one in (word, word.title(), word.upper())), False),
    **{f"{sign}{word}": float(f"{sign}inf") for sign in ("", "+", "-") for word in (".inf", ".Inf", ".INF")},
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}
_FIRST_OF_NUMBER = frozenset("0123456789+-.")
_INTEGER = re.compile(r"[-+]?(?:0|[1-9][0-9_]*|0x[0-9a-fA-F_]+|0b[01_]+|0[0-7_]+)")
_REAL = re.compile(r"[-+]?(?:(?:[0-9][0-9_]*\.[0-9_]*|\.[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+)")
_DATE = re.compile(r"\d{4}-\d\d?-\d\d?(?:[Tt\s].*)?")

_Node: TypeAlias = Any


def read_yaml(path: str | PathLike[str], kind: str, tags: Container[str] = (), most: int = MOST_BYTES) -> Any:
    """What a YAML file says, as plain data. kind: what it should be, for the error. Raises InputError.

    tags: those that are passed over ("opencv-matrix"); any other is refused. most: bytes.
    """
    return parse_yaml(read_text_outside(path, most, kind), one_line(path), tags)


def parse_yaml(text: str, source: str, tags: Container[str] = ()) -> Any:
    """As ``read_yaml`` of a text; ``source`` leads the error messages."""
    if len(re.findall(r"^%", text, re.MULTILINE)) > _MOST_DIRECTIVES:
        raise InputError(f"{source} is not valid YAML: too many lines begin with %")
    reader = _Reader(source, tags)
    try:
        return reader.document(yaml.parse(text, Loader=_LOADER))
    except (yaml.YAMLError, RecursionError, UnicodeError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" (line {mark.line + 1})" if mark else ""
        problem = one_line(getattr(error, "problem", None) or first_line(error), _LONGEST_KEY)
        raise InputError(f"{source} is not valid YAML{where}: {problem}") from None


class _Reader:
    """Builds one document from its events."""

    def __init__(self, source: str, tags: Container[str]) -> None:
        self._source = source
        self._tags = tags
        self._size = 0
        self._anchors: dict[str, tuple[_Node, int]] = {}

    def document(self, parsed: Iterator[events.Event]) -> _Node:
        content, documents = None, 0
        for event in parsed:
            if isinstance(event, events.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise self._refused(event, "a second document begins here")
                content = self._node(next(parsed), parsed, 0)
        return content

    def _node(self, event: Any, parsed: Iterator[events.Event], depth: int) -> _Node:
        before = self._size
        self._count(event, 1)
        if isinstance(event, events.AliasEvent):
            if event.anchor not in self._anchors:
                raise self._refused(event, f"nothing whole is called *{one_line(event.anchor, _LONGEST_KEY)}")
            node, size = self._anchors[event.anchor]
            self._count(event, size)
            return node
        if depth > _DEEPEST:
            raise self._refused(event, f"more than {_DEEPEST} lists within lists")
        self._refuse_tag(event)
        if isinstance(event, events.ScalarEvent):
            node = self._scalar(event)
        elif isinstance(event, events.SequenceStartEvent):
            node = []
            while not isinstance(item := next(parsed), events.SequenceEndEvent):
                node.append(self._node(item, parsed, depth + 1))
        else:
            node = {}
            while not isinstance(item := next(parsed), events.MappingEndEvent):
                key = self._key(item, parsed)  # before its value is read: of an assignment, the right side comes first
                node[key] = self._node(next(parsed), parsed, depth + 1)
        if event.anchor is not None:
            self._anchors[event.anchor] = node, self._size - before
        return node

    def _key(self, event: events.Event, parsed: Iterator[events.Event]) -> str | int | float | bool | None:
        if not isinstance(event, events.ScalarEvent | events.AliasEvent):
            raise self._refused(event, "a key must be a word or a number")
        key = self._node(event, parsed, 0)
        if isinstance(key, list | dict) or (isinstance(key, str) and len(key) > _LONGEST_KEY):
            raise self._refused(event, "a key must be a word or a number")
        return key  # type: ignore[no-any-return]

    def _scalar(self, event: events.ScalarEvent) -> _Node:
        value = event.value
        self._count(event, len(value) // _CHARACTERS_A_NODE)
        if event.style:  # in quotes, or as a block
            return value
        if value in _WORDS:
            return _WORDS[value]
        if value[0] not in _FIRST_OF_NUMBER:
            return value
        if _INTEGER.fullmatch(value):
            return self._integer(event, value)
        if _REAL.fullmatch(value):
            return float(value.replace("_", ""))
        if _DATE.fullmatch(value):
            self._check_date(event, value)
        return value

    def _integer(self, event: events.ScalarEvent, value: str) -> int:
        digits = value.replace("_", "")
        if len(digits) > _MOST_DIGITS:
            raise self._refused(event, f"a whole number of {len(digits)} digits")
        bare = digits.lstrip("+-")
        octal = len(bare) > 1 and bare[0] == "0" and bare[1] not in "xb"
        return int(digits, 8) if octal else int(digits, 0)

    def _check_date(self, event: events.ScalarEvent, value: str) -> None:
        """Dates stay text; what only looks like one is a slip of the pen."""
        try:
            if yaml.SafeLoader.timestamp_regexp.match(value):
                node = yaml.ScalarNode(_CORE + "timestamp", value)
                yaml.constructor.SafeConstructor().construct_yaml_timestamp(node)
        except (ValueError, OverflowError):
            raise self._refused(event, f"{shown(value)} is no date; write it in quotes if it is text") from None

    def _refuse_tag(self, event: Any) -> None:
        tag = event.tag
        if tag not in (None, "!") and tag.removeprefix(_CORE) not in self._tags:
            raise self._refused(event, f"the tag {shown(tag.removeprefix(_CORE))} is not read")

    def _count(self, event: events.Event, nodes: int) -> None:
        self._size += nodes
        if self._size > _MOST_NODES:
            raise self._refused(event, f"more than {_MOST_NODES} values, aliases counted as what they stand for")

    def _refused(self, event: events.Event, problem: str) -> InputError:
        where = f" (line {event.start_mark.line + 1})" if event.start_mark else ""
        return InputError(f"{self._source} is not valid YAML{where}: {problem}")
