"""A certificate for each robot, the viewer and the world, by which they know each other over TLS (mTLS).

`wireswarm certs` makes the folder. A host needs of it `ca.pem`, and `NAME.pem` and `NAME.key` of who runs there; the
world's also needs `roster.json`, which says whose certificates count. An identity that is taken from the roster is
revoked: Zenoh's TLS knows no revocation lists (1.10; open as eclipse-zenoh/zenoh#2749).
"""

import hashlib
import socket
import ssl
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import StringConstraints, TypeAdapter, ValidationError

from protocol.access import ANYBODY, VIEWER, WORLD, access_control, zenoh_id
from protocol.document import parse_document, read_text
from protocol.errors import InputError
from protocol.messages import ID

AUTHORITY = "ca"
"""Name of the authority's files."""
ROSTER = "roster.json"
RESERVED = (AUTHORITY, WORLD, VIEWER, ANYBODY)
"""No robot has one of these names."""
PROBE_S, LET_IN_S = 5.0, 0.5
"""A handshake that finds out why there is no link takes some ms; a host may be far or silent. Who is let in hears
nothing before it speaks."""
_FOREIGN = (18, 19, 20, 21)
"""OpenSSL's codes for a chain that ends at no known authority (X509_V_ERR_*)."""


class Identity(NamedTuple):
    """A certificate that counts."""

    common_name: Annotated[str, StringConstraints(pattern=r"^[a-z0-9_.-]{1,64}$")]
    """NAME.RANDOM: another certificate of the same name has another."""
    sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
    """Fingerprint of the certificate."""


_ROSTER = TypeAdapter(dict[Annotated[str, StringConstraints(pattern=f"^{ID}$")], Identity])


def read_roster(folder: Path) -> dict[str, Identity]:
    """The certificates that count, by name. Raises InputError."""
    try:
        return _ROSTER.validate_python(parse_document(read_text(folder / ROSTER)))
    except InputError as error:
        raise InputError(f"--certs {folder}: {ROSTER}: {error}; `wireswarm certs` makes it") from None
    except ValidationError as error:
        where = ".".join(map(str, error.errors(include_url=False)[0]["loc"]))
        raise InputError(f"--certs {folder}: {ROSTER}: {where}: no entry of `wireswarm certs`") from None


def fingerprint(certificate: str) -> str:
    """SHA-256 of a certificate in PEM, the first of a text, which may begin with anything. Raises ValueError."""
    begin = certificate.index(ssl.PEM_HEADER)
    end = certificate.index(ssl.PEM_FOOTER, begin) + len(ssl.PEM_FOOTER)
    return hashlib.sha256(ssl.PEM_cert_to_DER_cert(certificate[begin:end])).hexdigest()


class Certificates:
    """A folder of certificates, of one or of all names. Credentials of `protocol.access`."""

    encrypted = True

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        """Names: those whose key is used, or, of a router, those who may connect."""
        self._folder, self._names = folder, names
        self._roster: Mapping[str, Identity] = {}
        self._read_ns: int | None = None
        """When the roster that was read last was written."""
        self._ruled: Mapping[str, Identity] | None = None
        """The roster by which the router's rules were made, which hold as long as it is open."""

    @property
    def robots(self) -> list[str]:
        """Robots among these names."""
        return [name for name in self._names if name not in RESERVED]

    def subjects(self) -> dict[str, dict[str, list[str]]]:
        """Common name and the one session of each on the roster; anybody with a certificate may ask why not."""
        self._ruled = roster = read_roster(self._folder)
        found = {name: roster[name] for name in self._names if name in roster}
        known = {
            name: {"cert_common_names": [e.common_name], "zids": [zenoh_id(e.sha256)]} for name, e in found.items()
        }
        return {**known, ANYBODY: {"link_protocols": ["tls"]}}

    def session_id(self, name: str) -> str | None:
        """By the fingerprint on the roster as it is now, or, where that cannot be read, as it was."""
        with suppress(InputError, OSError):
            written_ns = (self._folder / ROSTER).stat().st_mtime_ns
            if written_ns != self._read_ns:
                self._roster, self._read_ns = read_roster(self._folder), written_ns
        identity = self._roster.get(name)
        if identity is None or (self._ruled is not None and self._ruled.get(name) != identity):
            return None
        return zenoh_id(identity.sha256)

    def connecting(self, name: str) -> dict[str, object]:
        """The certificate to show, the authority of the one to be shown, and the session's ID."""
        tls = self._tls(name, "connect")
        try:
            own = fingerprint(read_text(self._file(f"{name}.pem")))
        except ValueError:  # OpenSSL takes other words for CERTIFICATE, too
            raise InputError(f"--certs {self._folder}: {name}.pem does not hold a certificate as PEM has it") from None
        return {"id": zenoh_id(own), "transport/link/tls": tls}

    @contextmanager
    def listening(self) -> Iterator[dict[str, object]]:
        """Settings that name files of the folder."""
        yield self.listening_by_folder()

    def listening_by_folder(self) -> dict[str, object]:
        """Who connects must show a certificate of the authority, and has the rights that the roster gives it."""
        return {"transport/link/tls": self._tls(WORLD, "listen"), "access_control": access_control(self)}

    def _tls(self, name: str, side: str) -> dict[str, object]:
        """Zenoh's settings of one that shows its certificate and demands one. Raises InputError."""
        self._context(name)
        return {
            "enable_mtls": True,
            "root_ca_certificate": str(self._file(f"{AUTHORITY}.pem")),
            f"{side}_certificate": str(self._file(f"{name}.pem")),
            f"{side}_private_key": str(self._file(f"{name}.key")),
        }

    def _context(self, name: str) -> ssl.SSLContext:
        """The same for a handshake of our own. Raises InputError where the files do not belong together."""
        authority, certificate, key = (self._file(file) for file in (f"{AUTHORITY}.pem", f"{name}.pem", f"{name}.key"))
        try:
            context = ssl.create_default_context(cafile=authority)
        except ssl.SSLError:
            raise InputError(f"--certs {self._folder}: {AUTHORITY}.pem is no certificate") from None
        try:
            context.load_cert_chain(certificate, key, password="")  # else a terminal is asked for one
        except (ssl.SSLError, ValueError):
            raise InputError(f"--certs {self._folder}: {name}.key is not the key of a certificate {name}.pem") from None
        return context

    def _file(self, name: str) -> Path:
        """Absolute path of a file of the folder. Raises InputError where it cannot be read."""
        file = (self._folder / name).absolute()
        try:
            read_text(file)
        except InputError as error:
            raise InputError(f"--certs {self._folder}: {name}: {error}") from None
        return file

    def refused(self, name: str, endpoint: str) -> str:
        """What a handshake of our own says, as Zenoh tells no client why it is refused."""
        host, _, port = endpoint.partition("/")[2].rpartition(":")
        host, shook_hands = host.strip("[]"), False
        try:
            with (
                socket.create_connection((host, int(port)), PROBE_S) as plain,
                self._context(name).wrap_socket(plain, server_hostname=host) as link,
            ):
                shook_hands = True  # with TLS 1.3 a client hears afterwards what becomes of its certificate
                link.settimeout(LET_IN_S)
                with suppress(TimeoutError):
                    link.recv(1)
        except ssl.SSLCertVerificationError as error:
            foreign = "it is of another authority" if error.verify_code in _FOREIGN else error.verify_message
            return f"the certificate that is shown there does not count: {foreign}"
        except ssl.SSLError as error:
            reason = (error.reason or str(error)).lower().replace("_", " ")
            whose = f"the certificate of {name} does not count there" if shook_hands else "no TLS is spoken there"
            return f"{whose} ({reason})"
        except OSError as error:
            return f"check that it runs, the address, the port and firewalls between ({error.strerror or error})"
        return "certificates are in order, but no session is opened; it may be too busy"
