"""A Fabric network as fabric-samples would have it, of openssl and Fabric's own programs alone: org1.example.com and
org2.example.com on mychannel, MAJORITY, blocks after 2 s or 10 transactions, client certificates wanted everywhere, no history
database. Org2 has P-384 keys and intermediate authorities, for identities and TLS, and fablo's key names."""
import contextlib
import os
import pathlib
import socket
import subprocess
import time

from ledgers import openssl

TIMEOUT_S = 60  # not a limit on speed: only how long a broken network may take
NODE_OUS = "NodeOUs:\n  Enable: true\n" + "".join(
    f"  {key}OUIdentifier: {{OrganizationalUnitIdentifier: {ou}}}\n"
    for key, ou in (("Client", "client"), ("Peer", "peer"), ("Admin", "admin"), ("Orderer", "orderer")))


def free_ports(count: int) -> list[int]:
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


class Authority:
    """A root, or what an authority above has signed; `chain`: its certificates up to the root, without that."""

    def __init__(self, folder: pathlib.Path, name: str, curve: str, above: "Authority | None" = None):
        self.folder, self.curve = folder, curve
        folder.mkdir(parents=True, exist_ok=True)
        self.key, self.certificate = folder / f"{name}.key", folder / f"{name}.pem"
        openssl("ecparam", "-name", curve, "-genkey", "-noout", "-out", self.key)
        issue(self.key, self.certificate, f"/O=example/CN={name}", above or self,
              "basicConstraints=critical,CA:TRUE\nkeyUsage=critical,keyCertSign,cRLSign\nsubjectKeyIdentifier=hash\n")
        self.root = above.root if above else self
        self.chain = self.certificate.read_text() + above.chain if above else ""


def issue(key: pathlib.Path, certificate: pathlib.Path, subject: str, above: Authority, extensions: str) -> None:
    request, extra = certificate.with_suffix(".csr"), certificate.with_suffix(".ext")
    extra.write_text(extensions)
    openssl("req", "-new", "-key", key, "-subj", subject, "-out", request)
    signs = ["-signkey", key] if key == above.key else ["-CA", above.certificate, "-CAkey", above.key, "-CAcreateserial"]
    openssl("x509", "-req", "-in", request, *signs, "-days", "30", "-sha256", "-extfile", extra, "-out", certificate)


class Organisation:
    """cryptogen's layout below `folder`."""

    def __init__(self, folder: pathlib.Path, msp_id: str, domain: str, curve: str = "prime256v1", intermediate: bool = False,
                 key_name: str = "priv_sk"):
        self.folder, self.msp_id, self.domain, self.curve, self.key_name = folder, msp_id, domain, curve, key_name
        self.ca, self.tlsca = (Authority(folder / kind, f"{kind}.{domain}", curve) for kind in ("ca", "tlsca"))
        if intermediate:
            self.ca = Authority(folder / "ica", f"ica.{domain}", curve, self.ca)
            self.tlsca = Authority(folder / "tlsica", f"tlsica.{domain}", curve, self.tlsca)
        self.msp = self._msp(folder / "msp")

    def _msp(self, msp: pathlib.Path) -> pathlib.Path:
        for kind, authority in (("", self.ca), ("tls", self.tlsca)):
            (msp / f"{kind}cacerts").mkdir(parents=True)
            (msp / f"{kind}cacerts" / "root.pem").write_text(authority.root.certificate.read_text())
            if authority.chain:
                (msp / f"{kind}intermediatecerts").mkdir()
                (msp / f"{kind}intermediatecerts" / "intermediate.pem").write_text(authority.certificate.read_text())
        (msp / "config.yaml").write_text(NODE_OUS)
        return msp

    def member(self, kind: str, name: str, unit: str) -> pathlib.Path:
        """Its folder, with msp/ and tls/."""
        own = self.folder / kind / name
        msp, tls = self._msp(own / "msp"), own / "tls"
        for folder in (msp / "signcerts", msp / "keystore", tls):
            folder.mkdir(parents=True)
        for key, certificate, above, extensions in (
                (msp / "keystore" / self.key_name, msp / "signcerts" / "cert.pem", self.ca, "keyUsage=critical,digitalSignature\n"),
                (tls / "server.key", tls / "server.crt", self.tlsca,
                 "keyUsage=critical,digitalSignature\nextendedKeyUsage=serverAuth,clientAuth\n"
                 f"subjectAltName=DNS:{name},DNS:localhost\n")):
            openssl("ecparam", "-name", self.curve, "-genkey", "-noout", "-out", key)
            key.chmod(0o600)
            issue(key, certificate, f"/O={self.domain}/OU={unit}/CN={name}", above,
                  extensions + "basicConstraints=critical,CA:FALSE\nauthorityKeyIdentifier=keyid\n")
            for left_over in certificate.parent.glob("*.[ce][sx][rt]"):
                left_over.unlink()
        (tls / "server.crt").write_text((tls / "server.crt").read_text() + self.tlsca.chain)
        (tls / "ca.crt").write_text(self.tlsca.root.certificate.read_text())
        return own


class Consortium:
    def __init__(self, directory: pathlib.Path, fabric: pathlib.Path):
        self.directory, self.fabric, self.processes = directory, fabric, []
        self.started: dict[str, tuple] = {}  # by name: the process, how it was started
        self.ordering = Organisation(directory / "crypto" / "example.com", "OrdererMSP", "example.com")
        self.org1 = Organisation(directory / "crypto" / "org1.example.com", "Org1MSP", "org1.example.com")
        self.org2 = Organisation(directory / "crypto" / "org2.example.com", "Org2MSP", "org2.example.com", "secp384r1",
                                 intermediate=True, key_name="priv-key.pem")
        self.organisations = (self.org1, self.org2)
        self.orderer = self.ordering.member("orderers", "orderer.example.com", "orderer")
        self.peers = [org.member("peers", f"peer0.{org.domain}", "peer") for org in self.organisations]
        self.users = {(k, name): org.member("users", f"{name}@{org.domain}", "admin" if name == "Admin" else "client")
                      for k, org in enumerate(self.organisations, 1) for name in ("Admin", "User1")}
        self.services = [org.member("services", f"ledgerline.{org.domain}", "client") for org in self.organisations]
        self.orderer_port, self.admin_port, *ports = free_ports(8)
        self.peer_ports, self.peer_chaincode_ports, self.service_ports = ports[:2], ports[2:4], ports[4:6]
        self.tls_roots = [org.tlsca.root.certificate for org in (self.ordering, *self.organisations)]
        self.block = directory / "mychannel.block"

    def _configtx(self) -> str:
        def organisation(org: Organisation, more: str) -> str:
            return (f"  - &{org.msp_id}\n    Name: {org.msp_id}\n    ID: {org.msp_id}\n    MSPDir: {org.msp}\n    Policies:\n"
                    + "".join(f"      {name}: {{Type: Signature, Rule: \"OR('{org.msp_id}.{role}')\"}}\n" for name, role in
                              (("Readers", "member"), ("Writers", "member"), ("Admins", "admin"), ("Endorsement", "peer"))) + more)

        def policies(indent: int, *more: str) -> str:
            return "".join(" " * indent + f'{name}: {{Type: ImplicitMeta, Rule: "{rule}"}}\n' for name, rule in (
                ("Readers", "ANY Readers"), ("Writers", "ANY Writers"), ("Admins", "MAJORITY Admins"), *more))

        tls = self.orderer / "tls" / "server.crt"
        peers = "".join(organisation(org, f"    AnchorPeers:\n      - {{Host: localhost, Port: {port}}}\n")
                        for org, port in zip(self.organisations, self.peer_ports))
        return (f"Organizations:\n{organisation(self.ordering, f'    OrdererEndpoints:{chr(10)}      - localhost:{self.orderer_port}{chr(10)}')}"
                f"{peers}Profiles:\n  Channel:\n    Policies:\n{policies(6)}    Capabilities: {{V2_0: true}}\n    Orderer:\n"
                "      OrdererType: etcdraft\n      BatchTimeout: 2s\n"
                "      BatchSize: {MaxMessageCount: 10, AbsoluteMaxBytes: 99 MB, PreferredMaxBytes: 512 KB}\n      EtcdRaft:\n"
                f"        Consenters:\n          - {{Host: localhost, Port: {self.orderer_port}, ClientTLSCert: {tls}, ServerTLSCert: {tls}}}\n"
                f"      Organizations: [*OrdererMSP]\n      Policies:\n{policies(8, ('BlockValidation', 'ANY Writers'))}"
                "      Capabilities: {V2_0: true}\n    Application:\n      Organizations: [*Org1MSP, *Org2MSP]\n      Policies:\n"
                + policies(8, ("LifecycleEndorsement", "MAJORITY Endorsement"), ("Endorsement", "MAJORITY Endorsement"))
                + "      Capabilities: {V2_5: true}\n")

    def run(self, *words, environment: dict | None = None) -> str:
        done = subprocess.run([self.fabric / words[0], *words[1:]], capture_output=True, text=True,
                              env={**os.environ, **(environment or {})})
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def until_good(self, *words, environment: dict | None = None) -> str:
        deadline = time.monotonic() + TIMEOUT_S
        while True:
            try:
                return self.run(*words, environment=environment)
            except AssertionError:
                if time.monotonic() > deadline:
                    raise
            time.sleep(0.2)

    def start(self, name: str, command: list, environment: dict) -> None:
        with open(self.directory / f"{name}.log", "a") as log:
            process = subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, **environment})
        self.processes.append(process)
        self.started[name] = process, command, environment

    @contextlib.contextmanager
    def without(self, name: str):
        """One of its programs ends, and starts again."""
        process, command, environment = self.started[name]
        process.terminate()
        process.wait(TIMEOUT_S)
        self.processes.remove(process)
        try:
            yield
        finally:
            self.start(name, command, environment)

    def _tls(self, prefix: str, own: pathlib.Path) -> dict:
        return {f"{prefix}_ENABLED": "true", f"{prefix}_PRIVATEKEY": f"{own}/tls/server.key", f"{prefix}_CERTIFICATE": f"{own}/tls/server.crt",
                f"{prefix}_ROOTCAS": f"[{own}/tls/ca.crt]", f"{prefix}_CLIENTAUTHREQUIRED": "true",
                f"{prefix}_CLIENTROOTCAS": f"[{','.join(map(str, self.tls_roots))}]"}

    def peer_environment(self, k: int, who: pathlib.Path | None = None) -> dict:
        """Of the peer itself, or of a user of its organisation at it."""
        own = who or self.peers[k - 1]
        return {"FABRIC_CFG_PATH": str(self.fabric / "config"), "FABRIC_LOGGING_SPEC": "warn",
                "CORE_PEER_ADDRESS": f"localhost:{self.peer_ports[k - 1]}", "CORE_PEER_LOCALMSPID": f"Org{k}MSP",
                "CORE_PEER_MSPCONFIGPATH": str(own / "msp"), "CORE_PEER_TLS_ENABLED": "true",
                "CORE_PEER_TLS_KEY_FILE": str(own / "tls/server.key"), "CORE_PEER_TLS_CERT_FILE": str(own / "tls/server.crt"),
                "CORE_PEER_TLS_ROOTCERT_FILE": str(own / "tls/ca.crt"), "CORE_PEER_TLS_CLIENTAUTHREQUIRED": "true",
                "CORE_PEER_TLS_CLIENTKEY_FILE": str(own / "tls/server.key"), "CORE_PEER_TLS_CLIENTCERT_FILE": str(own / "tls/server.crt"),
                "CORE_PEER_TLS_CLIENTROOTCAS_FILES": " ".join(map(str, self.tls_roots))}

    def up(self) -> None:
        config = self.directory / "configtx"
        config.mkdir()
        (config / "configtx.yaml").write_text(self._configtx())
        self.run("configtxgen", "-profile", "Channel", "-channelID", "mychannel", "-outputBlock", self.block, "-configPath", config)
        tls = self.orderer / "tls"
        cluster = "ORDERER_GENERAL_CLUSTER"
        self.start("orderer", [self.fabric / "orderer"], {
            "FABRIC_CFG_PATH": str(self.fabric / "config"), "FABRIC_LOGGING_SPEC": "warn", "ORDERER_GENERAL_LISTENADDRESS": "127.0.0.1",
            "ORDERER_GENERAL_LISTENPORT": str(self.orderer_port), "ORDERER_GENERAL_LOCALMSPID": "OrdererMSP",
            "ORDERER_GENERAL_LOCALMSPDIR": str(self.orderer / "msp"), "ORDERER_GENERAL_BOOTSTRAPMETHOD": "none",
            **self._tls("ORDERER_GENERAL_TLS", self.orderer), **self._tls("ORDERER_ADMIN_TLS", self.orderer),
            f"{cluster}_CLIENTPRIVATEKEY": f"{tls}/server.key", f"{cluster}_CLIENTCERTIFICATE": f"{tls}/server.crt",
            f"{cluster}_ROOTCAS": f"[{tls}/ca.crt]", "ORDERER_CHANNELPARTICIPATION_ENABLED": "true",
            "ORDERER_ADMIN_LISTENADDRESS": f"127.0.0.1:{self.admin_port}", "ORDERER_OPERATIONS_LISTENADDRESS": "127.0.0.1:0",
            "ORDERER_FILELEDGER_LOCATION": f"{self.directory}/orderer/ledger", "ORDERER_CONSENSUS_WALDIR": f"{self.directory}/orderer/wal",
            "ORDERER_CONSENSUS_SNAPDIR": f"{self.directory}/orderer/snapshots"})
        builder = self.directory / "ccaas_builder" / "bin"
        builder.mkdir(parents=True)
        for name, script in (("detect", "grep -q ccaas \"$2/metadata.json\""), ("build", 'cp "$1/connection.json" "$3/"'),
                             ("release", 'mkdir -p "$2/chaincode/server" && cp "$1/connection.json" "$2/chaincode/server/"')):
            (builder / name).write_text(f"#!/bin/sh\n{script}\n")
            (builder / name).chmod(0o755)
        for k, peer in enumerate(self.peers, 1):
            address, data = f"localhost:{self.peer_ports[k - 1]}", self.directory / f"peer{k}"
            self.start(f"peer{k}", [self.fabric / "peer", "node", "start"], {
                **self.peer_environment(k), "CORE_PEER_ID": peer.name, "CORE_PEER_LISTENADDRESS": address.replace("localhost", "127.0.0.1"),
                "CORE_PEER_CHAINCODELISTENADDRESS": f"127.0.0.1:{self.peer_chaincode_ports[k - 1]}",
                "CORE_PEER_FILESYSTEMPATH": str(data), "CORE_LEDGER_SNAPSHOTS_ROOTDIR": f"{data}/snapshots",
                "CORE_LEDGER_HISTORY_ENABLEHISTORYDATABASE": "false", "CORE_PEER_GOSSIP_BOOTSTRAP": address,
                "CORE_PEER_GOSSIP_EXTERNALENDPOINT": address, "CORE_VM_ENDPOINT": "",
                "CORE_CHAINCODE_EXTERNALBUILDERS": f"[{{name: ccaas, path: {builder.parent}, propagateEnvironment: []}}]",
                "CORE_OPERATIONS_LISTENADDRESS": "127.0.0.1:0"})
        self.until_good("osnadmin", "channel", "list", "-o", f"localhost:{self.admin_port}", "--ca-file", tls / "ca.crt",
                        "--client-cert", tls / "server.crt", "--client-key", tls / "server.key")
        self.run("osnadmin", "channel", "join", "--channelID", "mychannel", "--config-block", self.block, "-o", f"localhost:{self.admin_port}",
                 "--ca-file", tls / "ca.crt", "--client-cert", tls / "server.crt", "--client-key", tls / "server.key")
        for k in (1, 2):
            self.until_good("peer", "channel", "join", "-b", self.block, environment=self.peer_environment(k, self.users[k, "Admin"]))
        self.until_good("peer", "channel", "fetch", "newest", self.directory / "newest.block", "-c", "mychannel", "-o",
                        f"localhost:{self.orderer_port}", "--tls", "--cafile", tls / "ca.crt", "--clientauth", "--certfile",
                        self.users[1, "Admin"] / "tls/server.crt", "--keyfile", self.users[1, "Admin"] / "tls/server.key",
                        environment=self.peer_environment(1, self.users[1, "Admin"]))  # it answers once there is a leader

    def down(self) -> None:
        for process in self.processes:
            process.terminate()
        for process in self.processes:
            process.wait(TIMEOUT_S)

    def logs(self) -> str:
        return "\n".join(f"{log.name}:\n{log.read_text()[-1500:]}" for log in sorted(self.directory.glob("*.log")))
