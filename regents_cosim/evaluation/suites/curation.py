"""Chooses the cases of a suite: balanced over collision types and networks, with few that are alike.

Pure: the same cards, numbers and seed give the same choice, whatever the order of the cards.
"""

import hashlib
from collections import Counter
from collections.abc import Callable, Collection, Sequence

from regents_cosim.evaluation.suites.cards import CaseCard

_PER_WINDOW = 2  # attacks on one window share all their traffic but the adversary


def choose_adversarial(
    cards: Sequence[CaseCard], count: int, unavoidable: int, seed: int, first: Collection[str] = ()
) -> list[CaseCard]:
    """`count` clean crashes that the planner could have avoided, and `unavoidable` ones that it could not.

    Of the former, those named in `first` are chosen first, then telling ones, then others. The choice is balanced over
    collision types, and within a type over networks. A window gives at most two cases, which differ in their adversary
    or their collision type. Sorted by name; fewer where there are not enough.
    """
    clean = [card for card in cards if card.clean]
    could = _balanced([c for c in clean if c.avoidable or c.telling], count, seed, _type, first)
    could_not = _balanced([c for c in clean if c.avoidable is False and not c.telling], unavoidable, seed, _type)
    return sorted([*could, *could_not], key=_name)


def choose_ordinary(cards: Sequence[CaseCard], followers: Collection[str], count: int, seed: int) -> list[CaseCard]:
    """`count` cases of recorded traffic, half of them with the ego behind another vehicle (the names in `followers`).

    Those reveal a planner that keeps too little distance. Balanced over networks.
    """
    return sorted(_balanced(cards, count, seed, lambda card: card.case in followers), key=_name)


def _balanced(
    cards: Sequence[CaseCard],
    count: int,
    seed: int,
    trait: Callable[[CaseCard], object],
    first: Collection[str] = (),
) -> list[CaseCard]:
    """The next is in `first` or telling while there are such, of the rarest trait so far, of its rarest network ..."""
    left = {card.case: card for card in cards}
    chosen: list[CaseCard] = []
    had: Counter[object] = Counter()
    alike: set[tuple[object, ...]] = set()

    def traits(card: CaseCard) -> list[tuple[object, ...]]:
        cell = ("cell", trait(card), card.network)
        return [("trait", trait(card)), cell, ("by", card.planner), ("net", card.network), ("window", card.window)]

    def rarity(card: CaseCard) -> tuple[int | str, ...]:
        lot = hashlib.sha256(f"{seed} {card.case}".encode()).hexdigest()  # unbiased towards early windows
        return int(card.case not in first), int(card.telling is not True), *(had[one] for one in traits(card)), lot

    while left and len(chosen) < count:
        card = left.pop(min(left.values(), key=rarity).case)
        likeness = (card.window, card.adversary, card.collision_type)
        if likeness in alike or had["window", card.window] >= _PER_WINDOW:
            continue
        alike.add(likeness)
        had.update(traits(card))
        chosen.append(card)
    return chosen


def _type(card: CaseCard) -> object:
    return card.collision_type


def _name(card: CaseCard) -> str:
    return card.case
