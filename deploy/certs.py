"""`wireswarm certs`: an authority of one's own, and a key and certificate for the world, a viewer and each robot."""

import ipaddress
import json
import re
import secrets
import socket
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple, Self

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from protocol.access import VIEWER, WORLD
from protocol.certificates import AUTHORITY, RESERVED, ROSTER, Identity, read_roster
from protocol.document import read_text
from protocol.errors import InputError
from protocol.files import write_whole
from protocol.messages import ID, MAX_ROBOTS

VALID = timedelta(days=730)
"""Of an identity: longer than robots go without a visit, and a key that was lost unnoticed does not count for ever."""
AUTHORITY_VALID = 5 * VALID
EARLIER = timedelta(days=2)
"""Certificates are valid from so long before they were made, as clocks of robots are wrong."""
HERE = ("localhost", "127.0.0.1", "::1", WORLD)
"""Addresses that the world's certificate always has; the last is its name among containers."""


class Signed(NamedTuple):
    """A certificate with its key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @classmethod
    def read(cls, folder: Path, name: str) -> Self:
        """Raises InputError."""
        try:
            certificate = x509.load_pem_x509_certificate(read_text(folder / f"{name}.pem").encode())
            key = serialization.load_pem_private_key(read_text(folder / f"{name}.key").encode(), None)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"{folder}: no {name}.pem and {name}.key that can be used: {error}") from None
        if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
            raise InputError(f"{folder}: {name}.key is not the key of {name}.pem")
        return cls(certificate, key)

    def write(self, folder: Path, name: str) -> None:
        """Two files, which only their owner may read. Raises UnwritableError."""
        form = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        write_whole(folder / f"{name}.key", self.key.private_bytes(_PEM, *form), private=True)
        write_whole(folder / f"{name}.pem", self.certificate.public_bytes(_PEM), private=True)


_PEM = serialization.Encoding.PEM


def names_of(robots: str | None) -> list[str]:
    """Robots that are given by their number or their names. Raises InputError."""
    if robots is None or not re.fullmatch("[0-9]+", robots):
        return robots.split(",") if robots else []
    if len(robots) > 4 or not 1 <= int(robots) <= MAX_ROBOTS:
        raise InputError(f"--robots {robots:.20}: 1 to {MAX_ROBOTS}")
    return [f"r{number + 1}" for number in range(int(robots))]


def issue(folder: Path, robots: Sequence[str], hosts: Sequence[str]) -> list[str]:
    """Make identities of these robots, and the authority, the world's and a viewer's where there are none.

    hosts: further addresses of the world, or of the router before it. Returns the names of the identities.
    A folder that was empty gets a .gitignore, so that no key comes into a repository. Files of who is not on the
    roster, as a command that was broken off leaves them, count for nobody and are written over.
    Raises InputError where one is on the roster already, or none is asked for.
    """
    addresses = _addresses(hosts)
    if folder.is_symlink():  # somebody else may have laid it, to a folder of theirs
        raise InputError(f"{folder} is a link to {folder.readlink()}: name the folder itself")
    roster = read_roster(folder) if (folder / ROSTER).exists() else {}
    for robot in robots:
        if robot in RESERVED or not re.fullmatch(ID, robot):
            raise InputError(f"--robots {robot:.60}: no name for a robot; write a number, or names such as r1,r2")
    names = [*(name for name in (WORLD, VIEWER) if name not in roster), *dict.fromkeys(robots)]
    for name in names:
        if name in roster:
            raise InputError(f"{folder} has an identity of {name} already: end it by `--revoke {name}` first")
    if hosts and WORLD not in names:
        raise InputError(f"--host: {folder} has the world's certificate already: end it by `--revoke world` first")
    if not names:
        raise InputError(f"{folder} has identities of {', '.join(roster)}: name further robots by --robots")
    if (folder / f"{AUTHORITY}.pem").exists():  # written last: a key alone has signed nothing
        authority = Signed.read(folder, AUTHORITY)
    elif roster:
        raise InputError(f"{folder} has no {AUTHORITY}.pem and {AUTHORITY}.key: run this where they were made")
    else:
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: no folder can be made there: {error.strerror}") from None
        if not any(folder.iterdir()):  # else it may be the folder of a project, whose files are to be kept
            write_whole(folder / ".gitignore", "*\n", private=True)
        authority = _authority()
        authority.write(folder, AUTHORITY)
    for name in names:
        common_name = f"{name}.{secrets.token_hex(8)}"
        signed = _identity(authority, common_name, addresses if name == WORLD else None)
        signed.write(folder, name)
        roster[name] = Identity(common_name, signed.certificate.fingerprint(hashes.SHA256()).hex())
    _write_roster(folder, roster)
    return names


def revoke(folder: Path, name: str) -> None:
    """Take an identity from the roster, and remove its files. Raises InputError where there is none."""
    roster = read_roster(folder)
    if name not in roster:
        raise InputError(f"--revoke {name:.60}: {folder / ROSTER} has {', '.join(roster) or 'nobody'}")
    del roster[name]
    _write_roster(folder, roster)
    for kind in ("pem", "key"):
        (folder / f"{name}.{kind}").unlink(missing_ok=True)


def _write_roster(folder: Path, roster: Mapping[str, Identity]) -> None:
    lines = ",\n".join(f" {json.dumps(name)}: {json.dumps(entry._asdict())}" for name, entry in roster.items())
    write_whole(folder / ROSTER, f"{{\n{lines}\n}}\n", private=True)


def _addresses(hosts: Sequence[str]) -> x509.SubjectAlternativeName:
    found: list[x509.GeneralName] = []
    for host in dict.fromkeys((*HERE, socket.gethostname(), *hosts)):
        try:
            found.append(x509.IPAddress(ipaddress.ip_address(host)))
        except ValueError:
            if re.fullmatch(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?", host):
                found.append(x509.DNSName(host))
            elif host in hosts:
                raise InputError(f"--host {host:.60}: neither an address such as 192.168.1.5 nor a name") from None
    return x509.SubjectAlternativeName(found)


def _authority() -> Signed:
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"wireswarm {secrets.token_hex(4)}")])
    builder = _builder(name, name, key, AUTHORITY_VALID).add_extension(x509.BasicConstraints(True, 0), critical=True)
    return Signed(builder.add_extension(_usage(key_cert_sign=True), critical=True).sign(key, hashes.SHA256()), key)


def _identity(authority: Signed, common_name: str, addresses: x509.SubjectAlternativeName | None) -> Signed:
    """Only with addresses may it be shown by who is connected to: else each robot could pass for the world."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    builder = _builder(authority.certificate.subject, name, key, VALID)
    if addresses is not None:
        uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
        builder = builder.add_extension(addresses, critical=False)
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key())
    builder = (
        builder.add_extension(x509.BasicConstraints(False, None), critical=True)
        .add_extension(_usage(digital_signature=True), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .add_extension(issuer, critical=False)
    )
    return Signed(builder.sign(authority.key, hashes.SHA256()), key)


def _builder(
    issuer: x509.Name, subject: x509.Name, key: ec.EllipticCurvePrivateKey, valid: timedelta
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .issuer_name(issuer)
        .subject_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - EARLIER)
        .not_valid_after(now + valid)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _usage(*, digital_signature: bool = False, key_cert_sign: bool = False) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=digital_signature,
        key_cert_sign=key_cert_sign,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        crl_sign=key_cert_sign,
        encipher_only=False,
        decipher_only=False,
    )
