"""The contract onto a network that is nobody's of Ledgerline, by `ledgerline contract` alone, and a flight over it."""
import os
import time

import pytest
from bringing import bring_contract, consortium, enrol, ledger_file
from flights import (POSES, SAFE, assert_nothing_left, deployment, fly, no_flight_outlives_its_test, printed, result,
                     somebody_elses_drones)

LONG = os.environ.get("LEDGERLINE_LONG") == "1"


@pytest.mark.parametrize("way", ["direct", pytest.param("gateway", marks=pytest.mark.skipif(not LONG, reason="LEDGERLINE_LONG=1"))])
def test_a_contract_and_a_flight_on_a_network_of_outsiders(tmp_path, way):
    with consortium(tmp_path / "network") as network:
        began = time.monotonic()
        bring_contract(network)
        print(f"the contract is there after {time.monotonic() - began:.1f} s", flush=True)
        enrol(network)
        names = "".join(f'{name} = "{ledger_file(network, k, user, whole, way == "direct")}"\n' for name, k, user, whole in
                        (("agent", 1, "User1", True), ("ground", 2, "User1", True), ("admin", 1, "Admin", False)))
        file = deployment(tmp_path, POSES + SAFE + f'[flight]\nside_m = 0.8\nlaps = 1\n[ledger]\nkind = "existing"\n{names}')
        with somebody_elses_drones(tmp_path):
            flight = fly(tmp_path, "--deployment", file)
            code = flight.wait(300)
            print(printed(tmp_path), flush=True)
            assert code == 0
        report = result(tmp_path)
        assert "a command may come 4 s later" in (tmp_path / "run" / "agent.log").read_text()
        assert report["ok"] is True and len(report["drones"][0]["lap_s"]) == 1
    assert_nothing_left()
