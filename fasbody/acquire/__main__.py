"""`fasbody record`: from the shaker to a study folder."""

from fasbody.console import command_line


def main() -> None:
    """Import the commands here, so that a missing extra is one sentence and no traceback."""
    from fasbody.acquire.commands import run

    run()


if __name__ == "__main__":
    command_line(main)
