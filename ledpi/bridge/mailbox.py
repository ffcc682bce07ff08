"""Between the tap's reader and the target: of each kind of line the newest, so that nothing old waits."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from ledpi.bridge.target import Line


@dataclass(frozen=True, slots=True, kw_only=True)
class Mail:
    """The lines that have come since the last look."""

    setup: Line | None = None  # a `hello`
    frame: Line | None = None  # a `decoded`
    health: Line | None = None
    robot: Line | None = None  # a `robot_state`
    state: str | None = None  # of the daemon, where it has changed


class Mailbox:
    """Any thread may use it."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._mail = Mail()
        self.replaced = 0  # frames by newer ones, before anybody looked

    def put(self, mail: Mail) -> None:
        """Replaces what of the same kind still waits. Never waits."""
        with self._changed:
            old = self._mail
            self.replaced += old.frame is not None and mail.frame is not None
            self._mail = Mail(
                setup=mail.setup or old.setup,
                frame=mail.frame or old.frame,
                health=mail.health or old.health,
                robot=mail.robot or old.robot,
                state=mail.state or old.state,
            )
            self._changed.notify()

    def take(self, timeout_s: float) -> Mail:
        """All that waits, as soon as something does; nothing after `timeout_s`."""
        with self._changed:
            self._changed.wait_for(lambda: self._mail != Mail(), timeout_s)
            mail, self._mail = self._mail, Mail()
            return mail
