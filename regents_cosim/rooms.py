"""How the rooms of the package are put together, where one adds something to another that does not know it.

Names alone: what they stand for is imported when it is asked for.
"""

ADD_PLANNERS = ("regents_cosim.replays",)  # to `planners.bridges`
