"""Two planners among the same adversaries: which crashes the second one avoids, and which it adds.

Start it with `python compare_planners.py`, or with two planners of yours behind that.
"""

import sys
from collections import Counter

from regents_cosim import evaluate, load_suite, report

first, second = sys.argv[1:] or ("constant_velocity", "idm")
cases = load_suite("shipped:quickstart")
ends = zip(evaluate(cases, first).drives, evaluate(cases, second).drives, strict=True)
counts = Counter((bool(one.hits), bool(other.hits)) for one, other in ends)
print(f"{len(cases)} cases: {counts[True, False]} crashes of {first} that {second} avoids, "
      f"{counts[False, True]} new ones, {counts[True, True]} of both")  # fmt: skip
report(cases, "comparison.html", planners=[first, second])
print("case by case: comparison.html")
