"""Programs with a participant of Cyclone DDS each, on loopback, that say and hear nothing: crowd.py DOMAIN COUNT."""
import os
import sys
import time

from cyclonedds.domain import Domain, DomainParticipant
from netns import die_with_parent

CONFIG = """<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>119</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""

domain, count = map(int, sys.argv[1:])
for _ in range(count):
    if os.fork() == 0:
        die_with_parent()
        own = Domain(domain, CONFIG)
        participant = DomainParticipant(domain)
        os.write(1, b"there\n")
        time.sleep(3600)
time.sleep(3600)
