"""Connections between subpackages that do not import each other, given as names and imported on use."""

ADD_PLANNERS = ("regents_cosim.replays",)  # packages that add planners to `planners.bridges`
TAGGER = "regents_cosim.tags.table:tags_of"  # function that gives the tags of a case when `cases.files` saves it
# function that measures how the crash of a case came about when `cases.files` saves it
MEASURER = "regents_cosim.archive.measured:behaviour_of"
