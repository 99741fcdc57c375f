"""Sound files, .wav and .flac, by soundfile: `channel_1`, `channel_2` ..., in shares of full scale, with their rate."""

from pathlib import Path

from fasbody.recording.formats.series import Series, check_size

LIBRARY = "soundfile"


def decode(file: Path) -> list[Series]:
    """Every channel; a sound file has no unit, so study.toml states unit and sensitivity."""
    import soundfile

    with soundfile.SoundFile(str(file)) as source:
        check_size(float(source.frames) * source.channels, source.channels)
        values = source.read(dtype="float64", always_2d=True)
        rate = float(source.samplerate)
    return [Series(f"channel_{i + 1}", "", values[:, i].copy(), rate) for i in range(values.shape[1])]
