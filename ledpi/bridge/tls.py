"""A connection that is encrypted, and the other side's certificate."""

from __future__ import annotations

import ssl
from pathlib import Path

from ledpi.bridge.target import BridgeError, TargetLostError

NOT_YET_VALID = 9  # OpenSSL's X509_V_ERR_CERT_NOT_YET_VALID: a Pi without a clock, until it has asked the network


def tls_context(ca_file: Path | None) -> ssl.SSLContext:
    """One that checks the other side by `ca_file`, or by the system's authorities. Raises BridgeError."""
    try:
        return ssl.create_default_context(cafile=None if ca_file is None else str(ca_file))
    except (OSError, ssl.SSLError) as error:
        raise BridgeError(f"{ca_file}: no certificates can be read from it ({error.strerror or error})") from None


def refused(where: str, error: ssl.SSLError) -> BridgeError | TargetLostError:
    """The error of a handshake that failed, with what to look at."""
    if isinstance(error, ssl.SSLEOFError | ssl.SSLZeroReturnError):  # as a server does that is being restarted
        return TargetLostError(f"{where}: closes the connection; is the port right for tls: true?")
    if not isinstance(error, ssl.SSLCertVerificationError):
        return BridgeError(f"{where}: speaks no TLS ({error.reason}); is the port right?")
    said = f"{where}: its certificate is not accepted ({error.verify_message})"
    if error.verify_code == NOT_YET_VALID:
        return TargetLostError(f"{said}; is this machine's clock right?")
    return BridgeError(f"{said}; renew it, or see host and ca_file")
