"""The errors of a connection that is encrypted: of the other side's certificate, say."""

from __future__ import annotations

import ssl

from ledpi.bridge.target import BridgeError, TargetLostError

NOT_YET_VALID = 9  # OpenSSL's X509_V_ERR_CERT_NOT_YET_VALID: a Pi without a clock, until it has asked the network


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
