"""Words that a command does not understand: one sentence that names them and what is valid, and exit code 2."""

import pytest
from in_process import command
from typer_apps import HOMES

from fasbody.exceptions import SettingError
from fasbody.usage import option_of

#: Module and words -> what is said of them.
SAID = {
    ("identification.fit", "x.csv", "--body-mass", "abc"): "--body-mass is 'abc', not a number such as 72.5 or 1e-4.",
    ("identification.fit", "--body-mass", "72,5"): "--body-mass is '72,5', not a number; write 72.5.",
    ("identification.fit", "--starts", "3.5"): "--starts is '3.5', not a whole number.",
    ("identification.fit", "--seed", "-3"): "--seed is -3; it must be 0 or more.",
    ("identification.fit", "--starts"): "--starts needs a value.",
    ("identification.rivals", "--json=3"): "--json takes no value.",
    ("identification.heel", "--load-n", "0.5"): "--load-n is 0.5; it must be 1 or more.",
    ("identification.plan", "propose", "--amplitude", "1,5"): "--amplitude is '1,5', not a number; write 1.5.",
    ("identification.plan", "propose", "--recordings", "0"): "--recordings is 0; it must be 1 or more.",
    ("identification.plan", "propose", "--draws", "1"):
        "--draws: the number of draws is 1, no average over feet; give 2 or more.",
    ("identification.plan", "propose", "--minutes", "0"):
        "--minutes 0 leaves no room for a recording of 10 s; give more.",
    ("fasbody.laboratory",): "the argument 'study' is missing: folder to write.",
    ("fasbody.laboratory", "a", "b", "c"): "unexpected argument 'b c'; beside options it takes the argument 'study'.",
    ("fasbody.recording", "x"): "unknown command 'x' (valid: check, convert, merge, init).",
    ("fasbody.arch",): "name one of sensitivity, reduction, load, validate, crosscheck.",
    ("fasbody", "--[b]"): "unknown option '--[b]' (valid: --json, --version, --completion, --help).",
    ("identification.fit", "--strats", "3"):
        "unknown option '--strats', did you mean '--starts'? For all options see --help.",
    ("identification.fit", "--?"): "unknown option '--?'; for all options see --help.",
    ("reproduction", "--page", ""): "--page is empty; name a place.",
    ("identification.fit", "--starts", "0"): "--starts: the number of starts is 0; give a whole number, 1 or more.",
    ("viz.foot", "--added-mass=-1"): "--added-mass: added mass is -1, but must be between 0 and 100.",
    ("viz.cell", "--port", "x"): "--port is 'x', not a whole number.",
}  # fmt: skip


@pytest.mark.parametrize("words", SAID, ids=" ".join)
def test_one_sentence_says_what_is_wrong(words: tuple[str, ...]) -> None:
    done = command(*words)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"error: {SAID[words]}\n")


@pytest.mark.parametrize("module", sorted(HOMES))
def test_every_command_refuses_an_option_that_it_does_not_have(module: str) -> None:
    done = command(module, "--hepl")
    assert (done.returncode, done.stdout) == (2, "")
    near, _, rest = done.stderr.partition("? ")
    assert near == "error: unknown option '--hepl', did you mean '--help'"
    listed = rest.removeprefix("(valid: ").removesuffix(").\n").split(", ")
    assert rest == "For all options see --help.\n" or (listed[-1] == "--help" and len(listed) <= 8)
    assert done.stderr.count("\n") == 1


def test_an_option_is_named_where_it_was_typed_and_nowhere_else() -> None:
    """Not by a number that happens to be the same."""
    error = SettingError("the number of draws is 1; give 2 or more.", "draws")
    assert option_of(error, ["--draws=1", "--starts", "1"]) == "--draws"
    assert option_of(error, ["--starts", "1"]) == ""
    assert option_of(SettingError("the number is 1."), ["--starts", "1"]) == ""


def test_help_and_no_words_at_all_are_no_errors() -> None:
    assert command("fasbody.laboratory", "--help").returncode == 0
    nothing = command("fasbody.recording")
    assert "Usage" in nothing.stdout and not nothing.stderr.strip()
