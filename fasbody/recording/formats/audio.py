"""Sound files, .wav and .flac, by soundfile: `channel_1`, `channel_2` ..., in shares of full scale, with their rate."""

from pathlib import Path

from fasbody.recording.formats.series import Series, check_size, remarks

LIBRARY = "soundfile"


def decode(file: Path) -> list[Series]:
    """Every channel; a sound file has no unit, so study.toml states unit and sensitivity."""
    import soundfile

    with soundfile.SoundFile(str(file)) as source:
        check_size(float(source.frames) * source.channels, source.channels)
        values = source.read(dtype="float64", always_2d=True)
        rate, words = float(source.samplerate), source.copy_metadata()  # such as RIFF's comment
    columns = [
        Series(f"channel_{i + 1}", "", values[:, i].copy(), rate) for i in range(values.shape[1])
    ]
    return columns + remarks(words)
