"""Certificates of a server on this machine, made by openssl."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

AUTHORITY = """\
-----BEGIN CERTIFICATE-----
MIIBcDCCARegAwIBAgIUO2w49amz4bZaIFLi3yNORCWvKd0wCgYIKoZIzj0EAwIw
DTELMAkGA1UEAwwCY2EwIBcNMjYxMTI5MTAyNjU5WhgPMjEyNjExMDUxMDI2NTla
MA0xCzAJBgNVBAMMAmNhMFkwEwYHKoZIzj0CAQYIKoZIzj0DAQcDQgAEBZg+UU5s
HfBRbtmOyVLtYmLvQq/Ce7Qoymy7XEkuJh9+DmsevEpOjH/jZXznaQl/VRxlye91
IUAc6YJnckaIp6NTMFEwHQYDVR0OBBYEFB/oagcU4zwFy2+l504L3K+1z7wnMB8G
A1UdIwQYMBaAFB/oagcU4zwFy2+l504L3K+1z7wnMA8GA1UdEwEB/wQFMAMBAf8w
CgYIKoZIzj0EAwIDRwAwRAIgNFF/auUuATwuT8R6YK9ky+BfWiTmPYAD3vD23OFw
A3cCIBCJSE3Zi6aHnjf9e8IlzSbq5moNzW17TisPfPog3wh3
-----END CERTIFICATE-----
"""  # of a certificate's form
needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="not installed: openssl")


def _openssl(*words: str, folder: Path) -> None:
    subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)


def certificates(folder: Path) -> None:
    """Makes an authority, ca.pem, and three server's certificates that it has signed: broker.pem, ended.pem, and
    other.pem, which is of another name; and self.pem, which has signed itself.
    """
    new = ("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    # Python 3.13 and newer ask for an authority's use, and for the name of its key.
    authority = ("-x509", "-days", "30", "-subj", "/CN=ca", "-addext", "keyUsage=critical,keyCertSign")
    _openssl(*new, *authority, "-keyout", "ca.key", "-out", "ca.pem", folder=folder)
    extensions = "subjectAltName=DNS:localhost,IP:127.0.0.1\nauthorityKeyIdentifier=keyid\n"
    (folder / "san").write_text(extensions, encoding="utf-8")
    _openssl(*new, "-subj", "/CN=localhost", "-keyout", "broker.key", "-out", "broker.csr", folder=folder)
    sign = ("x509", "-req", "-in", "broker.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial")
    _openssl(*sign, "-extfile", "san", "-days", "30", "-out", "broker.pem", folder=folder)
    _openssl(*sign, "-extfile", "san", "-days", "-1", "-out", "ended.pem", folder=folder)
    (folder / "other").write_text(extensions.replace("localhost", "other.lan").replace("127.0.0.1", "192.0.2.1"))
    _openssl(*sign, "-extfile", "other", "-days", "30", "-out", "other.pem", folder=folder)
    alone = ("req", "-x509", "-key", "broker.key", "-subj", "/CN=localhost", "-days", "30")
    _openssl(*alone, "-addext", "subjectAltName=DNS:localhost", "-out", "self.pem", folder=folder)
