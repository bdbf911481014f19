"""A file's fingerprint changes with what is in it, and costs little."""

from __future__ import annotations

import hashlib
import os

from fisheye_ep_calib.storage import fingerprint as module
from fisheye_ep_calib.storage.fingerprint import fingerprint, fingerprint_of_all


def test_several_files_have_one_that_changes_with_each(tmp_path) -> None:
    files = [tmp_path / f"{number}.bin" for number in range(3)]
    for file in files:
        file.write_bytes(file.name.encode())
    whole = fingerprint_of_all(files)
    assert whole is not None and whole.startswith("sha256:") and fingerprint_of_all(files) == whole
    assert fingerprint_of_all(files[:1]) == fingerprint(files[0]) and fingerprint_of_all(files[::-1]) != whole
    files[1].write_bytes(b"other")
    assert fingerprint_of_all(files) != whole
    folder = fingerprint_of_all([tmp_path, files[0]])
    assert folder is not None and folder.startswith("partial-sha256:")
    many = fingerprint_of_all(files * 9)
    assert many is not None and many.startswith("partial-sha256:")
    assert fingerprint_of_all([*files, tmp_path / "none"]) is None and fingerprint_of_all([]) is None


def test_small_files_whole_large_ones_in_part_folders_by_their_files(tmp_path, monkeypatch) -> None:
    file = tmp_path / "a.bin"
    file.write_bytes(b"abc" * 100)
    assert fingerprint(file) == f"sha256:{hashlib.sha256(b'abc' * 100).hexdigest()}"
    folder = fingerprint(tmp_path)
    monkeypatch.setattr(module, "_WHOLE", 10)
    large = fingerprint(file)
    assert large is not None and large.startswith("partial-sha256:") and fingerprint(file) == large
    os.utime(file, ns=(1, 1))
    assert fingerprint(file) != large and fingerprint(tmp_path) != folder
    assert fingerprint(tmp_path / "none") is None
