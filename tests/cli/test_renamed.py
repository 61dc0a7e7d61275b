"""Options that have a new name, which the old one tells and takes, and options that are gone, which say so."""

import json

import pytest

from regents_cosim.cli.application import app, run
from regents_cosim.cli.renamed import GONE, GONE_SETTINGS, RENAMED, with_new_names
from regents_cosim.errors import WRONG_USAGE

FORMER = {  # as files had them
    "also_crash": [],
    "universal": "mean",
    "as_published": False,
    "optimiser": "adam",
    "beta1": 0.9,
    "beta2": 0.999,
    "behind_rad": 2.356194490192345,
    "front_share": 0.5,
    "front_window_rad": 0.39269908169872414,
    "rear_share": 0.8,
    "rear_sector_rad": 0.7853981633974483,
    "static_m": 0.2,
}
OLD = [(command, old, new) for command, names in RENAMED.items() for old, new in names.items()]


@pytest.mark.parametrize(("command", "old", "new"), OLD)
def test_an_old_name_is_replaced_and_the_new_one_told(command, old, new):
    told = []
    assert with_new_names([*command, "suite", old, "x", f"{old}=y"], told.append) == [
        *(*command, "suite", new, "x", f"{new}=y")
    ]
    assert told == [f"{old} is now called {new}; the old name will go in the next release"] * 2


@pytest.mark.parametrize(("command", "old", "new"), OLD)
def test_the_program_knows_the_new_name_alone(command, old, new):
    one = app
    for word in command:
        one = one[word]
    names = {name for argument in one.assemble_argument_collection() for name in argument.names}
    assert new in names
    assert old not in names


def test_what_the_option_is_called_elsewhere_is_left_alone():
    told = []
    for words in (["evaluate", "--type", "x"], ["suite", "check", "--against", "x"], []):
        assert with_new_names(words, told.append) == words
    assert told == []


def test_a_command_with_the_old_name_runs(capsys, tmp_path):
    words = ["evaluate", "shipped:quickstart", "--planner", "log_replay", "--against", str(tmp_path / "none.json")]
    assert run(words) == WRONG_USAGE
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("regents: note: --against is now called --baseline")
    assert "baseline not found" in said[1]


@pytest.mark.parametrize("words", [["--axes", "tag, kind,ego"], ["--axes=tag, kind,ego"]])
def test_axes_have_new_names_too(words):
    told = []
    renamed = with_new_names(["suite", "coverage", "tag", *words], told.append)
    assert "=".join(renamed[3:]) == "--axes=manoeuvre,collision_type,ego"
    assert renamed[2] == "tag"
    assert [line.split(";")[0] for line in told] == [
        "tag is now called manoeuvre", "kind is now called collision_type",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("command", "option", "instead"),
    [(command, option, instead) for command, options in GONE.items() for option, instead in options.items()],
)
def test_an_option_that_is_gone_says_so_in_one_line(command, option, instead, capsys, tmp_path):
    for words in ([option, "idm"], [f"{option}=idm"]):
        assert run([*command, "shipped:quickstart", "-o", str(tmp_path / "out"), *words]) == WRONG_USAGE
        assert capsys.readouterr().err == f"regents: {option} is gone: {instead}\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("key", GONE_SETTINGS)
def test_a_file_of_former_settings_is_read_unless_it_asks_for_what_is_gone(key, capsys, tmp_path):
    nothing, instead = FORMER[key], GONE_SETTINGS[key][1]
    (tmp_path / "attack.toml").write_text(f"{key} = {json.dumps(nothing)}\nradius = 2\n")
    words = ["attack", str(tmp_path / "none"), "-o", str(tmp_path / "out"), "--config", str(tmp_path / "attack.toml")]
    assert run(words) == WRONG_USAGE
    assert "gone" not in capsys.readouterr().err
    (tmp_path / "attack.toml").write_text(f'{key} = "another"\n')
    assert run(words) == WRONG_USAGE
    assert capsys.readouterr().err == f"regents: setting {key} is gone: {instead}\n"


@pytest.mark.parametrize("words", [["--method", "focused"], ["--method=focused"]])
def test_live_methods_have_new_names(words):
    told = []
    assert "=".join(with_new_names(["live", *words], told.append)) == "live=--method=focused-live"
    assert told == ["focused is now called focused-live; the old name will go in the next release"]
    assert with_new_names(["attack", *words], told.append) == ["attack", *words]
