"""Layouts of makers and databases as they write them, at once or with five lines of study.toml."""

import tomllib
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from fasbody.exceptions import InputFileError, RecordingError
from fasbody.recording.checks import checked, understood
from fasbody.recording.recording import Recording
from fasbody.recording.trials import parsed

T = np.arange(3000) / 1000
LATE = T + 0.0004
START = datetime(2026, 3, 2, 10, 11, 12)


def motion(time_s: np.ndarray, size: float = 1.0, lag: float = 0.0) -> np.ndarray:
    return 8 * size * np.sin(2 * np.pi * 20 * time_s - lag)


BASE, MALLEOLUS = motion(T), motion(T, 1.5, 0.6)
HEAD = "time_s,base_m_s2,malleolus_m_s2\n"


def read(file: Path, text: str, toml: str = "") -> Recording:
    file.write_text(text, encoding="utf-8")
    return Recording.read(file, layout=parsed(file.parent / "study.toml", tomllib.loads(toml))[1])


def right(recording: Recording, sound: bool = True) -> None:
    row = understood(recording)
    assert row["transmissibility"] == pytest.approx(1.5, rel=1e-3)
    assert row["phase_deg"] == pytest.approx(-np.degrees(0.6), abs=0.1)
    assert row["frequency_hz"] == pytest.approx(20, abs=0.01)
    assert not sound or recording.warnings == ()


def stamp(form: str) -> list[str]:
    times = [START + timedelta(milliseconds=count) for count in range(T.size)]
    return [f"{time:{form}}.{time.microsecond // 1000:03d}" for time in times]


def rows(*columns: object, mark: str = ",") -> str:
    cells = [[x if isinstance(x, str) else f"{x:.5f}" for x in column] for column in columns]
    return "".join(mark.join(row) + "\n" for row in zip(*cells, strict=True))


def counted(start: int = 0) -> list[str]:
    return [str(count) for count in range(start, start + T.size)]


def labchart(units: str = "UnitName=\tm/s^2\tm/s^2\n", span: str = "10.000 V") -> str:
    lines = rows(T, BASE, MALLEOLUS, mark="\t").splitlines()
    lines[700] += "\t#* shaker on "
    return (
        "Interval=\t0.001 s\nExcelDateTime=\t4.6083424444444441e+04\t3/2/26 10:11:12.000000\n"
        "TimeFormat=\tStartOfBlock\nDateFormat=\t\nChannelTitle=\tbase\tmalleolus\n"
        f"Range=\t{span}\t{span}\n{units}" + "\n".join(lines) + "\n"
    )


def yokogawa() -> str:
    lines = (
        "Header Size,16",
        "Model Name,DL850E",
        "Comment,",
        "BlockNumber,1",
        "TraceName,base,malleolus",
        "BlockSize,3000,3000",
        "VUnit,m/s2,m/s2",
        "SampleRate,1.0E+03,1.0E+03",
        "HResolution,1.0E-03,1.0E-03",
        "HOffset,0.0E+00,0.0E+00",
        "HUnit,s,s",
        "DisplayBlockSize,3000,3000",
        "DisplayPointNo.,1,1",
        "Date,2026/03/02,2026/03/02",
        "Time,10:11:12.00,10:11:12.00",
    )
    quoted = (f'"{line.partition(",")[0]}",{line.partition(",")[2]}' for line in lines)
    return "\n".join(quoted) + "\n\n" + rows([""] * T.size, BASE, MALLEOLUS)


def toa5() -> str:
    head = (
        '"TOA5","CR1000X","CR1000X","1234","CR1000X.Std.05.01","CPU:vib.CR1X","4711","Vib"\n'
        '"TIMESTAMP","RECORD","base","malleolus"\n"TS","RN","m/s^2","m/s^2"\n"","","Smp","Smp"\n'
    )
    return head + rows([f'"{at}"' for at in stamp("%Y-%m-%d %H:%M:%S")], counted(), BASE, MALLEOLUS)


def influx() -> str:
    head = (
        "#datatype,string,long,dateTime:RFC3339,double,string,string,string\n#group,false,false,false,false,true,true,"
        "true\n#default,_result,,,,,,\n,result,table,_time,_value,_field,_measurement,unit\n"
    )
    times = [f"{at}Z" for at in stamp("%Y-%m-%dT%H:%M:%S")]
    tables = [
        rows(
            *([x] * T.size for x in ("", "", str(place))),
            times,
            values,
            *([x] * T.size for x in (name, "vibration", "m/s2")),
        )
        for place, (name, values) in enumerate((("base", BASE), ("malleolus", MALLEOLUS)))
    ]
    return "\n".join(head + table for table in tables)


def melted() -> str:
    """As R and pandas melt a table."""
    both = [
        rows(T, [name] * T.size, values)
        for name, values in (("base_g", BASE), ("malleolus_g", MALLEOLUS))
    ]
    return "time_s,variable,value\n" + "".join(both)


def grafana() -> str:
    cells = [[f'"{x:.4f} m/s²"' for x in values] for values in (BASE, MALLEOLUS)]
    return '"Time","base","malleolus"\n' + rows(
        [f'"{at}"' for at in stamp("%Y-%m-%d %H:%M:%S")], *cells
    )


def epochs() -> str:
    times = [str(1_772_446_272_000 + count) for count in range(T.size)]
    return '"Time","A-series","{sensor=""ankle""}"\n' + rows(times, BASE, MALLEOLUS)


def opensignals() -> str:
    head = (
        '# OpenSignals Text File Format. Version 1\n# {"00:07:80:3B": {"sensor": ["ACC", "ACC"], "device name": '
        '"00:07:80:3B", "column": ["nSeq", "DI", "CH1", "CH2"], "sync interval": 2, "time": "10:11:12.0", "date": '
        '"2026-3-2", "comments": "", "device": "biosignalsplux", "channels": [1, 2], "sampling rate": 1000, '
        '"resolution": [16, 16], "label": ["CH1", "CH2"]}}\n# EndOfHeader\n'
    )
    counts = [[str(round(32768 + 557 * x)) for x in values] for values in (BASE, MALLEOLUS)]
    return head + rows(counted(), ["0"] * T.size, *counts, [""] * T.size, mark="\t")


def graphtec(model: str, head: str, *columns: object) -> str:
    above = (
        f"Vendor,GRAPHTEC Corporation\nModel,{model}\nVersion,Ver1.35,Rev0001\nMaxChannel,8\nSampling interval,1ms\n"
        "Total data points,3000\nTrigger,0\nStart time,2026/03/02,10:11:12\nEnd time,2026/03/02,10:11:15\n"
        "AMP settings\nCH,Signal name,Amp,Input,Range,Filter,Span,,Unit\nCH1,base,M,DC,5V,Off,100,-100,m/s2\n"
        "CH2,malleolus,M,DC,5V,Off,100,-100,m/s2\nData\n"
    )
    alarm = ["LLLLLLLLLL"] * T.size
    signed = ([f"{x:+.4f}" for x in values] for values in (BASE, MALLEOLUS))
    return above + head + rows(counted(1), *columns, *signed, alarm)


def gl840() -> str:
    times = [at[:-4] for at in stamp("%Y/%m/%d %H:%M:%S")]
    fraction = [str(count % 1000) for count in range(T.size)]
    head = "Number,Date&Time,ms,CH1,CH2,Alarm1-10\nNO.,Time,ms,m/s2,m/s2,A1234567890\n"
    return graphtec("GL840", head, times, fraction)


def gl980() -> str:
    days, times = (
        [at.split()[part][: 10 - 2 * part] for at in stamp("%Y/%m/%d %H:%M:%S")] for part in (0, 1)
    )
    fraction = [str(count % 1000 * 1000) for count in range(T.size)]
    return graphtec("GL980", "Number,Date,Time,us,CH1,CH2,Alarm\n", days, times, fraction)


def timetable() -> str:
    """As MATLAB's writetimetable writes durations."""
    return "Time,base_m_s2,malleolus_m_s2\n" + rows([f"{t:.3f} sec" for t in T], BASE, MALLEOLUS)


def dated() -> str:
    return "Time,base_m_s2,malleolus_m_s2\n" + rows(stamp("%d-%b-%Y %H:%M:%S"), BASE, MALLEOLUS)


CHANNELS = '[channels]\nbase = {{column = "{}"{more}}}\nmalleolus = {{column = "{}"{more}}}\n'
PLUX = '[study]\ncolumns = ["n", "DI", "CH1", "CH2"]\n' + CHANNELS.format(
    "CH1", "CH2", more=', unit = "counts", sensitivity = 557'
)


@pytest.mark.parametrize(
    ("ending", "made", "toml"),
    [
        (".txt", labchart, ""),
        (".csv", yokogawa, ""),
        (".dat", toa5, ""),
        (".csv", influx, ""),
        (".csv", melted, ""),
        (".csv", grafana, ""),
        (".csv", timetable, ""),
        (".csv", dated, ""),
        (".txt", opensignals, PLUX),
        (
            ".csv",
            epochs,
            CHANNELS.format("A-series", '{sensor=\\"ankle\\"}', more=', unit = "m/s^2"'),
        ),
        (".csv", gl840, CHANNELS.format("CH1", "CH2", more="")),
        (".csv", gl980, CHANNELS.format("CH1", "CH2", more=', unit = "m/s^2"')),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_layout_is_read(tmp_path: Path, ending: str, made: Callable[[], str], toml: str) -> None:
    right(read(tmp_path / f"r{ending}", made(), toml))
    assert len(toml.strip().splitlines()) <= 5


def test_rows_of_keys_state_units_and_rates(tmp_path: Path) -> None:
    with pytest.raises(
        InputFileError, match="base is in V"
    ):  # the range is in the unit of the numbers
        read(tmp_path / "r.txt", labchart(""))
    right(read(tmp_path / "a.txt", labchart("", "100 m/s^2")))
    told = read(
        tmp_path / "b.csv", yokogawa().replace('"HOffset",0.0E+00,0.0E+00', '"Invert",OFF,ON')
    )
    assert any("'Invert,OFF,ON', which is not applied" in text for text in told.warnings)


def test_a_row_of_words_below_the_headings_is_no_sample_and_is_quoted(tmp_path: Path) -> None:
    told = read(
        tmp_path / "a.csv",
        f"time,base,malleolus\ns,m/s²,m/s²\n,raw,LP 20 Hz\n{rows(T, BASE, MALLEOLUS)}",
    )
    right(told, sound=False)
    assert "',raw,LP 20 Hz', which is not applied" in told.warnings[0]
    with pytest.raises(
        InputFileError, match="base_m_s2 is 'raw', not a number"
    ):  # a sample among others
        read(tmp_path / "b.csv", f"{HEAD}{rows(T[:9], BASE[:9], MALLEOLUS[:9])}0.009,raw,1\n")


def test_units_in_cells_that_change_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="base_m_s2 is '900 mm/s²', not a number"):
        read(tmp_path / "a.csv", grafana().replace(f"{BASE[40]:.4f} m/s²", "900 mm/s²", 1))
    with pytest.raises(InputFileError, match=r"base is in m/s².*its heading says g"):
        read(tmp_path / "b.csv", grafana().replace('"base"', '"base [g]"'))


def test_a_long_table_has_what_it_says_of_each_sensor(tmp_path: Path) -> None:
    other = (
        melted().replace("value\n", "value,gain\n", 1).replace("base_g,", "base_g,").splitlines()
    )
    gains = [
        line if not place else f"{line},{2 if 'mal' in line else 1}"
        for place, line in enumerate(other)
    ]
    with pytest.raises(InputFileError, match="gain = 2 with 'malleolus_g'"):
        read(tmp_path / "a.csv", "\n".join(gains))
    answered = "[channels.malleolus]\ncolumn = 'malleolus_g'\nsensitivity = 1\n"
    right(read(tmp_path / "b.csv", "\n".join(gains), answered), sound=False)
    with pytest.raises(
        InputFileError,
        match=r"has no column 'malleolus_m_s2' \(found: time_s, base_g, time_s, foot_g",
    ):
        read(tmp_path / "c.csv", melted().replace("malleolus_g", "foot_g"))
    with pytest.raises(InputFileError, match="line 2: its value or time is 'x', not a number"):
        read(tmp_path / "d.csv", melted().replace(f"{BASE[0]:.5f}", "x", 1))
    twice = melted().replace("value\n", "value,axis\n", 1).splitlines()
    axes = [line if not place else f"{line},{'xz'[place % 2]}" for place, line in enumerate(twice)]
    with pytest.raises(
        InputFileError, match="'base_g' is several channels, which the column 'axis' disting"
    ):
        read(tmp_path / "f.csv", "\n".join([axes[0], *sorted(axes[1:]), *axes[1:]]))
    wide = f"{HEAD[:-1]},channel,value\n{rows(T, BASE, MALLEOLUS, counted(), counted())}"
    right(read(tmp_path / "e.csv", wide))


def test_whole_seconds_without_the_rest_are_no_time(tmp_path: Path) -> None:
    toml = CHANNELS.format("CH1", "CH2", more=', unit = "m/s^2"')
    bare = (
        gl840()
        .replace("Number,Date&Time,ms,", "Number,Date&Time,no,")
        .replace("NO.,Time,ms", "NO.,Time,n")
    )
    with pytest.raises(RecordingError, match=r"time is not uniform|does not increase"):
        checked(read(tmp_path / "a.csv", bare, toml))


@pytest.mark.parametrize("order", ["tb,b,tm,m", "tb,tm,b,m", "b,m,tm,tb", "b,tb,m,tm"])
@pytest.mark.parametrize(
    ("before", "unit", "size"), [("time", "s", 1.0), ("time", "ms", 1e3), ("t", "us", 1e6)]
)
def test_a_clock_of_each_sensor_by_its_name(
    tmp_path: Path, order: str, before: str, unit: str, size: float
) -> None:
    columns = {"tb": size * T, "tm": size * LATE, "b": BASE, "m": motion(LATE, 1.5, 0.6)}
    names = {
        "tb": f"{before}_base_{unit}",
        "tm": f"{before}_mal_{unit}",
        "b": "base_m_s2",
        "m": "malleolus_m_s2",
    }
    keys = order.split(",")
    head = ",".join(names[key] for key in keys)
    right(read(tmp_path / "a.csv", f"{head}\n{rows(*(columns[key] for key in keys))}"))


@pytest.mark.parametrize("mark", [-999.0, 9999.0, -32768.0])
def test_codes_of_missing_samples_are_not_a_sensor_that_stands_still(mark: float) -> None:
    generator = np.random.default_rng(1)
    noisy = MALLEOLUS + 0.05 * generator.normal(size=T.size)
    coded = noisy.copy()
    coded[generator.choice(T.size, 20, replace=False)] = mark
    with pytest.raises(
        RecordingError, match=f"malleolus_m_s2 is {mark:g} m/s.2 at 20 places.*code for missing"
    ):
        checked(Recording.from_arrays(T, BASE, coded))
    noisy[1000:1500] *= 0.01
    with pytest.raises(RecordingError, match="malleolus_m_s2 stands still"):
        checked(Recording.from_arrays(T, BASE, noisy))
