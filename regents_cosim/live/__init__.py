"""Attacks in a running SUMO simulation. `import regents_cosim` imports nothing of this."""

from regents_cosim.live.adversary import Adversary

__all__ = ["Adversary"]
