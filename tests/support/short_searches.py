"""Examples of the documentation with less of the same: what they show needs neither eight windows nor long searches."""

import re

SHORT = {"iterations": 15, "nearest": 2, "attempts": 1}
PART_OF = {"iterations": "steps", "nearest": "candidates", "attempts": "tries"}


def short_commands(text: str) -> str:
    """Lines of a shell: short searches where nothing else is said, two windows, one episode, a quarter of a minute."""
    text = re.sub(r"regents attack .*(?:(?<=\\)\n.*)*", lambda command: _short_attack(command[0]), text)
    text = text.replace("regents suite build ", "regents suite build --method king ")
    text = re.sub(r"--(count|windows) (\d+)", lambda asked: f"--{asked[1]} {min(int(asked[2]), 2)}", text)
    text = re.sub(r"--episodes \d+", "--episodes 1", text)
    return re.sub(r"--minutes \d+", "--minutes 0.25", text)


def _short_attack(command: str) -> str:
    """Shorten one command. Searches of KING and ReGentS, one per window, are short as they are."""
    if re.search(r"--method (king|regents)", command):
        return command
    few = "".join(f" --{name} {value}" for name, value in SHORT.items() if f"--{name}" not in command)
    return command.replace("regents attack ", f"regents attack{few} ", 1)


def short_script(text: str, windows: int = 2) -> str:
    """A script whose searches by default are short, in few windows, and whose simulation ends after 15 seconds."""
    few = "".join(
        f"object.__setattr__(REGENTS_FOCUSED.{PART_OF[name]}, {name!r}, {value})\n" for name, value in SHORT.items()
    )
    text = re.sub(r"(simulation\.getTime\(\)) < [\d.]+", r"\1 < 15.0", text)
    text = re.sub(r"count=(\d+)", lambda asked: f"count={min(int(asked[1]), windows)}", text)
    return f"from regents_cosim import REGENTS_FOCUSED\n{few}\n{text}"
