"""Runs code when a libsumo simulation is closed, which libsumo does not report to step listeners.

libsumo (1.24 and 1.28) keeps the arguments of `moveToXY` beyond the end of the simulation. If the next one in the
process has a vehicle of that name at its first step, libsumo accesses the vehicle that is gone, and the process dies.
One step of a simulation without vehicles makes libsumo forget them.

`libsumo.close` itself is not replaced, since it has several names (`traci.close` where traci stands for libsumo). It
ends by closing libsumo's manager of step listeners; that call is wrapped here.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from regents_cosim.plain_text import printable

_EMPTY = """<net version="1.20">
    <location netOffset="0,0" convBoundary="0,0,10,0" origBoundary="0,0,10,0" projParameter="!"/>
    <edge id="e" from="a" to="b" priority="1"><lane id="e_0" index="0" speed="1" length="10" shape="0,0 10,0"/></edge>
    <junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0"/>
    <junction id="b" type="dead_end" x="10" y="0" incLanes="e_0" intLanes="" shape="10,0"/>
</net>
"""
_QUIET = ("--no-step-log", "true", "--no-warnings", "true")


class _Closing:
    """Wraps the last call of `libsumo.close` and calls the registered functions after it."""

    def __init__(self, libsumo: Any) -> None:
        self._libsumo, self._close = libsumo, libsumo._stepManager.close
        self.told: list[Callable[[], None]] = []
        self.shown = False  # with sumo-gui, which ends with its process

    def __call__(self, *given: Any, **named: Any) -> None:
        """Call libsumo's own function, then the registered ones; exceptions of these are printed, not raised."""
        self._close(*given, **named)
        for tell in (*self.told, *(() if self.shown else (self._forget,))):
            try:
                tell()
            except Exception as error:
                said = f"regents_cosim: after libsumo.close: {type(error).__name__}: {error}"
                print(printable(said), file=sys.stderr)

    def _forget(self) -> None:
        libsumo = self._libsumo
        with tempfile.TemporaryDirectory() as folder:
            net = Path(folder) / "empty.net.xml"
            net.write_text(_EMPTY)
            libsumo.simulation.start(["sumo", "-n", str(net), *_QUIET])
            libsumo._libsumo_step(0.0)  # not `simulationStep`, which would call the listeners of the previous run
            libsumo.simulation.close()


def tell_at_close(connection: Any, *tell: Callable[[], None]) -> None:
    """Register functions to call whenever libsumo's simulation was closed; libsumo then also forgets its moves (0.01
    s).

    Does nothing for connections of traci, which tell their listeners and simulate in separate processes, or for a
    libsumo without a manager of step listeners.
    """
    if not is_libsumo(connection):
        return
    libsumo = sys.modules["libsumo"]  # `traci` may be an alias of it
    manager = getattr(libsumo, "_stepManager", None)
    if manager is None:
        return
    if not isinstance(manager.close, _Closing):
        manager.close = _Closing(libsumo)
    manager.close.shown = bool(libsumo.simulation.isLoaded() and libsumo.simulation.hasGUI())
    manager.close.told += [one for one in tell if one not in manager.close.told]


def is_libsumo(connection: Any) -> bool:
    """Whether a connection is libsumo, under whatever name: it runs one simulation in this process."""
    return bool(getattr(connection, "isLibsumo", bool)())
