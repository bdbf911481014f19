"""A file's fingerprint changes with what is in it, and costs little."""

from __future__ import annotations

import hashlib
import os

from fisheye_ep_calib.storage import fingerprint as module
from fisheye_ep_calib.storage.fingerprint import fingerprint


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
