"""`ledpi view`: the live page."""

from __future__ import annotations

import ctypes
import logging
import os
import re
import secrets
import signal
import socket
import stat
import threading
from contextlib import suppress
from pathlib import Path

import typer

from ledpi.cli import CONFIG, SET, app
from ledpi.config.settings import Config, ViewSettings, find_config, load_config
from ledpi.core.errors import ConfigError
from ledpi.core.files import put_in_place, read_text, write_beside
from ledpi.daemon.reporting import log_to_standard_error
from ledpi.daemon.tap.places import of_config
from ledpi.page.guard import Guard, metrics_token
from ledpi.page.hub import Hub
from ledpi.page.server import ViewServer
from ledpi.page.settings import Settings

_M_ARENA_MAX = -8  # of glibc's malloc.h
_log = logging.getLogger("ledpi.view")


@app.command()
def view(config: Path | None = CONFIG, set_: list[str] = SET) -> None:
    """A web page of what the running daemon sees.

    It shows the picture with overlay, panels, map, focus, health, recordings, and why a panel is not read. The daemon
    need not run yet, and may restart. By default only this machine can open the page; `view.listen` opens it to the
    network. The command prints the address to open, with the token that the page needs, and a token that opens the
    figures for Prometheus alone. Ends with Ctrl-C or SIGTERM.

    Example: ledpi view --set view.listen=0.0.0.0:8088
    """
    log_to_standard_error()
    _share_memory()
    file = find_config(config)
    settings = load_config(file, tuple(set_), without_file=("panels.side_m=1",))
    _warn_of_readable_token(settings, file)
    socket_path = of_config(settings)
    if socket_path is None:
        raise ConfigError("tap.socket: is null, so the daemon shows nothing; must be auto, or the daemon's path")
    hub = Hub(socket_path)
    server, token = open_server(settings.view, hub, Settings(hub, file, set_))
    ending = {signal.SIGINT, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, ending)  # from here on they wait to be waited for
    typer.echo(f"open http://{_shown_host(server)}:{server.server_port}/#token={token}")
    typer.echo(f"for Prometheus: /metrics with the token {metrics_token(token)}")
    hub.start()
    threading.Thread(target=server.serve_forever, name="server", daemon=True).start()
    signal.sigwait(ending)
    server.shutdown()
    server.server_close()
    hub.close()


def _warn_of_readable_token(settings: Config, file: Path | None) -> None:
    """Says where other users of the machine find the token."""
    if settings.view.token is None or "view.token" in settings.from_command_line or file is None:
        return
    if file.stat().st_mode & stat.S_IROTH:
        remedy = f"chgrp ledpi {file}; chmod 640 {file}"
        _log.warning("view.token: every user of this machine can read it in %s; remedy: %s", file, remedy)


def _share_memory() -> None:
    """Has all threads take memory from two places: each would keep some of its own, 100 MB for 50 viewers."""
    with suppress(AttributeError, OSError):  # another C library than glibc
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 2)


def open_server(settings: ViewSettings, hub: Hub, keys: Settings) -> tuple[ViewServer, str]:
    """The listening server, and the token that it wants. Raises ConfigError where the address cannot be had."""
    host, port = settings.address
    token = settings.token or kept_token()
    own = socket.gethostname().lower()
    guard = Guard(token=token, names=frozenset({"localhost", own, f"{own}.local", *settings.hosts}))
    try:
        return ViewServer((host, port), guard, hub, keys), token
    except OSError as error:
        what = "is in use; choose another port, or end what uses it" if error.errno == 98 else f"{error.strerror}"
        raise ConfigError(f"view.listen: {settings.listen}: {what}") from None


def _shown_host(server: ViewServer) -> str:
    """That a browser can open: of all addresses this machine's name."""
    host = server.server_name
    if host in ("0.0.0.0", "::"):
        return socket.gethostname()
    return f"[{host}]" if ":" in host else host


def kept_token() -> str:
    """Returns the one in systemd's state folder, so that an address which was kept works after a reboot, too."""
    token = secrets.token_urlsafe(24)
    folder = os.environ.get("STATE_DIRECTORY")
    if not folder:
        return token
    file = Path(folder) / "token"
    with suppress(ConfigError):  # not there yet, or of no use
        kept = read_text(file, ConfigError)
        if re.fullmatch(r"[\w-]{32}", kept, re.ASCII):
            return kept
    try:
        put_in_place(write_beside(file, token.encode()), file)
    except OSError as error:
        _log.warning("the token is for this start alone: %s: %s", file, error.strerror)
    return token
