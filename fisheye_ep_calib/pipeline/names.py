"""What cameras and their files are called."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.recording import Recording, choose_topics, recorded_topic

_NAME = re.compile(r"[^\W_][\w.-]*")
_LONGEST = 200  # bytes: file systems take 255, and endings are to come
Topics = Mapping[str, str] | Sequence[str] | str | None


def named_topics(recording: Recording, topics: Topics = None, camera: str = "") -> dict[str, str]:
    """Camera name → topic: those given, the only image topic, or every folder of images. Raises InputError.

    camera: of several topics the one that a camera of this name would have. A name given for a topic does too.
    """
    topics_there = [topic.name for topic in recording.image_topics()]

    def of_camera(name: str) -> str | None:
        alike = [topic for topic in topics_there if camera_name(topic) == name]
        return alike[0] if len(alike) == 1 else None

    named = checked_topics(topics)
    named = {name: recorded_topic(recording, topic) for name, topic in named.items()}
    named = {name: topic if topic in topics_there else of_camera(topic) or topic for name, topic in named.items()}
    if not named and camera and (topic := of_camera(camera)):
        return {camera: topic}
    chosen = choose_topics(recording, tuple(named.values()), several=True)
    return named or dict(zip(numbered_alike(map(camera_name, chosen)), chosen, strict=True))


def checked_topics(topics: Topics = None) -> dict[str, str]:
    """Camera name → topic. topics: by name, or topics that give the cameras their names. Raises InputError."""
    given = [topics] if isinstance(topics, str) else [] if topics is None else topics
    pairs = given.items() if isinstance(given, Mapping) else [(camera_name(topic), topic) for topic in given]
    named: dict[str, str] = {}
    for name, topic in pairs:
        if not _NAME.fullmatch(name):
            raise InputError(f"`topics` {name}={topic}: a camera's name is made of letters, digits and _ . -")
        if name in named:
            raise InputError(f"`topics` {name}={topic}: there are two cameras called {name}")
        named[name] = topic
    return named


def camera_name(topic: str) -> str:
    """A camera's name from its image topic: /front/image_raw is front."""
    parts = [part for part in topic.split("/") if part]
    while len(parts) > 1 and parts[-1] in ("image_raw", "image", "image_mono", "image_color", "compressed"):
        parts.pop()
    return safe_name("_".join(parts))


def safe_name(text: str) -> str:
    """A name that is safe as a file's: letters and digits of any script, _ . and -; at most 200 bytes in UTF-8."""
    name = re.sub(r"[^\w.-]+", "_", unicodedata.normalize("NFC", text)).strip("._-")
    return name.encode()[:_LONGEST].decode(errors="ignore") or "camera"


def image_stem(name: str) -> str:
    """An image's name, safe as a file's: without what tells its format, with the whole of a time 12.000000001."""
    return safe_name(name if re.fullmatch(r"\d+\.\d+", name) else Path(name).stem)


def numbered_alike(names: Iterable[str]) -> list[str]:
    """The names, the later ones of those that differ in nothing but case numbered: a, A_2."""
    result: list[str] = []
    taken: set[str] = set()
    for stem in names:
        name, number = stem, 1
        while name.casefold() in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name.casefold())
        result.append(name)
    return result
