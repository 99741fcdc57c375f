"""`fasbody heel`: the command of fasbody/heel."""

from fasbody.console import command_line, heeded, run_app


def start() -> None:
    """Run the command; Ctrl-C is answered while it is imported, which takes a second or two."""
    with heeded():
        from fasbody.heel.command import app
    run_app(app)


if __name__ == "__main__":
    command_line(start)
