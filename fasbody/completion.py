"""Completion of `fasbody` in a shell: `eval "$(fasbody --completion bash)"`."""

from collections.abc import Sequence
from importlib import import_module

from fasbody.commands import commands, resolve
from fasbody.exceptions import SettingError, unknown

#: Asks for what may follow; a name of a file is completed where nothing does.
_BASH = """_fasbody() {
  local following="$(fasbody --following "${COMP_WORDS[@]:1:COMP_CWORD-1}" 2>/dev/null)"
  COMPREPLY=($(compgen -W "$following" -- "${COMP_WORDS[COMP_CWORD]}"))
}
complete -o default -F _fasbody fasbody"""
SCRIPTS = {
    "bash": _BASH,
    "zsh": f"autoload -U +X bashcompinit && bashcompinit\n{_BASH}",
    "fish": "complete -c fasbody -a '(fasbody --following (commandline -opc)[2..] 2>/dev/null)'",
}


def script(shell: str) -> str:
    """What a shell evaluates to complete `fasbody`.

    Raises:
        SettingError: there is none for this shell.
    """
    if shell not in SCRIPTS:
        raise SettingError(f"{unknown('shell', shell, SCRIPTS)}.")
    return SCRIPTS[shell]


def following(words: Sequence[str]) -> list[str]:
    """Words that may follow: of longer names of commands, and the options of the command that is named."""
    names = [command.words.split() for command in commands()]
    longer = [name[len(words)] for name in names if len(name) > len(words) and name[: len(words)] == [*words]]
    return [*dict.fromkeys(longer), *_options(words)]


def _options(words: Sequence[str]) -> list[str]:
    from typer.main import get_command

    try:
        command, _ = resolve(words or [""])
    except SettingError:
        return []
    app = get_command(import_module(command.home).app)
    one = getattr(app, "commands", {}).get(command.name, app)
    return [option for parameter in one.params for option in parameter.opts if option.startswith("--")]
