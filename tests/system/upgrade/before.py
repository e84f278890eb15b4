"""An installation of the version before: its contract (version_before.cpp), deployed as it did, which is by any one peer's endorsement."""
import pathlib
import shutil

from fabric import BIN, FABRIC

ANY_PEER = "OR('Org1MSP.peer','Org2MSP.peer','Org3MSP.peer')"


def write_script(path: pathlib.Path, text: str) -> None:
    path.unlink(missing_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


class Before:
    def __init__(self, home: pathlib.Path):
        installed, self.tools = home / "installed", home / "tools"
        for folder in (installed, self.tools):
            folder.mkdir()
        for folder in ("bin", "libexec/ledgerline"):
            (installed / folder).mkdir(parents=True)
        self.fabric = shutil.copy(BIN.parent / "libexec/ledgerline/ledgerline-ledger", installed / "libexec/ledgerline")
        self.contract = installed / "bin/ledgerline-chaincode"
        self.contract.symlink_to(BIN / "version_before")
        for tool in FABRIC.iterdir():
            (self.tools / tool.name).symlink_to(tool)
        # Its definitions were all called "1".
        write_script(self.tools / "peer", 'for word; do shift; [ "$last" != --version ] || word=1; set -- "$@" "$word"; last=$word; done\n'
                                          f'exec {FABRIC}/peer "$@"')

    def command(self, _program, *words) -> list:
        """What a Network of today is started with, as a network of before."""
        return [self.fabric, *(self.tools if word == FABRIC else word for word in words), "--signature-policy", ANY_PEER]

    def update(self, *directories: pathlib.Path) -> None:
        """Today's programs take the place of these; their networks run on."""
        for directory in directories:
            (directory / "done" / "contract-teleop").write_text("")  # as it was left
        new = self.contract.with_suffix(".new")
        new.symlink_to(BIN / "ledgerline-chaincode")
        new.rename(self.contract)
