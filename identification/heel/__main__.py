"""`python -m identification.heel`: the command of command.py."""

from fasbody.console import command_line, heeded


def start() -> None:
    """Import the command and run it; the import takes a second or two, in which Ctrl-C is answered already."""
    with heeded():
        from identification.heel.command import app
    app()


if __name__ == "__main__":
    command_line(start)
