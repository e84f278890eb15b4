"""Flights on an embedded node that lies with the key of the drones' own peer (tests/system/relay/lying_node.cpp)."""
import json
import os
import pathlib

import pytest
from trace_file import Record, TraceKind, records

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
CUT = 4  # FailsafeMode


@pytest.fixture
def lying_programs(tmp_path, monkeypatch):
    """The programs of this build, with one that lies in the node's place."""
    programs = tmp_path / "bin"
    programs.mkdir()
    for program in BIN.iterdir():
        if program.name != "ledgerline-node":
            (programs / program.name).symlink_to(program)
    (programs / "ledgerline-node").symlink_to(BIN / "lying_node")
    monkeypatch.setenv("LEDGERLINE_BIN", str(programs))
    monkeypatch.setenv("LYING_NODE", str(BIN / "ledgerline-node"))
    monkeypatch.setenv("LYING_LOG", str(tmp_path / "lies.json"))
    return tmp_path


class Flown:
    """What a flight left behind."""

    def __init__(self, folder: pathlib.Path):
        run = folder / "flight" / "run"
        self.lies = json.loads((folder / "lies.json").read_text())
        self.lives = [list(records(trace)) for trace in run.glob("link*.trace")]
        self.link = sorted(r for life in self.lives for r in life)
        self.applied = [r for r in self.link if r.kind == TraceKind.COMMAND_APPLIED and r.id != 0]
        self.truth = [r for r in records(run / "sim.trace") if r.kind == TraceKind.TRUTH]

    def unsigned(self) -> list[Record]:
        """Plans that link flew, and that nobody asked for, or that a tampered event reported: by number and their state's stamp."""
        asked = {tuple(plan) for plan in self.lies["asked"]}
        reported = {tuple(plan) for plan in self.lies["reported"]}
        return [r for r in self.applied if (r.id, r.stamp_ns) not in asked or (r.id, r.stamp_ns) in reported]

    def cuts(self) -> list[Record]:
        return [r for r in self.link if r.kind == TraceKind.MODE and r.extra == CUT]
