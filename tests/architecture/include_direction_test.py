#!/usr/bin/env python3
"""The checker must find what it is there for: plants one fault of each kind in a copy and expects it back.

usage: include_direction_test.py REPOSITORY
"""

import pathlib
import shutil
import subprocess
import sys
import tempfile

FAULTS = {
    "maps/src/upward.cpp": "#include <stillmap/server/server.hpp>\n",
    "localization/include/stillmap/localization/leak.hpp": "#include <nlohmann/json.hpp>\n",
    "server/src/cli/second_http.cpp": "#include <httplib.h>\n",
    "mapping/src/stray_pcl.cpp": "#include <pcl/point_types.h>\n",
    "server/src/mapper/private.cpp": '#include "reference/pcl_cloud.hpp"\n',
    "mapping/src/climb.cpp": '#include "../../maps/src/secret.hpp"\n',
}


def main():
    source = pathlib.Path(sys.argv[1])
    checker = source / "tests/architecture/include_direction.py"
    missed = []
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for layer in ("maps", "localization", "mapping", "server"):
            shutil.copytree(source / layer, root / layer, ignore=shutil.ignore_patterns("node_modules"))
        for name, text in FAULTS.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)
            run = subprocess.run([sys.executable, checker, root], capture_output=True, text=True)
            if run.returncode == 0 or name not in run.stdout:
                missed.append(name)
            (root / name).unlink()
    print("\n".join(f"not found: {name}" for name in missed) or f"{len(FAULTS)} planted faults found")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
