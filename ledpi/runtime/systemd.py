"""Words of a service of Type=notify to systemd: sd_notify(3) without its library. Elsewhere: nothing."""

from __future__ import annotations

import os
import socket

_TIMEOUT_S = 1.0  # systemd reads at once; the daemon does not hang on it if it should not


def notify(message: str) -> bool:
    """Sends `READY=1`, `WATCHDOG=1`, `STOPPING=1` or `STATUS=…`. Returns whether systemd got it.

    False where no service manager listens (NOTIFY_SOCKET is not set), or where its socket is gone: a daemon
    goes on without.
    """
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return False
    if address.startswith("@"):
        address = "\0" + address[1:]  # an abstract socket, which has no file
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
            sender.settimeout(_TIMEOUT_S)
            sender.sendto(message.encode(), address)
    except OSError:
        return False
    return True
