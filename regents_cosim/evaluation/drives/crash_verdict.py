"""What is known of one crash of one driver, and its urgency."""

from dataclasses import dataclass

from regents_cosim.judgement import Blamed, Escape, Flaw

_BLAME: dict[Blamed | None, int] = {"ego": 0, "both": 0, "nobody": 1, None: 1, "adversary": 2}


@dataclass(frozen=True)
class CrashVerdict:
    """What is known of one crash of one driver; fields are None where it is not judged."""

    at_fault: Blamed | None
    rule: str | None
    escape: Escape | None  # whether the driver could have avoided it
    clean: bool
    telling: bool | None = None
    flawless: bool | None = None
    words: str = ""  # both grades in sentences, for people
    advice: str | None = None  # what a reference driver does instead
    offences: tuple[str, ...] | None = None  # of the adversary
    ego_offences: tuple[str, ...] | None = None
    preventable_by: tuple[str, ...] | None = None  # reference drivers that avoid it by braking
    flaws: tuple[Flaw, ...] = ()  # what spoils it as a test

    @property
    def actionable(self) -> bool:
        """Whether the crash is clean, and the driver could have avoided it."""
        return self.clean and self.avoidable is True

    @property
    def from_behind(self) -> bool:
        """Whether another road user drove into the ego's back, as one on a fixed track does when the ego brakes."""
        return not {Flaw.REAR_ENDS_EGO, Flaw.FROM_BEHIND}.isdisjoint(self.flaws)

    @property
    def blame(self) -> int:
        """0 where the planner is to blame, alone or with others; 1 where that is open; 2 where the adversary is."""
        return _BLAME[self.at_fault]

    @property
    def avoidable(self) -> bool | None:
        """Whether a drive is known that avoids the crash; None where it is not judged."""
        return None if self.escape is None else self.escape not in ("never", "unknown")

    @property
    def in_time(self) -> bool | None:
        """Whether a reaction to what was visible avoids the crash; None where that is not known."""
        return None if self.escape in (None, "avoidable") else self.escape == "in time"
