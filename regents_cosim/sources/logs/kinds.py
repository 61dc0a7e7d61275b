"""The kinds of road users by the words that data sets use for them."""

from regents_cosim.scenario.scenario import Kind

_WORDS: dict[Kind, str] = {
    "car": "car van vehicle regular_vehicle parkedvehicle taxi priorityvehicle",
    "truck": "truck truck_bus trailer large_vehicle box_truck truck_cab vehicular_trailer",
    "bus": "bus school_bus articulated_bus",
    "motorcycle": "motorcycle motorcyclist tricycle",
    "bicycle": "bicycle bicyclist cyclist riderless_bicycle wheeled_rider",
    # SinD's documentation writes `pedestrain`.
    "pedestrian": "pedestrian pedestrian/bicycle pedestrain official_signaler stroller wheelchair",
}
_KINDS: dict[str, Kind] = {word: kind for kind, words in _WORDS.items() for word in words.split()}


def kind_named(word: str) -> Kind:
    """The kind that a data set calls so, in any case; `other` for an unknown word."""
    return _KINDS.get(word.strip().lower(), "other")
