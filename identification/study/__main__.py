"""`fasbody study`: the command of command.py."""

from fasbody.console import command_line, heeded, run_app


def start() -> None:
    """Import the command and run it; the import takes a second or two, in which Ctrl-C is answered already."""
    with heeded():
        from identification.study.command import app
    run_app(app)


if __name__ == "__main__":
    command_line(start)
