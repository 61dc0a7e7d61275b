"""Judgements in words, for the terminal, for failing tests and for the report."""

from collections.abc import Sequence

from regents_cosim.attack_record import AttackRecord
from regents_cosim.judgement import Judgement, Offence, ReferenceDrive, ReferenceDriver
from regents_cosim.norms.grades import GROSS_OFFENCES, MISTAKES, Conduct, OffenceName, Prevention
from regents_cosim.scenario import Agent

DRIVERS: dict[ReferenceDriver, str] = {
    "careful": "a careful driver (UN R157)",
    "fuzzy": "the fuzzy safety model (JRC)",
    "rss": "RSS's proper response",
}

ANOTHER = "The other driver"
_GROSSLY: dict[OffenceName, str] = {
    "oncoming_lanes": "came into oncoming lanes",
    "against_direction": "drove against the direction of traffic",
    "red_light": "passed a red light",
    "leaves_way": "left its way in the junction",
    "off_road": "left the road",
    "speeding": "drove more than 20 % too fast",
    "off_crossing": "crossed beside the crossing",
    "steps_out": "stepped out too close",
}


def telling_words(judgement: Judgement) -> str:
    """Whether a crash is telling, even flawless, and the reason if not."""
    if judgement.telling:
        return f"yes{', even flawless' if judgement.flawless else ''}: {verdict_words(judgement)}"
    if judgement.guessed:
        return f"not known: the heading of {', '.join(judgement.guessed)} is a guess"
    if not judgement.clean:
        return "no: something spoils it as a test"
    if judgement.conduct is Conduct.GROSS:
        return "no: the adversary breaks the law grossly"
    if judgement.prevention is Prevention.NOT_PREVENTABLE:
        return "no: a careful driver crashes too"
    if judgement.prevention is Prevention.BY_SWERVING:
        return "no: braking alone does not prevent it"
    missing = ["whether the adversary keeps the law"] if judgement.conduct is Conduct.UNKNOWN else []
    missing += ["what a careful driver does"] if judgement.prevention is Prevention.UNKNOWN else []
    return f"not known: {' and '.join(missing)}"


def verdict_words(judgement: Judgement, who: str = ANOTHER) -> str:
    """Both grades, in sentences for people: what the planner could have done, and what the other, `who`, did."""
    return f"{_prevention_words(judgement)} {_conduct_words(judgement, who)}"


def adversary_words(agents: Sequence[Agent], attack: AttackRecord | None) -> str:
    """The adversary of a crash, as the subject of a sentence."""
    hit = attack.collision if attack else None
    kind = next((agent.kind for agent in agents if hit and agent.id == hit.agent), None)
    return {"pedestrian": "The pedestrian", "bicycle": "The cyclist"}.get(kind or "", ANOTHER)


def _prevention_words(judgement: Judgement) -> str:
    drive = next((drive for drive in judgement.drivers if drive.driver == "careful"), None)
    since = "" if drive is None or drive.acts_s is None else f" from {drive.acts_s:.1f} s"
    if drive is None:
        return "Whether your planner could have prevented this is not known."
    if not drive.avoids:
        return "A careful driver could not have prevented this."
    if not drive.shift_m:
        return f"Your planner could have prevented this: braking{since}."
    side = "left" if drive.shift_m > 0 else "right"
    return f"Only a swerve could have prevented this: {abs(drive.shift_m):.1f} m to the {side}{since}."


def _conduct_words(judgement: Judgement, who: str) -> str:
    """What the adversary did; of gross offences and mistakes only the former are said."""
    offences = judgement.law.adversary if judgement.law else ()
    names: tuple[OffenceName, ...] = tuple(offence.name for offence in offences)
    said = [_GROSSLY[name] for name in names if name in _GROSSLY] or [MISTAKES[name].words for name in names]
    if judgement.conduct is Conduct.UNKNOWN:
        return f"Whether {who[0].lower()}{who[1:]} kept the rules is not known."
    if judgement.conduct is Conduct.KEEPS_RULES:
        return f"{who} kept every rule."
    return f"{who} {' and '.join(said)}."


def advice(judgement: Judgement) -> str | None:
    """What the planner should have done and when, by a reference driver; None where none was tried."""
    drives = {drive.driver: drive for drive in judgement.drivers}
    braking = [drives[name] for name in DRIVERS if name in judgement.preventable_by]
    avoiding = braking or [drive for drive in drives.values() if drive.avoids]
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
    """The offences of a road user; gross ones come before mistakes."""
    ordered = sorted(offences, key=lambda offence: (offence.name not in GROSS_OFFENCES, offence.time_s))
    return "; ".join(map(_offence, ordered)) or "none"


def _offence(offence: Offence) -> str:
    only = "" if offence.name in GROSS_OFFENCES else ", a mistake"
    name = offence.name.replace("_", " ")
    return (
        f"{name} from {offence.time_s:.1f} s for {offence.lasting_s:.1f} s ({offence.amount:.3g} {offence.unit}{only})"
    )
