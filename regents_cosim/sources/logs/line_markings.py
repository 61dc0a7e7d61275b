"""Which lines between lanes bind those who want to change, in the words of CommonRoad and lanelet2.

Both have `solid_dashed` for a solid line with a dashed one on its right: one may cross it from the dashed side.
"""

_BINDS = {"solid", "curb"}
_WALLS = {"curbstone", "wall", "fence", "guard_rail", "road_border", "jersey_barrier", "rail", "keepout"}


def may_cross(marking: str, to_left: bool) -> bool:
    """Whether a line of a kind, as `broad_solid` or `dashed_solid`, may be crossed to its left or to its right."""
    words = marking.removeprefix("broad_").removeprefix("lowered_").split("_")
    return words[-1 if to_left else 0] not in _BINDS


def may_cross_way(tags: dict[str, str], to_left: bool) -> bool:
    """The same of a lanelet2 way by its tags: what it says of lane changes counts before what kind of line it is."""
    said = tags.get(f"lane_change:{'left' if to_left else 'right'}", tags.get("lane_change"))
    if said in ("yes", "no"):
        return said == "yes"
    return tags.get("type") not in _WALLS and may_cross(tags.get("subtype", ""), to_left)
