"""Who may have what: the address to listen on, the token, and what of a request's head is refused. Pure."""

from __future__ import annotations

import hashlib
import hmac
import re
from collections.abc import Mapping
from dataclasses import dataclass

from ledpi.config.values import is_ip
from ledpi.core.errors import LedpiError

MAX_BODY_BYTES = 4096
MAX_UPLOAD_BYTES = {"/api/restore": 2_097_152}  # of a backup, as `ledpi restore` reads it
METRICS = "/metrics"
TELLS = ("/api/", METRICS)  # what is more than the page itself
_SAME = ("same-origin", "none")  # of Sec-Fetch-Site: the page itself, or an address that a person has typed

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Embedder-Policy": "require-corp",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
    "Cache-Control": "no-store",
}


class NotOfferedError(LedpiError):
    """A change that this page does not make."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """An answer that is no page: its status and one line that says what would be right."""

    status: int
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Guard:
    """Judges requests by their heads."""

    token: str  # whoever has it may ask for everything
    names: frozenset[str]  # that this machine is called by, besides its numbers

    def refuse(self, path: str, headers: Mapping[str, str]) -> Refusal | None:
        """Why a request is not answered; None if it is. `headers`: names in lower case."""
        return (
            self._host(headers.get("host", ""))
            or _body(path, headers)
            or (self._site(headers) if path.startswith(TELLS) else None)
            or (self._secret(path, headers) if path.startswith(TELLS) else None)
        )

    def _host(self, host: str) -> Refusal | None:
        """A foreign site's name that leads here would make this page that site's own (DNS rebinding)."""
        name = host_of(host)
        if is_ip(name) or name in self.names:
            return None
        known = ", ".join(sorted(self.names))
        called = name[:60] or "a host without a name"
        says = f"this is not {called}; must be {known}, or this machine's IP address; view.hosts adds names"
        return Refusal(status=421, says=says)

    def _site(self, headers: Mapping[str, str]) -> Refusal | None:
        """Another site's page, as the browser says: by what it is to this one, or, older ones, by its address."""
        origin = headers.get("origin", "").rpartition("/")[2]
        foreign = origin and self._host(origin) is not None
        if headers.get("sec-fetch-site", "none") in _SAME and not foreign:
            return None
        return Refusal(status=403, says="another site's page has asked; must be this page itself")

    def _secret(self, path: str, headers: Mapping[str, str]) -> Refusal | None:
        """On this machine's own address, too: its other users are kept from the tap, and so from its pictures."""
        scheme, _, given = headers.get("authorization", "").partition(" ")
        enough = (self.token, metrics_token(self.token)) if path == METRICS else (self.token,)
        right = [hmac.compare_digest(given.strip().encode(), token.encode()) for token in enough]
        if scheme.lower() == "bearer" and any(right):
            return None
        return Refusal(status=401, says="wrong token, or none; open the address that `ledpi view` has printed")


def metrics_token(token: str) -> str:
    """Returns the token that opens the figures alone: it follows from the page's, which nobody can tell from it."""
    return hmac.new(token.encode(), METRICS.encode(), hashlib.sha256).hexdigest()[:32]


def _body(path: str, headers: Mapping[str, str]) -> Refusal | None:
    if "transfer-encoding" in headers:
        return Refusal(status=411, says="a body must come with its Content-Length")
    length = headers.get("content-length", "0")
    if not (length.isascii() and length.isdigit()):
        return Refusal(status=400, says="Content-Length must be a whole number")
    at_most = MAX_UPLOAD_BYTES.get(path, MAX_BODY_BYTES)
    if len(length) > 9 or int(length) > at_most:
        return Refusal(status=413, says=f"a body must have {at_most} bytes at most")
    return None


def host_of(header: str) -> str:
    """The name or number in a Host header, without port and brackets, in lower case."""
    host = header.strip().lower()
    parts = re.fullmatch(r"(?:\[([^\]]*)\]|([^:\[]*))(?::[0-9]*)?", host)
    return host if parts is None else parts[1] or parts[2] or ""
