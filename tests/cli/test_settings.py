"""Settings of a command in a file: all of them stand in it, the command line comes first, and it makes the same run."""

import re

import pytest
from scenes import platoon

from regents_cosim.attacks.methods.presets import METHODS, REGENTS_FOCUSED
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cli import run
from regents_cosim.cli.application import app
from regents_cosim.cli.commands.config import COMMANDS, named
from regents_cosim.cli.settings import Asked, in_help, out_of_place, settings_of
from regents_cosim.errors import WRONG_USAGE
from regents_cosim.saving import SuiteWriter
from regents_cosim.training.lessons.train_config import TrainConfig

MOST = 25  # options that `--help` shows


def written(capsys, command, *more):
    """The template of a command, as it is and with all of it counting that has a value."""
    assert run(["config", command, *more]) == 0
    text = capsys.readouterr().out
    return text, re.sub(r"^#(\w+ = )", r"\1", text, flags=re.MULTILINE)


def parsed(command, *words):
    """The values by parameter, and the same as settings."""
    _, bound, _ = app.parse_args([*command.split(), *words], exit_on_error=False, print_error=False)
    bound.apply_defaults()
    return bound.arguments, Asked.of(command, named(app, command).assemble_argument_collection(), bound)


@pytest.mark.parametrize("command", COMMANDS.values())
def test_help_shows_few_options_in_named_boxes(command):
    shown = in_help(named(app, command).assemble_argument_collection())
    assert len([one for one in shown if one.index is None]) <= MOST
    groups = {group.name for one in shown for group in one.parameter.group}
    assert "Advanced" not in groups
    assert len(groups) <= 5


@pytest.mark.parametrize("command", COMMANDS.values())
def test_what_a_file_may_not_name_stays_on_the_command_line(command):
    arguments = named(app, command).assemble_argument_collection()
    assert not out_of_place(arguments, ["--planner", "--method", "--policy"])


@pytest.mark.parametrize("command", COMMANDS)
def test_the_file_tells_the_meaning_of_every_setting(command, capsys):
    text, _ = written(capsys, command)
    known = settings_of(named(app, COMMANDS[command]).assemble_argument_collection(parse_docstring=True))
    assert sorted(re.findall(r"^#(\w+) =", text, re.MULTILINE)) == sorted(known)
    assert all(re.search(rf"^# .*\n#{key} =", text, re.MULTILINE) for key in known)
    for name, settings in (("attack", REGENTS_FOCUSED.settings), ("train", vars(TrainConfig()))):
        assert name != command or set(settings) <= set(known)


@pytest.mark.parametrize("method", METHODS)
def test_the_file_with_all_that_it_names_is_the_default(method, tmp_path, capsys):
    _, counting = written(capsys, "attack", "--method", method)
    (tmp_path / "all.toml").write_text(counting)
    found, asked = parsed("attack", "--config", str(tmp_path / "all.toml"))
    by_default, usual = parsed("attack", "--method", method)
    assert found["search"].config() == by_default["search"].config() == METHODS[method]
    config = METHODS[method].settings
    assert asked.text(config) == usual.text(config)


def test_an_option_comes_before_the_file_and_the_file_before_the_default(tmp_path):
    (tmp_path / "a.toml").write_text("count = 3\nseed = 4\nmax_jerk = 2\nverify = false\n")
    found, _ = parsed("attack", "shipped:quickstart", "--config", str(tmp_path / "a.toml"), "--seed", "5")
    assert (found["traffic"].count, found["traffic"].seed, found["traffic"].radius) == (3, 5, 100.0)
    assert found["search"].config().limits.max_jerk == 2.0
    assert found["search"].config().steps.iterations == REGENTS_FOCUSED.steps.iterations
    assert (found["verify"], found["judge"]) == (False, True)


@pytest.mark.parametrize("kinds", ['["vehicle", "cyclist"]', '"vehicle,cyclist"'])
def test_words_with_commas_may_be_a_list(kinds, tmp_path):
    (tmp_path / "a.toml").write_text(f"adversary_kinds = {kinds}\n")
    found, _ = parsed("attack", "--config", str(tmp_path / "a.toml"))
    assert found["search"].config().candidates.adversary_kinds == ("vehicle", "cyclist")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("max_jerks = 3", "max_jerks is no setting of it: did you mean max_jerk"),
        ("qqqq = 3", "qqqq is no setting of it: expected one that `regents config` writes"),
        ("spread = 3", "(a setting of a method of your own needs --method with it, on the command line)"),
        ('iterations = "many"', 'Invalid value for iterations from a.toml: unable to convert "many" into int'),
        ("iterations = 0", "iterations is 0, expected 1 to 100000"),
        ('adversary_may = "mistake"', 'Did you mean "mistakes"'),
        ("batch = 0", "Must be >= 1"),
        ("count = nan", 'unable to convert "nan"'),
        ("count = {a = 1}", "count is {'a': 1}, expected a number, a text"),
        ("count", "Expected '=' after a key"),
        ("begin =", "Invalid value"),
        ('output = "x"', "output is no setting of it: expected --output on the command line"),
        ('executor = "dask"', "expected --executor on the command line"),
        ('sumo_option = ["--x"]', "sumo_option is no setting of it"),
    ],
)
def test_what_is_no_setting_is_refused_in_one_line(text, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text(text)
    assert run(["attack", "-c", "shipped:crossing", "-o", "out", "--config", "a.toml"]) == WRONG_USAGE
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_an_option_that_left_the_command_line_works_and_tells_where_it_belongs(tmp_path, capsys):
    words = ["record", "-c", "shipped:crossing", "--count", "1", "--horizon", "4", "--prefer=none", "-e", "60"]
    assert run([*words, "-o", str(tmp_path / "cases"), "--quiet"]) == 0
    (note,) = capsys.readouterr().err.splitlines()
    assert "note: --horizon, --prefer, -e will leave the command line in the next release" in note
    assert "expected horizon, prefer, end in a file that --config names" in note
    assert "horizon = 4.0\n" in (tmp_path / "cases/record.toml").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("record", "--log", "TRACKS", "-o", "out"), "`columns`, with `format` table); settings stand in a file that"),
        (("inspect", "TRACKS"), "--columns, with --format table)"),
    ],
)
def test_an_error_names_an_option_or_a_setting_as_the_command_has_it(words, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tracks.csv").write_text("frame,id,x,y,width,height,xVelocity,yVelocity,xMiddle\n1,1,0,0,4,2,1,0,0\n")
    (tmp_path / "record.toml").write_text('format = "highd"\n')
    more = ("--config", "record.toml") if words[0] == "record" else ("--format", "highd")
    assert run([*("tracks.csv" if word == "TRACKS" else word for word in words), *more]) == WRONG_USAGE
    assert said in capsys.readouterr().err


def test_a_file_is_written_where_none_of_the_user_is(tmp_path, capsys):
    file = tmp_path / "attack.toml"
    assert run(["config", "attack", "-o", str(file)]) == 0
    assert file.read_text() == written(capsys, "attack")[0]
    file.write_text("max_jerk = 2\n")
    assert run(["config", "attack", "-o", str(file)]) == WRONG_USAGE
    assert file.read_text() == "max_jerk = 2\n"


def test_what_was_asked_for_is_a_file_that_asks_for_the_same(tmp_path):
    words = ["shipped:quickstart", "--planner", "careful", "--max-jerk", "2", "--method", "king", "--no-judge"]
    found, asked = parsed("attack", *words)
    text = asked.text(vars(found["search"].config()))
    assert 'cases = "shipped:quickstart"\n' in text
    (tmp_path / "a.toml").write_text(text)
    again, asked_again = parsed("attack", "--config", str(tmp_path / "a.toml"))
    assert again["search"].config() == found["search"].config()
    assert asked_again.text(vars(again["search"].config())) == text
    alike = set(found) - {"search", "settings", "asked"}
    assert {name: again[name] for name in alike} == {name: found[name] for name in alike}


def test_code_and_what_goes_to_sumo_are_named_by_the_command_alone():
    _, asked = parsed("attack", "-c", "shipped:merge", "--planner", "exec:python p.py", "--sumo-option=--step")
    first, *settings = asked.text({}).splitlines()
    assert first.endswith("-o FOLDER --planner 'exec:python p.py' -- --step")
    assert not [line for line in settings if "exec:" in line or "--step" in line]


@pytest.mark.slow
def test_the_file_in_a_suite_makes_the_same_run(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    SuiteWriter(tmp_path / "cases", 0).add(platoon(4, 0))
    few = tmp_path / "few.toml"
    few.write_text("iterations = 2\nverify = false\npictures = false\nmax_deviation = 0.5\n")
    words = [
        "attack",
        "cases",
        "--method",
        "king",
        "--planner",
        "constant_velocity",
        "--config",
        "few.toml",
        "-o",
        "first",
    ]
    assert run(words) == 0
    assert run(["attack", "--config", "first/attack.toml", "-o", "second"]) == 0
    assert load_manifest(tmp_path / "first").cases == load_manifest(tmp_path / "second").cases
    assert (tmp_path / "first/attack.toml").read_bytes() == (tmp_path / "second/attack.toml").read_bytes()
    capsys.readouterr()
    assert run(["suite", "check", "second"]) == 0
    assert "not of it" not in capsys.readouterr().err
