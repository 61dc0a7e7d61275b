"""The terms of the page, each explained in a sentence; `docs/glossary.md` says more."""

TERMS: dict[str, str] = {
    "telling": "Nothing spoils the crash as a test, the adversary keeps the law, and a careful driver in the planner's "
    "place avoids it: it tells something about the planner.",
    "clean": "Nothing spoils the crash as a test: the adversary stays on the road, hits nobody else, does not come "
    "from behind, and asks no more of its tyres than they can give.",
    "avoidable": "A drive is known that avoids the crash: a careful driver's, or a manoeuvre within tyre friction.",
    "in time": "It is avoided by an answer to what was to be seen, after a time to react; what is not in time takes "
    "knowledge of what comes.",
    "at fault": "Who broke a rule of the road that the crash follows from.",
    "preventable by": "The reference drivers that avoid the crash in the planner's place: a careful driver (UN R157), "
    "the fuzzy safety model (JRC), RSS's proper response.",
    "careful driver": "The competent and careful human driver of UN Regulation 157: it reacts to what is to be seen, "
    "then brakes.",
    "adversary": "The road user that the attack made crash into the ego, or the ego into it.",
    "attack": "The search for controls of other road users that make the ego crash.",
    "ego": "The vehicle that the planner under test drives.",
    "crashes without an attack": "The ego collides in traffic that is as it was recorded, or harmless: nobody attacks.",
    "impact": "How fast the two move relative to each other when they touch first.",
    "least ttc": "The least time to collision in the drive: how long until the two touch if they go on as they are.",
    "at": "When the ego is first touched.",
    "gap": "The distance between the outlines of ego and adversary.",
    "collision rate": "The share of the cases in which the ego collides, whoever is to blame.",
    "driving score": "How far the ego gets, times what its infractions leave (CARLA leaderboard 1.0).",
    "route completion": "The share of the recorded way that the ego gets along before it collides.",
    "decision time": "How long the planner took for a decision.",
    "broken": "It crashes with the second planner and not with the first.",
    "worse": "It crashes with both, and the crash says more against the second planner.",
    "better": "It crashes with both, and the crash says less against the second planner: a telling one has become one "
    "that is not, say.",
    "fixed": "It crashes with the first planner and not with the second.",
    "unchanged": "It ends alike with both.",
}
_SAME = {
    "telling crashes": "telling",
    "clean crashes": "clean",
    "avoidable in time": "in time",
    "impact speed": "impact",
    "gap to the adversary": "gap",
    "gentlest way out": "avoidable",
    "reference drivers": "preventable by",
    "way out": "avoidable",
}


def term(words: str) -> str | None:
    """The explanation of a term of the page; None for ordinary words."""
    key = words.lower()
    return TERMS.get(_SAME.get(key, key))


def all_terms() -> dict[str, str]:
    """The explanations by term and by its other names, for the page's script."""
    return TERMS | {name: TERMS[of] for name, of in _SAME.items()}
