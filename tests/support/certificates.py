"""Certificates as docs/how-to/secure.md makes them with openssl."""

from __future__ import annotations

from pathlib import Path

import trustme


def write_certificate(
    authority: trustme.CA, folder: Path, name: str, host: str, file: str = ""
) -> None:
    """*file*.pem and *file*.key, called as *name* where nothing is given, of *name* at *host*."""
    certificate = authority.issue_cert(host, common_name=name)
    certificate.private_key_pem.write_to_path(folder / f"{file or name}.key")
    chain = b"".join(part.bytes() for part in certificate.cert_chain_pems)
    (folder / f"{file or name}.pem").write_bytes(chain)
