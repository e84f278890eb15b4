"""One network on three hosts: three network namespaces at a bridge, one organisation with its orderer in each."""
import json
import pathlib
import shutil

from fabric import FABRIC, Network, Peer, fabric, needs_fabric
from three_hosts import HOSTS, make_hosts, network_config


def private_keys(folder: pathlib.Path) -> set[str]:
    """Files below it with a private key in them, whatever their names."""
    return {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file() and b"PRIVATE KEY" in file.read_bytes()}


def keys_of_host(k: int) -> set[str]:
    organisation = f"crypto/peerOrganizations/org{k}.ledgerline"
    orderer = f"crypto/ordererOrganizations/ledgerline/orderers/orderer{'' if k == 1 else k}.ledgerline"
    users = [f"{organisation}/users/{user}@org{k}.ledgerline" for user in ("Admin", "User1", "User2")]
    peers = [f"{organisation}/peers/{name}.org{k}.ledgerline" for name in ("peer0", "endorser0")]
    return {f"{member}/msp/keystore/priv_sk" for member in (*peers, orderer, *users)} | {
        f"{server}/tls/server.key" for server in (*peers, orderer)} | {
        f"{user}/tls/client.key" for user in users} | {f"{organisation}/chaincode/tls/server.key"}


# Of nobody's host: who has them can make orderers, peers and users, or change the channels' settings.
KEPT = {f"crypto/{organisation}/{authority}/priv_sk" for authority in ("ca", "tlsca")
        for organisation in ("ordererOrganizations/ledgerline", *(f"peerOrganizations/org{k}.ledgerline" for k in HOSTS))} | {
    f"crypto/ordererOrganizations/ledgerline/users/Admin@ledgerline/{key}" for key in ("msp/keystore/priv_sk", "tls/client.key")}


def test_a_transaction_through_each_host_is_read_at_the_others(tmp_path):
    needs_fabric()
    config = network_config(tmp_path)
    made = fabric("identities", "--config", config, "--dir", tmp_path / "made", "--tools", FABRIC)
    assert made.returncode == 0, made.stderr
    assert private_keys(tmp_path / "made" / "authority") == KEPT.union(*map(keys_of_host, HOSTS))
    for k, address in HOSTS.items():
        assert private_keys(tmp_path / "made" / f"host-{address}") == keys_of_host(k)
        shutil.copytree(tmp_path / "made" / f"host-{address}", tmp_path / f"host{k}")
    spaces = make_hosts()
    networks, peers = [], []
    try:
        for k, space in enumerate(spaces, 1):
            networks.append(Network(tmp_path / f"host{k}", "--config", config, "--only", f"org{k}", "--only", f"orderer{k}",
                                    command=space.command))
        for k, (space, network) in enumerate(zip(spaces, networks), 1):
            ready = network.wait_ready().ready
            assert ready["endpoint"] == f"{HOSTS[k]}:7051"
            assert [p["name"] for p in ready["processes"]] == [f"orderer{k}", f"peer{k}", f"chaincode{k}"]
            peers.append(Peer(network.directory, ready["endpoint"], k, f"{HOSTS[k]}:7061", command=space.command, peers=ready["peers"]))
        for k, peer in enumerate(peers, 1):
            identifier = f"Org{k}MSP/note"
            peer.invoke("teleop", "set", json.dumps({"id": identifier, "msgType": f"from host {k}"}))
            for other in peers:
                other.wait_for("teleop", f'"from host {k}"', "get", identifier)
        # A host that ends and comes again catches up.
        networks[2].stop()
        peers[0].invoke("teleop", "set", json.dumps({"id": "Org1MSP/note", "msgType": "while host 3 was away"}))
        networks[2] = Network(tmp_path / "host3", "--config", config, "--only", "org3", "--only", "orderer3",
                              command=spaces[2].command).wait_ready()
        peers[2].wait_for("teleop", '"while host 3 was away"', "get", "Org1MSP/note")
        for network in networks:
            network.stop()
        for k in HOSTS:  # beside these a peer's builder has made a file with its own pair
            more = private_keys(tmp_path / f"host{k}") - keys_of_host(k)
            assert all(name.startswith(f"peer{k}/externalbuilder/") for name in more) and len(more) == 1, more
    finally:
        for network in networks:
            network.process.kill()
        for space in spaces:
            space.close()


def test_identities_without_places_are_refused(tmp_path):
    done = fabric("identities", "--dir", tmp_path / "net", "--tools", FABRIC)
    assert done.returncode == 2 and "give all addresses" in done.stderr
    assert not (tmp_path / "net").exists()


def test_a_host_without_the_common_identities_is_reported_so(tmp_path):
    config = tmp_path / "net.toml"
    config.write_text("".join(f'[[{table}]]\nhost = "127.0.0.1"\nport = {port + 10 * k}\n'
                              for table, port in (("organisation", 7051), ("orderer", 7151)) for k in (1, 2, 3)))
    done = fabric("up", "--config", config, "--dir", tmp_path / "net", "--tools", FABRIC, "--only", "org1")
    assert done.returncode == 1
    assert "crypto is missing" in done.stderr and "ledgerline fabric identities" in done.stderr
