"""A daemon on a camera at rest that sees panel 7, and panel 11 with a fault of `faults`: FOLDER/tap.sock."""

from __future__ import annotations

import signal
import sys

from ledpi.daemon.service import Service
from tests.builders.faults import FAULTS, camera_of, config_of


def main() -> None:
    """Until SIGTERM."""
    folder, name = sys.argv[1:3]
    fault = FAULTS[name]
    config = config_of(fault, f"tap.socket={folder}/tap.sock", f"serial.port={folder}/none")
    service = Service(lambda: config, lambda _: camera_of(fault, config, paced=True))
    signal.signal(signal.SIGTERM, lambda *_: service.stop())
    service.run()


if __name__ == "__main__":
    main()
