"""Prints the lowest versions that a wheel asks for, as constraints for pip: ``numpy==1.26.*`` of ``numpy>=1.26``."""

import re
import sys
import zipfile

with zipfile.ZipFile(sys.argv[1]) as wheel:
    (metadata,) = [name for name in wheel.namelist() if name.endswith(".dist-info/METADATA")]
    for line in wheel.read(metadata).decode().splitlines():
        found = re.match(r"Requires-Dist: ([\w.-]+)\s*\(?[^;]*>=\s*([\d.]+)", line)
        if found and "extra ==" not in line:
            print(f"{found[1]}=={found[2]}.*")
