"""Judgements in words, for the terminal, for failing tests and for the report."""

from collections.abc import Sequence

from regents_cosim.judgement import UNLAWFUL, Judgement, Offence, ReferenceDrive, ReferenceDriver

DRIVERS: dict[ReferenceDriver, str] = {
    "careful": "a careful driver (UN R157)",
    "fuzzy": "the fuzzy safety model (JRC)",
    "rss": "RSS's proper response",
}


def telling_words(judgement: Judgement) -> str:
    """Whether a crash is telling, and the reason if not."""
    if judgement.telling:
        return "yes: clean, by a lawful adversary, and a careful driver avoids it"
    if judgement.guessed:
        return f"not known: the heading of {', '.join(judgement.guessed)} is a guess"
    if not judgement.clean:
        return "no: something spoils it as a test"
    if judgement.law is not None and judgement.law.lawful is False:
        return "no: the adversary breaks the law"
    if _drove(judgement, "careful") and "careful" not in judgement.preventable_by:
        return "no: a careful driver crashes too"
    missing = [] if judgement.law and judgement.law.lawful is not None else ["whether the adversary keeps the law"]
    missing += [] if _drove(judgement, "careful") else ["what a careful driver does"]
    return f"not known: {' and '.join(missing)}"


def advice(judgement: Judgement) -> str | None:
    """What the planner should have done and when, by a reference driver; None where none was tried."""
    drives = {drive.driver: drive for drive in judgement.drivers}
    avoiding = [drives[name] for name in DRIVERS if name in drives and drives[name].avoids]
    if avoiding:
        return drive_words(avoiding[0])
    if not drives:
        return None
    proven = ", and it is proven that no drive does once there is something to see" if judgement.unavoidable else ""
    return f"no reference driver avoids it ({', '.join(name for name in DRIVERS if name in drives)}){proven}"


def drive_words(drive: ReferenceDrive) -> str:
    """What a reference driver does, and how it ends."""
    acts = "goes on as the planner did" if drive.acts_s is None else braking_words(drive.shift_m)
    since = "" if drive.acts_s is None else f" from {drive.acts_s:.1f} s"
    ends = "avoids it" if drive.avoids else "crashes"
    return f"{DRIVERS[drive.driver]} {acts}{since} and {ends}{behind_words(drive.rear_ended_by)}"


def braking_words(shift_m: float) -> str:
    """What a reference driver does about a danger: it brakes, and may swerve by `shift_m` [m], positive to the left."""
    side = "left" if shift_m > 0 else "right"
    return f"brakes and swerves {abs(shift_m):.1f} m to the {side}" if shift_m else "brakes"


def behind_words(names: Sequence[str]) -> str:
    """The agents that replay their log into its back, in brackets; empty where there are none."""
    return f" ({', '.join(names)}, replaying a log, runs into its back)" if names else ""


def offences_words(offences: Sequence[Offence]) -> str:
    """The offences of a road user; those that break the law come before those that are reported only."""
    ordered = sorted(offences, key=lambda offence: (offence.name not in UNLAWFUL, offence.time_s))
    return "; ".join(map(_offence, ordered)) or "none"


def _offence(offence: Offence) -> str:
    only = "" if offence.name in UNLAWFUL else ", reported only"
    name = offence.name.replace("_", " ")
    return (
        f"{name} from {offence.time_s:.1f} s for {offence.lasting_s:.1f} s ({offence.amount:.3g} {offence.unit}{only})"
    )


def _drove(judgement: Judgement, driver: ReferenceDriver) -> bool:
    return any(drive.driver == driver for drive in judgement.drivers)
