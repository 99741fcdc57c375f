"""Why the resonance rises with the load: `fasbody load effect --help`."""

import typer

from fasbody.console import command_line
from fasbody.lazy import command

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
app.command()(command("reproduction.load_effect.command:load_effect"))

if __name__ == "__main__":
    command_line(app)
