"""A planner's module that prints, moves elsewhere and leaves a thread: commands go on as without that, and end."""

import json

import pytest
from command import regents
from shipped_cases import crash_on

MODULE = """
import os, threading
from regents_cosim import Control
print("loading weights")
os.write(1, b"in C")
os.chdir("/")
threading.Thread(target=threading.Event().wait).start()
class Mine:
    def reset(self, scene): print("again")
    def act(self, observation): return Control(0.0, 0.0)
"""


@pytest.mark.slow
def test_results_are_json_and_names_lead_from_where_the_command_was_given(tmp_path):
    case = crash_on("crossing")
    (tmp_path / "suite").symlink_to(case.parent)
    (tmp_path / "mine.py").write_text(MODULE)
    done = regents(
        "evaluate", f"suite/{case.name}", "--planner", "mine.py:Mine", "--json", "-o", "kept", cwd=tmp_path, code=0
    )
    assert json.loads(done.stdout)[0]["planner_errors"] == 0
    assert "loading weights" in done.stderr
    assert (tmp_path / "kept").is_dir()
