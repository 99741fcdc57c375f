"""Mutated files for every reader: `python benchmarks/fuzz_readers.py 2000`, or of some endings, `... 2000 c3d xlsx`.

Each file is a sound recording with bytes flipped, blocks cut, repeated, or replaced by extreme numbers, or the file of
another format under the wrong name. A reader must answer with a recording or with an InputFileError, within its time
and memory, and stay usable. Deterministic for a seed.
"""

import gzip
import random
import resource
import sys
import tempfile
import time
import zipfile
from collections import Counter
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import numpy as np

from fasbody.exceptions import FasError
from fasbody.recording import files
from fasbody.recording.channels import Channel, Layout

ENDINGS: tuple[str, ...] = (
    "csv",
    "excel.csv",
    "logger.csv",
    "mat",
    "h5",
    "uff",
    "tdms",
    "v73.mat",
    "lvm",
    "csv.gz",
    "tdms.gz",
    "nc",
    "npz",
    "zip",
    "takes.csv",
)
#: Formats whose libraries may be missing.
ENDINGS += tuple(
    ending
    for ending, library in {
        "xlsx": "openpyxl",
        "wav": "soundfile",
        "flac": "soundfile",
        "c3d": "ezc3d",
        "parquet": "pyarrow",
        "edf": "edfio",
    }.items()
    if find_spec(library)
)
#: Channels and units of a valid file whose format does not state them.
_SOUND = Layout({name: Channel(f"channel_{i}", "m/s^2") for i, name in enumerate(("base", "malleolus"), 1)})
_EXTREMES = (
    b"\x00" * 8,
    b"\xff" * 8,
    b"\xff\xff\xff\x7f",
    b"\x00\x00\x00\x80",
    b"1e999",
    b"-1",
    b"99999999999",
    b"nan",
)


def sound(samples: int = 200) -> dict[str, bytes]:
    """A small recording in every format and dialect, by ending."""
    t = np.arange(samples) / 1000
    base = 8.95 * np.sin(2 * np.pi * 20 * t)
    channels = {"time_s": t, "base_m_s2": base, "malleolus_m_s2": 1.3 * base, "tuberosity_m_s2": 1.2 * base}
    made = {}
    with tempfile.TemporaryDirectory() as folder:
        for ending in ("mat", "h5", "uff", "tdms", "v73.mat"):
            file = Path(folder) / f"sound.{ending}"
            files.write(file, channels, matlab="7.3" if ending == "v73.mat" else "5")
            made[ending] = file.read_bytes()
    rows = ["\t".join(f"{v:.6g}" for v in row) for row in zip(*channels.values(), strict=True)]
    plain = "\n".join(["\t".join(channels), *rows, ""])
    units = "time\tbase\tmalleolus\ttuberosity\ns\tm/s²\tm/s²\tm/s²\n" + "\n".join([*rows, ""])
    excel = "Gerät 4711; von Hand\n\n" + units.replace(".", ",").replace("\t", ";").replace("\n", "\r\n")
    logger = "# Gerät 4711\n" + units.replace("\t", "|") + "# Ende\n"
    made |= {"csv": plain.replace("\t", ",").encode(), "excel.csv": excel.encode("utf-16")}
    made |= {"csv.gz": gzip.compress(made["csv"], mtime=0), "tdms.gz": gzip.compress(made["tdms"], mtime=0)}
    names = {"time_s": "X_Value", "base_m_s2": "base", "malleolus_m_s2": "malleolus", "tuberosity_m_s2": "tuberosity"}
    head = ["LabVIEW Measurement", "Separator\tTab", "X_Columns\tOne", "***End_of_Header***", "", "Channels\t3"]
    head += [
        "Y_Unit_Label" + 3 * "\tm/s^2",
        "Delta_X" + 3 * "\t0.001",
        "***End_of_Header***",
        "\t".join(names.values()),
    ]
    made |= {"lvm": "\n".join([*head, *rows, ""]).encode(), "logger.csv": logger.encode("latin-1")}
    return made | {
        ending: _read_only(ending, channels)
        for ending in ENDINGS
        if ending in ("xlsx", "wav", "flac", "c3d", "nc", "npz", "zip", "takes.csv", "parquet", "edf")
    }


def _read_only(ending: str, channels: dict[str, np.ndarray]) -> bytes:
    """A recording in a format that only its library writes."""
    file = BytesIO()
    table = np.column_stack(list(channels.values()))
    if ending == "npz":
        np.savez_compressed(file, allow_pickle=False, **channels)
        return file.getvalue()
    if ending == "nc":
        from scipy.io import netcdf_file

        with netcdf_file(file, "w") as out:
            out.createDimension("time", table.shape[0])
            for name, values in channels.items():
                out.createVariable(name, "f8", ("time",))[:] = values
            out.flush()
            return file.getvalue()
    if ending == "xlsx":
        import openpyxl

        book = openpyxl.Workbook()
        book.active.append(list(channels))
        for row in table.tolist():
            book.active.append(row)
        book.save(file)
        return file.getvalue()
    if ending in ("zip", "takes.csv"):
        rows = "".join(",".join(f"{v:.6g}" for v in row) + "\n" for row in table)
        text = f"Interval= 0.001 s\nGain 10 1\n{','.join(channels)}\n{rows}\nTrajectories\n100\nFrame,X,Y,Z\n"
        text += rows[: len(rows) // 2]
        if ending == "takes.csv":
            return text.encode()
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
            packed.writestr("Accelerometer.csv", text)
            packed.writestr("meta/device.csv", "property,value\n")
        return file.getvalue()
    if ending == "parquet":
        import pandas as pd

        pd.DataFrame(channels).to_parquet(file)
        return file.getvalue()
    if ending == "edf":
        import edfio

        signals = [edfio.EdfSignal(v, 1000, label=n.removesuffix("_m_s2"), physical_dimension="m/s^2")
                   for n, v in channels.items() if n != "time_s"]  # fmt: skip
        edfio.Edf(signals, data_record_duration=0.1).write(file)
        return file.getvalue()
    if ending in ("wav", "flac"):
        import soundfile

        soundfile.write(file, table[:, 1:] / 40, 1000, format=ending.upper(), subtype="PCM_16")
        return file.getvalue()
    import ezc3d

    made = ezc3d.c3d()
    analog = made["parameters"]["ANALOG"]
    made["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    analog["RATE"]["value"], analog["LABELS"]["value"] = [1000.0], ["base", "malleolus", "tuberosity"]
    analog["UNITS"]["value"] = ["m/s^2"] * 3
    made["data"]["points"], made["data"]["analogs"] = np.zeros((4, 0, table.shape[0] // 10)), table[None, :, 1:].mT
    with tempfile.TemporaryDirectory() as folder:
        made.write(f"{folder}/sound.c3d")
        return (Path(folder) / "sound.c3d").read_bytes()


def mutated(content: bytes, others: list[bytes], rng: random.Random) -> bytes:
    """One damaged file."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        kind = rng.randrange(8)
        # headers matter most: half of the damage goes into the first kilobyte
        at = rng.randrange(max(1, min(len(data), 1024) if rng.random() < 0.5 else len(data)))
        if kind == 0 and data:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1 and data:
            data[at] = rng.randrange(256)
        elif kind == 2:
            del data[at:]
        elif kind == 3:
            del data[at : at + rng.randrange(1, 64)]
        elif kind == 4:
            data[at:at] = data[at : at + rng.randrange(1, 256)]
        elif kind == 5:
            extreme = rng.choice(_EXTREMES)
            data[at : at + len(extreme)] = extreme
        elif kind == 6:
            data[at:at] = bytes(rng.randrange(256) for _ in range(rng.randrange(1, 32)))
        elif rng.random() < 0.05:
            data = bytearray(rng.choice(others))
    return bytes(data)


def fuzz(ending: str, count: int, seed: int = 0, advance: Callable[[], None] = lambda: None) -> Counter[str]:
    """Read `count` mutated files; how many were read, refused, and refused because the reading process ended.

    Any other exception than a FasError is a failure and comes through.
    """
    intact = sound()
    rng = random.Random(f"{ending}{seed}")
    seen: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"fuzz.{ending if ending.endswith('.gz') else ending.rsplit('.')[-1]}"
        for _ in range(count):
            file.write_bytes(mutated(intact[ending], list(intact.values()), rng))
            start = time.monotonic()
            try:
                channels = files.reading(file, _SOUND if ending in ("wav", "flac") else None).channels
                assert {"time_s", "base_m_s2", "malleolus_m_s2"} <= set(channels)
                seen["read"] += 1
            except FasError as error:
                text = str(error)
                assert text.count("\n") == 0 and text.startswith(str(file)), text
                seen[
                    "process ended"
                    if "breaks its reader" in text or "of computing" in text
                    else "too slow"
                    if "within" in text
                    else "refused"
                ] += 1
            seen["slowest, ms"] = max(seen["slowest, ms"], round(1000 * (time.monotonic() - start)))
            advance()
    return seen


def main() -> None:
    """Print what each reader made of its mutated files."""
    from fasbody.console import progress_bar
    from fasbody.recording.formats import reader

    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    for ending in sys.argv[2:] or ENDINGS:
        with progress_bar() as progress:
            bar = progress.add_task(ending, total=count)
            seen = fuzz(ending, count, advance=partial(progress.advance, bar))
        reader.end_child()  # so that the system counts its memory
        child = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        parent = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        memory = f"peak memory so far {parent:.0f} MB here, {child:.0f} MB reading"
        print(f"{ending:8} {count} files: {dict(seen)}; {memory}")


if __name__ == "__main__":
    main()
