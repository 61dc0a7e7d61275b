"""An adversary that attaches to a running SUMO simulation. Nothing here is imported by `import regents_cosim`."""

from regents_cosim.live.adversary import Adversary

__all__ = ["Adversary"]
