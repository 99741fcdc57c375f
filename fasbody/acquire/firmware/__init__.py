"""The firmware of a board with an ATmega328P (Arduino Uno, Nano), as a sketch for the Arduino IDE.

`fasbody record --firmware FOLDER` writes it out. docs/acquisition.md has the wiring and the parts.
"""

from pathlib import Path

from fasbody.console import write_whole
from fasbody.exceptions import InputFileError

#: The sketch; the IDE needs it in a folder of the same name.
SKETCH = Path(__file__).parent / "fas_board" / "fas_board.ino"


def write(folder: Path) -> Path:
    """Write the sketch into `folder`/fas_board; returns the file."""
    file = folder / SKETCH.parent.name / SKETCH.name
    text = SKETCH.read_text()
    if file.is_file() and file.read_text(errors="replace") != text:
        raise InputFileError(file, "is there already, with changes", "name another folder")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, text)
    except OSError as error:
        raise InputFileError(file, f"cannot be written ({error.strerror})", "name a writable folder") from None
    return file
