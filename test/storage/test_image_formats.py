"""Files of images beyond one PNG each: pages, archives, and formats with headers that lie."""

from __future__ import annotations

import io
import pickle
import struct
import tarfile

import cv2
import numpy as np
import pytest
from bag_writers import images

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.image_header import declared_size
from fisheye_ep_calib.storage.recording import open_recording

PICTURES = images(4)


def encoded(picture, suffix: str, *options: int) -> bytes:
    return cv2.imencode(suffix, picture, options)[1].tobytes()


@pytest.mark.parametrize("suffix", [".pgm", ".ppm", ".pbm", ".webp", ".png", ".bmp", ".tif"])
def test_the_declared_size_is_that_of_the_image(suffix):
    picture = (
        np.repeat(PICTURES[0][:33, :57, None], 3, axis=2) if suffix in (".ppm", ".webp") else PICTURES[0][:33, :57]
    )
    assert declared_size(encoded(np.ascontiguousarray(picture), suffix)) == (57, 33)


@pytest.mark.parametrize("options", [(cv2.IMWRITE_WEBP_QUALITY, 101), (cv2.IMWRITE_WEBP_QUALITY, 80)])
@pytest.mark.parametrize("channels", [3, 4])
def test_every_kind_of_webp(tmp_path, options, channels):
    picture = np.repeat(PICTURES[0][..., None], channels, axis=2)
    (tmp_path / "a.webp").write_bytes(encoded(picture, ".webp", *options))
    with open_recording(tmp_path / "a.webp") as recording:
        found = recording.frame(tmp_path.name, 0).image()
    assert found.shape == PICTURES[0].shape and np.abs(found.astype(int) - PICTURES[0]).mean() < 8


def test_a_pgm_with_comments_and_one_of_text(tmp_path):
    rows = PICTURES[0][:4, :6]
    (tmp_path / "a.pgm").write_bytes(b"P5\n# a camera\n6 4\n# its range\n255\n" + rows.tobytes())
    (tmp_path / "b.pgm").write_text("P2 6 4 255\n" + " ".join(map(str, rows.ravel())) + "\n")
    with open_recording(tmp_path) as recording:
        for frame in recording.frames():
            np.testing.assert_array_equal(frame.image(), rows)


@pytest.mark.parametrize(
    "content, said",
    [
        (b"P5\n999999 999999\n255\n", "999999×999999"),
        (b"P5\n0 10\n255\n", "empty"),
        (b"P5 what", "neither PNG"),
        (b"RIFF\x10\0\0\0WEBPVP8X\x0a\0\0\0\0\0\0\0" + b"\xff" * 6, "16777216×16777216"),
        (b"RIFF\x10\0\0\0WEBPABCD" + b"\0" * 20, "no image"),
        (b"RIFF\x10\0\0\0WEBPVP8 ", "cut short"),
        (b"II*\0\xff\xff\xff\xff", "cut short"),
        (b"II*\0\0\0\0\0", "no page"),
        (b"II*\0\x08\0\0\0\xff\xff", "cut short"),
    ],
)
def test_headers_that_lie_cost_nothing(content, said):
    with pytest.raises(InputError, match=said):
        declared_size(content)


def write_stack(path, pictures):
    assert cv2.imwritemulti(str(path), pictures)
    return path


def test_every_page_of_a_tiff_is_an_image(tmp_path):
    write_stack(tmp_path / "stack2.tif", PICTURES[:3])
    write_stack(tmp_path / "stack10.tiff", PICTURES[3:])
    with open_recording(tmp_path, strict=True) as recording:
        frames = list(pickle.loads(pickle.dumps(recording)).frames())
        names = ["stack2_page1.tif", "stack2_page2.tif", "stack2_page3.tif", "stack10.tiff"]
        assert [frame.name for frame in frames] == names
        for frame, picture in zip(frames, PICTURES, strict=True):
            np.testing.assert_array_equal(frame.image(), picture)
        assert frames[1].picture().encoding == "mono8"
        assert len(set(recording.identities(tmp_path.name))) == 4


def tiff(directories: list[list[tuple[int, int, int]]], following: list[int] | None = None, big: bool = False) -> bytes:
    """Directories of (tag, kind, value); following: the offset that each says the next is at."""
    head = 16 if big else 8
    sizes = [(16 if big else 6) + (20 if big else 12) * len(one) for one in directories]
    starts = [head + sum(sizes[:number]) for number in range(len(sizes))] + [0]
    content = struct.pack("<2sHHHQ", b"II", 43, 8, 0, head) if big else struct.pack("<2sHI", b"II", 42, head)
    for number, one in enumerate(directories):
        content += struct.pack("<Q" if big else "<H", len(one))
        for entry in one:
            content += struct.pack("<HHQQ" if big else "<HHII", *entry[:2], 1, entry[2])
        content += struct.pack("<Q" if big else "<I", starts[number + 1] if following is None else following[number])
    return content


def size_tags(width: int, height: int, kind: int = 0) -> list[tuple[int, int, int]]:
    return [(254, 4, kind), (256, 3, width), (257, 4, height)]


@pytest.mark.parametrize("big", [False, True])
def test_pages_thumbnails_and_damage(tmp_path, big):
    from fisheye_ep_calib.storage.tiff_pages import pages

    whole = [size_tags(8, 6), size_tags(2, 2, 1), size_tags(9, 5), size_tags(8, 6, 4)]
    assert [tuple(page[:3]) for page in pages(tiff(whole, big=big))] == [(0, 8, 6), (2, 9, 5)]
    assert len(pages(tiff([size_tags(8, 6)] * 30, big=big), most=7)) == 7
    first = 16 if big else 8
    assert len(pages(tiff([size_tags(8, 6)], [first], big))) == 1  # a directory that is its own next one
    assert len(pages(tiff([size_tags(8, 6)], [10**6], big))) == 1
    assert declared_size(tiff(whole, big=big)) == (8, 6)


@pytest.mark.parametrize("offset", [10**6, 2**63, 2**64 - 1])
def test_a_directory_beyond_the_end_is_none(offset):
    from fisheye_ep_calib.storage.tiff_pages import pages

    sound = tiff([size_tags(8, 6)], [offset], big=True)
    assert len(pages(sound)) == 1
    with pytest.raises(struct.error):
        pages(sound[:8] + struct.pack("<Q", offset) + sound[16:])


def test_a_page_that_declares_too_much_is_not_decoded(tmp_path):
    (tmp_path / "a.tif").write_bytes(tiff([size_tags(8, 6), size_tags(60000, 60000)]))
    with open_recording(tmp_path) as recording:
        with pytest.raises(InputError, match="60000×60000"):
            recording.frame(tmp_path.name, 1).image()
        with pytest.raises(InputError, match="cannot be decoded"):
            recording.frame(tmp_path.name, 0).image()


def archive(path, members: dict[str, bytes], links: dict[str, str] | None = None):
    with tarfile.open(path, "w:gz" if path.name.endswith("gz") else "w") as content:
        for name, target in (links or {}).items():
            link = tarfile.TarInfo(name)
            link.type, link.linkname = tarfile.SYMTYPE, target
            content.addfile(link)
        for name, data in members.items():
            member = tarfile.TarInfo(name)
            member.size = len(data)
            content.addfile(member, io.BytesIO(data))
    return path


PNG = [encoded(picture, ".png") for picture in PICTURES]


@pytest.mark.parametrize("name", ["calibrationdata.tar.gz", "calibrationdata.tgz", "calibrationdata.tar"])
def test_the_archive_of_camera_calibration(tmp_path, name):
    members = {f"{side}-{number:04d}.png": PNG[number] for number in range(4) for side in ("left", "right")}
    path = archive(tmp_path / name, {**members, "left.yaml": b"a: 1", "ost.txt": b"text"})
    with open_recording(path, strict=True) as recording:
        assert [(topic.name, topic.count) for topic in recording.image_topics()] == [("left", 4), ("right", 4)]
        assert str(path) in recording.notes[0]
        np.testing.assert_array_equal(recording.frame("right", 2).image(), PICTURES[2])
        identities = recording.identities("left")
        assert identities[0] == f"{path}!left-0000.png" and recording.files() == [path] * 2
        copy = pickle.loads(pickle.dumps(recording))
        np.testing.assert_array_equal(copy.frame("left", 3).image(), PICTURES[3])
    with open_recording(path) as recording:
        assert recording.identities("left") == identities  # so that an interrupted search goes on


def test_one_camera_and_folders_in_an_archive(tmp_path):
    one = archive(tmp_path / "calibrationdata.tar.gz", {f"left-{i:04d}.png": PNG[i] for i in range(4)})
    two = archive(tmp_path / "euroc.tar", {f"mav0/cam{c}/data/{i}.png": PNG[i] for i in range(4) for c in (0, 1)})
    for path, names in ((one, ["calibrationdata"]), (two, ["cam0", "cam1"])):
        with open_recording(path) as recording:
            assert [topic.name for topic in recording.image_topics()] == names


def test_nothing_leaves_the_folder(tmp_path, monkeypatch):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    members = {
        "../../out.png": PNG[0],
        str(tmp_path / "abs.png"): PNG[1],
        "x/in.png": PNG[2],
        "a.png": PNG[3],
        "b.sh": b"",
    }
    path = archive(tmp_path / "evil.tar", members, {"x": str(tmp_path), "a.png": str(tmp_path / "victim.png")})
    with open_recording(path):
        assert sorted(file.name for file in tmp_path.iterdir()) == ["evil.tar", "scratch"]
        assert not any(file.is_symlink() for file in scratch.rglob("*")) and not list(scratch.rglob("*.sh"))
    assert list(scratch.iterdir()) == []


def test_archives_that_cannot_be_used_get_one_line(tmp_path, monkeypatch):
    def refused(path, said):
        with pytest.raises(InputError, match=said) as raised:
            open_recording(path)
        assert "\n" not in str(raised.value)

    (tmp_path / "no.tar.gz").write_bytes(b"no archive")
    refused(tmp_path / "no.tar.gz", "is not a tar archive")
    refused(archive(tmp_path / "empty.tar", {"a.txt": b"a"}), "holds no images")
    whole = archive(tmp_path / "whole.tar", {f"{i}.png": PNG[i] for i in range(4)}).read_bytes()
    (tmp_path / "cut.tar").write_bytes(whole[: len(whole) // 3])
    with open_recording(tmp_path / "cut.tar") as recording:
        assert "cut short" in recording.problems[0] and 0 < recording.count("cut") < 4
    monkeypatch.setattr("fisheye_ep_calib.storage.sources.image_archive._MOST_MEMBERS", 3)
    refused(tmp_path / "whole.tar", "no room")


def test_a_header_that_asks_for_memory_is_refused(tmp_path):
    long = tarfile.TarInfo("a")
    long.type, long.size = tarfile.GNUTYPE_LONGNAME, 2**33
    (tmp_path / "a.tar").write_bytes(long.tobuf() + b"\0" * 2**16)
    with pytest.raises(InputError, match="not a tar archive"):
        open_recording(tmp_path / "a.tar")
