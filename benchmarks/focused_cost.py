"""The cost of `focused` alone, from the log, for any clean crash: for figures, and for scenes without lanes."""

from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED

FOCUSED_COST = REGENTS_FOCUSED.but(
    adversary_may="anything", driving="any", accept="clean", starts=0, attempts=1, sampled=0, near_m=0.0
)
