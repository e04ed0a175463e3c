"""Certificates for tests of TLS, made by `openssl`: an authority, and what it signs."""

import shutil
import subprocess

#: Why there are no certificates on this machine, or "".
WHY_ABSENT = "" if shutil.which("openssl") else "there is no openssl to make a certificate with"


#: The extensions of an authority that Python 3.13 and later ask for, as RFC 5280, section 4.2.1,
#: does.
EXTENSIONS = ("basicConstraints=critical,CA:TRUE", "keyUsage=critical,keyCertSign,cRLSign")


class Authority:
    """An authority of its own, in a folder: `certificate` is what those who trust it need, `key`
    its private key.
    """

    def __init__(self, folder, name, extensions=EXTENSIONS):
        self.certificate = folder / f"{name}.pem"
        self.key = folder / f"{name}.key"
        self._folder = folder
        self._name = name
        arguments = (
            "-keyout",
            str(self.key),
            "-out",
            str(self.certificate),
            "-subj",
            f"/CN={name}",
        )
        added = (word for extension in extensions for word in ("-addext", extension))
        _openssl("req", "-x509", "-newkey", "rsa:2048", "-noenc", "-days", "2", *arguments, *added)

    def signed(self, name, alternative="", *, days=2):
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
            str(self.key),
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


def _openssl(*words):
    subprocess.run(["openssl", *words], check=True, capture_output=True)
