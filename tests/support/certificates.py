"""Certificates for tests of TLS, made by `openssl`: an authority, and what it signs."""

import shutil
import subprocess
from pathlib import Path

#: Why there are no certificates on this machine, or "".
WHY_ABSENT = "" if shutil.which("openssl") else "there is no openssl to make a certificate with"


class Authority:
    """An authority of its own, in a folder: `certificate` is what those who trust it need."""

    def __init__(self, folder: Path, name: str) -> None:
        self.certificate = folder / f"{name}.pem"
        self._key = folder / f"{name}.key"
        self._folder = folder
        self._name = name
        made = ("-keyout", str(self._key), "-out", str(self.certificate), "-subj", f"/CN={name}")
        _openssl("req", "-x509", "-newkey", "rsa:2048", "-noenc", "-days", "2", *made)

    def signed(self, name: str, alternative: str = "", *, days: int = 2) -> tuple[Path, Path]:
        """Return the files of a certificate and its key; `alternative` is its subjectAltName, as
        `DNS:localhost`.
        """
        certificate, key, request = (
            self._folder / f"{self._name}-{name}.{kind}" for kind in ("pem", "key", "csr")
        )
        extension = ("-addext", f"subjectAltName={alternative}") if alternative else ()
        _openssl(
            *("req", "-newkey", "rsa:2048", "-noenc", "-subj", f"/CN={name}", *extension),
            *("-keyout", str(key), "-out", str(request)),
        )
        signing = (
            "-CA",
            str(self.certificate),
            "-CAkey",
            str(self._key),
            "-copy_extensions",
            "copy",
        )
        _openssl(
            "x509",
            "-req",
            "-in",
            str(request),
            *signing,
            "-days",
            str(days),
            "-out",
            str(certificate),
        )
        return certificate, key


def _openssl(*words: str) -> None:
    subprocess.run(["openssl", *words], check=True, capture_output=True)
