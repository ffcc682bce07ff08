"""A kind's name → its target. What a kind needs beyond ledpi is imported only here."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from ledpi.config.outputs import Kind, OutputSettings
from ledpi.core.wording import install_command
from ledpi.links.target import BridgeError, Target
from ledpi.wire.mavlink import load_dialect

# By kind: the module and class, and the extra of pyproject.toml that brings what it imports.
TARGETS: dict[Kind, tuple[str, str, str | None]] = {
    "stdout": ("sockets", "StdoutTarget", None),
    "udp": ("sockets", "UdpTarget", None),
    "tcp": ("sockets", "TcpTarget", None),
    "mqtt": ("mqtt", "MqttTarget", "mqtt"),
    "nt": ("nt", "NtTarget", "nt"),
    "zenoh": ("zenoh_ros", "ZenohTarget", "zenoh"),
}


def target_class(name: str, settings: OutputSettings) -> Callable[[OutputSettings], Target]:
    """Returns what makes a target of these settings. Raises BridgeError, ConfigError where its packages are missing."""
    kind = settings.kind
    module, target, extra = TARGETS[kind]
    if settings.format == "mavlink":
        load_dialect(f"outputs.{name}.format")
    try:
        made: Callable[[OutputSettings], Target] = getattr(import_module(f"ledpi.links.{module}"), target)
    except ImportError as error:
        said = f"outputs.{name}: kind {kind} needs the package {error.name}"
        raise BridgeError(f"{said}: {install_command(extra or kind)}") from None
    return made


def open_target(name: str, settings: OutputSettings) -> Target:
    """The target, not yet connected. Raises LedpiError where its packages are missing, or its files cannot be read."""
    return target_class(name, settings)(settings)
