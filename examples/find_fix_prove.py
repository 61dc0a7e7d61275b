"""Find a bug in a planner, fix it, prove that the fixed one is better.

`my_planner.py` has both: `Planner` looks only at vehicles whose middle is in its lane; `Fixed` looks at whole cars, and
a little ahead.
"""

from my_planner import Fixed, Planner

from regents_cosim import REGENTS_FOCUSED, attack, evaluate, network_config, record, report

# A short search: a window is done with its first crash, few vehicles are asked, and few descents follow the drives that
# are tried first.
SHORT = REGENTS_FOCUSED.but(adversaries="one", nearest=3, attempts=1, iterations=100)


def crashes(cases, planner):
    """The ids of the cases in which `planner` crashes.

    The others repeat their tracks. So a vehicle that hits a braking planner from behind shows no failure of it.
    """
    return {d.case for d in evaluate(cases, planner).drives if d.hits and d.collision_type != "rear_end_by_adversary"}


def main():
    """Find, fix, prove."""
    # Find: attack ordinary traffic. What counts is a crash that a careful driver would have avoided.
    # Windows by chance: those with conflicts come first otherwise, many of them on the ramp, which is not straight.
    windows = record(network_config("merge"), count=8, seed=0, prefer="none")
    found = [case for case in attack(windows, SHORT, Planner) if case.crash]
    print(f"the old planner crashes in {len(found)} attacks")

    # Fix: drive both through the same scenes, adversaries included.
    before, after = crashes(found, Planner), crashes(found, Fixed)
    print(f"among these adversaries the old one crashes in {len(before)}, the fixed one in {len(after)}")

    # Prove: nothing is broken in ordinary traffic, and attacks on the fixed one, made for it, find less.
    print(f"ordinary traffic: {len(crashes(windows, Planner))} crashes before, {len(crashes(windows, Fixed))} after")
    again = [case for case in attack(windows, SHORT, Fixed) if case.crash]
    print(
        f"attacked itself, the fixed one crashes in {len(again)} of {len(windows)} windows, the old one in {len(found)}"
    )
    report(found, "old_and_fixed.html", planners=[Planner, Fixed])
    print("both in a browser: old_and_fixed.html")


if __name__ == "__main__":
    main()
