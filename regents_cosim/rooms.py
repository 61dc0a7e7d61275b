"""How the rooms of the package are put together, where one adds something to another that does not know it.

Names alone: what they stand for is imported when it is asked for.
"""

ADD_PLANNERS = ("regents_cosim.replays",)  # to `planners.bridges`
TAGGER = "regents_cosim.tags.table:tags_of"  # to `cases.files`: what kind of scenario a case is, when it is saved
MEASURER = "regents_cosim.archive.measured:behaviour_of"  # to `cases.files`: how its crash came about, likewise
