"""Three network namespaces at a bridge, as the hosts of one network."""
import pathlib
import subprocess

from netns import Namespace

HOSTS = {k: f"10.77.0.{k}" for k in (1, 2, 3)}


def make_hosts() -> list[Namespace]:
    """Namespaces with an interface each at a bridge in this one."""
    ip = lambda words: subprocess.run(["ip", *words.split()], check=True)
    ip("link add hosts type bridge")
    ip("link set hosts up")
    spaces = []
    for k, address in HOSTS.items():
        space = Namespace()
        ip(f"link add host{k} type veth peer name eth0 netns {space.holder.pid}")
        ip(f"link set host{k} master hosts up")
        space.run("ip", "addr", "add", f"{address}/24", "dev", "eth0")
        space.run("ip", "link", "set", "eth0", "up")
        spaces.append(space)
    return spaces


def network_config(folder: pathlib.Path) -> pathlib.Path:
    """The network's settings, with one organisation and one orderer at each host."""
    config = folder / "net.toml"
    config.write_text("batch_count = 1\n" + "".join(
        f'[[{table}]]\nhost = "{address}"\nport = {port}\n'
        for table, port in (("organisation", 7051), ("orderer", 7061)) for address in HOSTS.values()))
    return config
