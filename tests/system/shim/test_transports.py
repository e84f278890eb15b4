"""The same scripts over UDP and through the shim, in real time: the same order of transitions, setpoints at the same moments."""
import os

import numpy as np
import pytest
from shim import drawn_script, fly

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
PERIOD_S = 0.001  # of link's loop


@pytest.mark.parametrize("seed", range(1, 21 if LONG else 2))
def test_flies_alike(tmp_path, seed):
    script = drawn_script(seed)
    udp, shim = (fly(tmp_path / f"{name}-{seed}", script, udp=name == "udp") for name in ("udp", "shim"))
    drones = {drone for _, drone, _ in udp.reported}
    for drone in drones:
        assert udp.transitions(drone) == shim.transitions(drone), script
        assert shim.transitions(drone)[-1][0] == "landed", script
    one, other = udp.setpoints(), shim.setpoints()
    both = sorted(one.keys() & other.keys())
    assert len(both) > 0.97 * max(len(one), len(other)) and len(both) > 30, (len(both), len(one), len(other))
    apart = np.abs([one[key] - other[key] for key in both])
    print(f"seed {seed}: {len(both)} plans, setpoints apart p50 {np.quantile(apart, 0.5) * 1e3:.3f} ms, "
          f"p99 {np.quantile(apart, 0.99) * 1e3:.3f} ms, {len(shim.summary['transitions'])} transitions")
    assert np.quantile(apart, 0.5) < PERIOD_S
    if LONG:  # of the tail a busy machine tells more than the transport
        assert np.quantile(apart, 0.99) < 2 * PERIOD_S
