"""Judgements in words, for the terminal, for failing tests and for the report."""

from collections.abc import Sequence

from regents_cosim.norms.grades import GROSS_OFFENCES, MISTAKES, Conduct, OffenceName, Prevention
from regents_cosim.scenario.attack_record import AttackRecord, Collision, CollisionType
from regents_cosim.scenario.judgement import Blamed, Fault, Holds, Judgement, Law, Offence, Shortcoming
from regents_cosim.scenario.scenario import Agent, Kind, Tracks

ANOTHER = "The adversary"
_GROSSLY: dict[OffenceName, str] = {
    "oncoming_lanes": "drives in oncoming lanes",
    "against_direction": "drives against the direction of traffic",
    "red_light": "passes a red light",
    "leaves_way": "leaves its path through the junction",
    "off_road": "leaves the road",
    "speeding": "drives more than 20 % too fast",
    "off_crossing": "crosses the road beside the crossing",
    "steps_out": "steps out too close to {other}",
}
_MEETS: dict[CollisionType, str] = {
    "rear_end_by_ego": "{ego} runs into the rear of {other}",
    "rear_end_by_adversary": "{other} runs into the rear of {ego}",
    "side_swipe": "{ego} and {other} touch side by side",
    "t_bone": "{ego} and {other}, which crosses its way, collide",
    "head_on": "{ego} and {other}, which comes towards it, collide",
    "person_by_front": "the front of {ego} hits {other}",
    "person_by_side": "the side of {ego} touches {other}",
}


def crash_words(agents: Sequence[Agent], tracks: Tracks, hit: Collision) -> str:
    """A collision in a sentence: when and how the two touch, and at what speeds."""
    index = next(i for i, agent in enumerate(agents) if agent.id == hit.agent)
    ego, other = (f"{kmh(tracks.speed[i, hit.step])}" for i in (0, index))
    named = {"ego": f"the ego ({ego})", "other": f"{_called(agents[index])} ({other})"}
    return f"At {hit.time_s:.1f} s {_MEETS[hit.collision_type].format(**named)}."


def kmh(speed: float) -> str:
    """A speed given in m/s, for people."""
    return f"{3.6 * speed:.0f} km/h"


def _called(agent: Agent) -> str:
    """The other road user in a collision, within a sentence."""
    if agent.role != "adversary":
        return f"another {_KINDS.get(agent.kind, 'vehicle')}"
    return "the adversary" if agent.kind not in _KINDS else f"the {_KINDS[agent.kind]}"


_KINDS: dict[Kind, str] = {"pedestrian": "pedestrian", "bicycle": "cyclist"}


def offence_words(name: OffenceName, other: str) -> str:
    """What a road user does against a rule, after its name; `other` is the one that it meets."""
    return (_GROSSLY.get(name) or MISTAKES[name]).format(other=other)


_FLAWLESS = {True: "even flawless", False: "not flawless", None: "flawless is not known"}


def telling_words(judgement: Judgement) -> str:
    """Whether a crash is telling, even flawless, and the reason if not."""
    if judgement.telling:
        return f"yes, {_FLAWLESS[judgement.flawless]}: {verdict_words(judgement)}"
    if judgement.guessed:
        return f"not known: the heading of {', '.join(judgement.guessed)} is a guess"
    if judgement.shortcoming in _SHORTCOMINGS:
        return f"no: {_SHORTCOMINGS[judgement.shortcoming]}"
    missing = ["whether the adversary keeps the law"] if judgement.conduct is Conduct.UNKNOWN else []
    missing += ["what a careful driver does"] if judgement.prevention is Prevention.UNKNOWN else []
    return f"not known: {' and '.join(missing)}"


_SHORTCOMINGS: dict[Shortcoming | None, str] = {
    "spoilt_only": "something spoils it as a test",
    "gross_offence_only": "the adversary breaks the law grossly",
    "careful_driver_crashes_too": "a careful driver crashes too",
    "swerve_only": "braking alone does not prevent it",
}
_OTHERS = {"replayed": "replayed from the log", "reactive": "reacting in the mirror", "sumo": "driven by SUMO"}


def holds_words(holds: Holds) -> str | None:
    """Whether a crash holds with the others moving otherwise, after "Holds"; None where that was not tried."""
    tried = {words: answer for how, words in _OTHERS.items() if (answer := getattr(holds, how)) is not None}
    yes, no = ([words for words, answer in tried.items() if answer is wanted] for wanted in (True, False))
    said = f"with the others {_listed(yes)}" if yes else ""
    if no:
        said += f"{'; not' if yes else 'not'} with the others {_listed(no)}: the ego hits one of them first"
    return said or None


def _listed(words: Sequence[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def verdict_words(judgement: Judgement, who: str = ANOTHER) -> str:
    """Both grades, in sentences for people: who breaks which rule, and what a careful driver does about it."""
    return f"{_conduct_words(judgement, who)} {prevention_words(judgement)}"


def adversary_words(agents: Sequence[Agent], attack: AttackRecord | None) -> str:
    """The adversary of a crash, as the subject of a sentence."""
    hit = attack.collision if attack else None
    kind = next((agent.kind for agent in agents if hit and agent.id == hit.agent), None)
    return f"The {_KINDS[kind]}" if kind in _KINDS else ANOTHER


# What one does that is at fault by a rule of `verdicts.law.fault`, where no offence has that name
_AT_FAULT = {
    "wrong_way": "drives on the wrong side",
    "gives_way": MISTAKES["gives_no_way"],
    "cut_in": "cuts in too close to {other}",
    "side_swipe": "moves sideways into {other}",
    "rear_end": "keeps too little distance to {other}",
    "standing": "runs into {other}, which stands",
    "turns_across": "turns across the way of {other}",
    "breaks_law": "passes a red light or leaves the road",
    "into_side": "runs into the side of {other}",
    "steps_out": "comes into the way of {other}",
}
_EGO_AT_FAULT = {"steps_out": "does not stop in time for {other}"}


def prevention_words(judgement: Judgement) -> str:
    """What a careful driver does in the planner's place, and how it ends, in a sentence."""
    drive = judgement.careful
    if drive is None:
        return "Whether a careful driver avoids it is not known."
    if not drive.avoids:
        return "A careful driver crashes too."
    if drive.acts_s is None:
        return "A careful driver goes on as the planner did and avoids it."
    only = "; braking alone is not enough" if drive.shift_m else ""
    then = " A follower brakes too late and hits that car, which does not count." if drive.rear_ended_by else ""
    return f"A careful driver {braking_words(drive.shift_m)} from {drive.acts_s:.1f} s and avoids it{only}.{then}"


def _conduct_words(judgement: Judgement, who: str) -> str:
    """What both do against the rules: their offences, or else why they are at fault."""
    law, they, known = judgement.law, f"{who[0].lower()}{who[1:]}", judgement.conduct is not Conduct.UNKNOWN
    does = (law and _offending(law.adversary, "the ego")) or _blamed(judgement.fault, "adversary", "the ego")
    ego = (law and _offending(law.ego, they)) or _blamed(judgement.fault, "ego", they)
    if does:
        first = f"{who} {does}" + "; whether it breaks the law grossly is not known" * (not known)
    else:
        first = f"{who} {_kept(law)}" if known else f"Whether {they} keeps the rules is not known"
    return f"{first}; the ego {ego}." if ego else f"{first}."


def _kept(law: Law | None) -> str:
    unknown = untold_words(law) if law else ""
    return f"keeps every rule that can be told (not told: {unknown})" if unknown else "keeps every rule"


def untold_words(law: Law) -> str:
    """The offences that the map and the log do not show; empty where there are none."""
    return ", ".join(name.replace("_", " ") for name in law.unknown)


def _blamed(fault: Fault | None, agent: Blamed, other: str) -> str:
    """What makes `agent` at fault, after its name; empty where it is not."""
    if fault is None or fault.at_fault not in (agent, "both"):
        return ""
    rules = {**_GROSSLY, **MISTAKES, **_AT_FAULT}
    does = (_EGO_AT_FAULT if agent == "ego" else rules).get(fault.rule, rules.get(fault.rule))
    said = "is partly at fault" if fault.at_fault == "both" else "is at fault"
    return f"{does.format(other=other)} and {said}" if does else f"{said} ({fault.rule.replace('_', ' ')})"


def _offending(offences: Sequence[Offence], other: str) -> str:
    names: tuple[OffenceName, ...] = tuple(offence.name for offence in offences)
    grossly: list[OffenceName] = [name for name in names if name in GROSS_OFFENCES]
    return " and ".join(offence_words(name, other) for name in grossly or names)


def braking_words(shift_m: float) -> str:
    """What a careful driver does about a danger: it brakes, and may swerve by `shift_m` [m], positive to the left."""
    side = "left" if shift_m > 0 else "right"
    return f"brakes and swerves {abs(shift_m):.1f} m to the {side}" if shift_m else "brakes"


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
