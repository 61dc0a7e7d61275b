"""Which markings between lanes forbid a lane change, in the terms of CommonRoad and lanelet2.

Both call a solid line with a dashed one on its right `solid_dashed`: one may cross it from the dashed side.
"""

_BINDS = {"solid", "curb"}
_WALLS = {"curbstone", "wall", "fence", "guard_rail", "road_border", "jersey_barrier", "rail", "keepout"}


def may_cross(marking: str, to_left: bool) -> bool:
    """Whether a marking such as `broad_solid` or `dashed_solid` may be crossed to the left (`to_left`) or right."""
    words = marking.removeprefix("broad_").removeprefix("lowered_").split("_")
    return words[-1 if to_left else 0] not in _BINDS


def may_cross_way(tags: dict[str, str], to_left: bool) -> bool:
    """Whether a lanelet2 way with these tags may be crossed; a tag about lane changes overrides the kind of line."""
    said = tags.get(f"lane_change:{'left' if to_left else 'right'}", tags.get("lane_change"))
    if said in ("yes", "no"):
        return said == "yes"
    return tags.get("type") not in _WALLS and may_cross(tags.get("subtype", ""), to_left)
