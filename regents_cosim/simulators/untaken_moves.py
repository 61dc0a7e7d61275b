"""Moves that a libsumo simulation was told to make, and did not, since it was closed before its next step.

libsumo (1.24 and 1.28) keeps what `moveToXY` was told beyond the end of the simulation. If the next one in the process
has a vehicle of that name at its first step, libsumo reaches for the vehicle that is gone, and the process dies. A step
of a simulation without vehicles lets it forget them.
"""

import tempfile
from functools import wraps
from pathlib import Path
from typing import Any

_EMPTY = """<net version="1.20">
    <location netOffset="0,0" convBoundary="0,0,10,0" origBoundary="0,0,10,0" projParameter="!"/>
    <edge id="e" from="a" to="b" priority="1"><lane id="e_0" index="0" speed="1" length="10" shape="0,0 10,0"/></edge>
    <junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0"/>
    <junction id="b" type="dead_end" x="10" y="0" incLanes="e_0" intLanes="" shape="10,0"/>
</net>
"""
_FORGETS = "forgets_untaken_moves"  # marks a `close` as ours: other wrappers of it do not forget
_QUIET = ("--no-step-log", "true", "--no-warnings", "true")


def forget_at_close(connection: Any) -> None:
    """Let `libsumo.close` forget them, from now on: that takes a hundredth of a second more.

    Nothing is done the second time, and for connections of traci, whose simulations are processes of their own.
    """
    if not getattr(connection, "isLibsumo", bool)() or hasattr(connection.close, _FORGETS):
        return
    libsumo, close = connection, connection.close

    @wraps(close)
    def closed() -> None:
        shown = libsumo.simulation.isLoaded() and libsumo.simulation.hasGUI()
        close()
        if not shown:  # sumo-gui ends with its process
            _forget(libsumo)

    setattr(closed, _FORGETS, True)
    libsumo.close = closed


def _forget(libsumo: Any) -> None:
    with tempfile.TemporaryDirectory() as folder:
        net = Path(folder) / "empty.net.xml"
        net.write_text(_EMPTY)
        libsumo.simulation.start(["sumo", "-n", str(net), *_QUIET])
        libsumo._libsumo_step(0.0)  # not `simulationStep`: the listeners of the run before hear of that
        libsumo.simulation.close()
