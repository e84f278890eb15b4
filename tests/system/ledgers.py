"""The two ledgers as tests see them, and the identities that they know."""
import json
import os
import pathlib
import resource
import select
import signal
import subprocess
import time

from fabric import BIN, FABRIC, organisation_dir

# Blocks that hold several transactions, when these come at once, and as many bytes as those of our network of Fabric.
CUTTING = ("--batch-count", "10", "--batch-timeout", "25")
BATCH_BYTES = 10_000_000


class Ledger:
    """A running ledger in a directory of its own; may be stopped, killed and started again."""

    def __init__(self, directory: pathlib.Path, *options: str):
        self.directory = directory
        self.options = options
        self.process = None
        self.endpoint = None
        self.start()

    def start(self) -> None:
        with open(self.directory.with_suffix(".log"), "ab") as log:
            self.process = subprocess.Popen(self.command(), stdout=subprocess.PIPE, stderr=log, text=True,
                                            preexec_fn=self.limit)
        ready = self.process.stdout.readline()
        assert ready, self.log()
        self.ready = json.loads(ready)
        self.endpoint = self.ready["endpoint"]

    def limit(self) -> None:
        """Called in the new process."""

    def stop(self) -> int:
        if self.process.poll() is None:
            self.process.terminate()
        return self.process.wait(timeout=60)

    def kill(self) -> None:
        """All of its processes, at once."""
        children = pathlib.Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        handles = [os.pidfd_open(process) for process in (self.process.pid, *map(int, children))]
        for handle in handles:
            signal.pidfd_send_signal(handle, signal.SIGKILL)
        for handle in handles:  # readable once the last thread is gone, and its ports with it
            assert select.select([handle], [], [], 20)[0], "a killed process does not end"
            os.close(handle)
        self.process.wait(timeout=20)

    def log(self) -> str:
        return self.directory.with_suffix(".log").read_text()

    def organisation(self, number: int) -> pathlib.Path:
        return organisation_dir(self.directory, number)

    def endorser(self, organisation: int) -> tuple[str, pathlib.Path]:
        """Where that organisation's peer endorses."""
        return self.ready["peers"][organisation - 1], self.ca_file(organisation)

    def ca_file(self, number: int) -> pathlib.Path:
        """The CA of that organisation's TLS certificates."""
        return self.organisation(number) / "tlsca" / f"tlsca.org{number}.ledgerline-cert.pem"

    def msp_dir(self, organisation: int, user: str) -> pathlib.Path:
        return self.organisation(organisation) / "users" / f"{user}@org{organisation}.ledgerline" / "msp"

    def identity(self, organisation: int, user: str) -> dict:
        """`user`: "peer0" is the organisation's peer itself."""
        msp = (self.organisation(organisation) / "peers" / f"{user}.org{organisation}.ledgerline" / "msp"
               if user == "peer0" else self.msp_dir(organisation, user))
        return {"mspId": f"Org{organisation}MSP", "certificate": next((msp / "signcerts").iterdir()).read_text(),
                "key": next((msp / "keystore").iterdir()).read_text()}


class Embedded(Ledger):
    name = "ledgerline-node"

    def __init__(self, directory: pathlib.Path, *options: str, file_limit: int | None = None):
        self.file_limit = file_limit  # bytes that a file may have: a disk that is full, for this process alone
        super().__init__(directory, *options)

    def command(self) -> list:
        return [BIN / "ledgerline-node", "--dir", self.directory, "--listen", self.endpoint or "127.0.0.1:0",
                "--summary", self.directory.with_suffix(".json"), "--batch-bytes", str(BATCH_BYTES), *self.options]

    def limit(self) -> None:
        if self.file_limit is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (self.file_limit, self.file_limit))

    def peer(self, _organisation: int) -> tuple[str, pathlib.Path]:
        """One process is everybody's peer, with the certificate of the first organisation's."""
        return self.endpoint, self.ca_file(1)

    def orderer(self) -> tuple[str, pathlib.Path]:
        return self.peer(1)


    def summary(self) -> dict:
        return json.loads(self.directory.with_suffix(".json").read_text())


class Fabric(Ledger):
    """A real network with our contract on it."""
    name = "fabric"

    def command(self) -> list:
        return [BIN / "ledgerline", "fabric", "run", "--dir", self.directory, "--tools", FABRIC, *self.options]

    def peer(self, organisation: int) -> tuple[str, pathlib.Path]:
        return self.ready["peers"][organisation - 1], self.ca_file(organisation)

    def orderer(self) -> tuple[str, pathlib.Path]:
        return (self.ready["orderers"][0],
                self.directory / "crypto" / "ordererOrganizations" / "ledgerline" / "tlsca" / "tlsca.ledgerline-cert.pem")


def tables(ledger, organisation: int, user: str = "User1", endorsers: bool = False) -> str:
    """Where the ledger is, and whom to trust, in the config of a program of that user; where the others' peers are, too,
    or else its own peer asks them."""
    endpoint, ca = ledger.peer(organisation)
    text = (f'[ledger]\nendpoint = "{endpoint}"\ntls_ca = "{ca}"\nconfig_block = "{ledger.directory}/teleop.block"\nmsp_id = "Org{organisation}MSP"\n'
            f'msp_dir = "{ledger.msp_dir(organisation, user)}"\n')
    if ledger.name == "fabric":
        text += '[[orderer]]\nendpoint = "{}"\ntls_ca = "{}"\n'.format(*ledger.orderer())
    if ledger.name == "fabric" and endorsers:
        text += "".join('[[endorser]]\nmsp_id = "Org{}MSP"\nendpoint = "{}"\ntls_ca = "{}"\n'.format(k, *ledger.endorser(k))
                        for k in (1, 2, 3))
    return text + "".join(f'[[msp]]\nid = "Org{k}MSP"\nca = "{ledger.organisation(k)}/ca/ca.org{k}.ledgerline-cert.pem"\n'
                          for k in (1, 2, 3))


class Authority:
    """Issues certificates by the CA of one organisation, whose key is in the network's directory."""

    def __init__(self, ledger: Ledger, organisation: int, home: pathlib.Path):
        self.organisation = organisation
        self.domain = f"org{organisation}.ledgerline"
        self.certificate = ledger.organisation(organisation) / "ca" / f"ca.{self.domain}-cert.pem"
        self.key = self.certificate.parent / "priv_sk"
        self.home = home
        home.mkdir()
        (home / "index.txt").write_text("")
        (home / "settings").write_text(
            f"[ca]\ndefault_ca=own\n[own]\ndatabase={home}/index.txt\nnew_certs_dir={home}\nrand_serial=yes\n"
            "default_md=sha256\npolicy=names\nx509_extensions=extensions\nunique_subject=no\n"
            "[names]\norganizationName=supplied\norganizationalUnitName=supplied\ncommonName=supplied\n"
            "[extensions]\nbasicConstraints=critical,CA:FALSE\nkeyUsage=critical,digitalSignature\n"
            "authorityKeyIdentifier=keyid\n[list]\nauthorityKeyIdentifier=keyid:always\n")

    def replace_by_own_ca(self) -> None:
        """A CA of the same name with a key of its own: what somebody would make who wants to be taken for it."""
        self.key, certificate = self.home / "ca.key", self.home / "ca.pem"
        openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "10",
                "-subj", f"/O={self.domain}/CN=ca.{self.domain}", "-keyout", self.key, "-out", certificate)
        self.certificate = certificate

    def issue(self, user: str, start: float, end: float | None = None, lasts_s: float = 0, subject: str | None = None) -> dict:
        """A client, or who `subject` says, valid from `start` to `end` (Unix time), or for so long from now on."""
        key, request, certificate = (self.home / f"{user}.{kind}" for kind in ("key", "csr", "pem"))
        openssl("genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-256", "-out", key)
        openssl("req", "-new", "-key", key, "-out", request,
                "-subj", subject or f"/O={self.domain}/OU=client/CN={user}@{self.domain}")
        end = end or time.time() + lasts_s
        openssl("ca", "-batch", "-notext", "-preserveDN", "-config", self.home / "settings", "-in", request,
                "-out", certificate, "-cert", self.certificate, "-keyfile", self.key,
                "-startdate", asn1_time(start), "-enddate", asn1_time(end))
        return {"mspId": f"Org{self.organisation}MSP", "certificate": certificate.read_text(), "key": key.read_text(),
                "end": end}

    def revoke(self, certificate: pathlib.Path, names_key: bool = True) -> str:
        """Its newest list of what it has revoked, as PEM, with this certificate on it and no other; whether it names the key
        that signed it, as Fabric must have it."""
        (self.home / "index.txt").write_text("")
        words = ("-config", self.home / "settings", "-cert", self.certificate, "-keyfile", self.key)
        openssl("ca", *words, "-revoke", certificate)
        return openssl("ca", *words, "-gencrl", "-crldays", "1", *(("-crlexts", "list") if names_key else ()))

    def begin(self) -> float:
        """From when on the CA's own certificate is valid."""
        text = openssl("x509", "-in", self.certificate, "-noout", "-startdate").split("=", 1)[1].strip()
        return time.mktime(time.strptime(text, "%b %d %H:%M:%S %Y %Z")) - time.timezone


def asn1_time(seconds: float) -> str:
    return time.strftime("%Y%m%d%H%M%SZ", time.gmtime(seconds))


def openssl(*arguments) -> str:
    done = subprocess.run(["openssl", *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout
