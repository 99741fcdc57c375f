"""Nuisance parameters: what may be true of a recording beside the model, each with a prior, a unit and a source.

A fit that trusts masses, instruments and laws to the last digit is surer than anyone can be. Here the same recordings
are described by the model and by what a laboratory seldom excludes. Each nuisance is a variable of the one
least-squares problem, with a row of its own for the prior.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fasbody.presentation import Tabled
from fasbody.recording.known import Known
from fasbody.recording.recording import Recording, gain_and_delay
from identification.branches import EXCHANGED
from identification.sensors import MALLEOLUS

_SEGMENTS = "body-segment tables differ by 5 to 11 % between samples"
_SEATED = "as for the foot; in addition, a seated leg carries some of the thigh"
_NOBODY = "no body mass was stated; adults differ by 20 %, segments by another 10 %"
_MOUNT = "a skin-mounted sensor overestimates bone by 12 % at 15 to 30 Hz, J Biomech Eng 115:47 (1993)"
_ROCK = "transverse sensitivity of accelerometers up to 5 %, and the lever arm of the sensor"
_PAD = "the heel pad loses 30 % of its energy a cycle, Ker (1996)"
_SITS = "assumed: after sitting down again, a person's recordings repeat to 2 to 5 %"
_SHARE = "thigh and chair carry a part of a load on the knee; we know of no measurement"
_PLATE = "static force with and without the load, from study.toml"
#: Relative standard deviations of the segments' masses where nothing else is said.
SHANK_STD, FOOT_STD = 0.15, 0.10
#: The same where no body mass was given, and the bound of its logarithm.
_UNKNOWN_STD, _UNKNOWN_END = 0.30, 1.2
#: Default uncertainty of a gain (share), and of a delay in samples.
_GAIN_STD, _DELAY_SAMPLES = 0.01, 0.1
#: Standard deviation of a constant's change under 2.3 kg (share). A pad whose force grows as deformation^2.6 (walkers'
#: heels: 2.87 and 3.48, docs/heel_pad.md) would change by 30 % from the leg's weight alone, three of these.
_LOAD_STD, _LOAD_KG = 0.10, 2.3
#: Standard deviation of a constant from one seating to the next (share).
_SEATING_STD = 0.05
#: Standard deviation of the load's share where a plate has weighed it.
_WEIGHED_STD = 0.02


@dataclass(frozen=True)
class Nuisance(Tabled):
    """One thing that may be true beside the model.

    Attributes:
        kind: what it is: "shank mass", "gain", "mount", "load share", ...
        group: what is excluded together (`Known.excluded`).
        unit: of its value, "" for a share.
        mean: of the prior; that of the natural logarithm where it is logarithmic.
        std: standard deviation of the prior, likewise.
        lower: bound, likewise; a half-normal prior has its mean there.
        upper: bound, likewise.
        source: where the prior comes from.
        does: to the recordings.
        logarithmic: whether mean, std and bounds are of the logarithm of the value.
        constant: thesis symbol of the constant that it changes, "" for none.
        sensor: whose it is, "" for all.
        person: whose it is, None for everybody.
        load_kg: under which it acts, None for all.
        seating: in which it acts, "" for all.
    """

    kind: str
    group: str
    unit: str
    mean: float
    std: float
    lower: float
    upper: float
    source: str
    does: str
    logarithmic: bool = False
    constant: str = ""
    sensor: str = ""
    person: str | None = None
    load_kg: float | None = None
    seating: str = ""

    @property
    def name(self) -> str:
        """Its name in tables and result.json."""
        if self.load_kg is not None:
            return f"{self.constant} under {self.load_kg:g} kg"
        if self.seating:
            return " of ".join(filter(None, (f"{self.constant} in seating {self.seating}", self.person)))
        if self.constant:
            return f"{self.kind} {self.constant}"
        whose = self.person if self.person is not None else self.sensor
        if whose in ("", *MALLEOLUS) and self.person is None:
            return self.kind
        return f"{self.kind} of {whose or 'unnamed'}"

    def value(self, x: float) -> float:
        """The value in its unit."""
        return float(np.exp(x)) if self.logarithmic else float(x)


def _log(kind: str, group: str, unit: str, value: float, std: float, low: float, high: float, source: str, does: str,
         constant: str = "") -> Nuisance:  # fmt: skip
    numbers = (float(np.log(value)), std, float(np.log(low)), float(np.log(high)))
    return Nuisance(kind, group, unit, *numbers, source, does, True, constant)


#: Of the instrument, one of each for every accelerometer.
OF_SENSOR = (
    Nuisance("gain", "gain", "", 0.0, _GAIN_STD, -0.2, 0.2, "calibration certificates state 1 to 3 %",
             "relative gain error between the channels of {sensor} and base"),
    Nuisance("delay", "delay", "s", 0.0, 1e-4, -2e-3, 2e-3, "multiplexed converter",
             "delay of the channel {sensor} after the base"),
    Nuisance("drift", "drift", "", 0.0, 0.01, -0.2, 0.2, "as for the gain",
             "relative change of the gain from the first to the last recording"),
    Nuisance("mount", "mount", "s^2", 0.0, 1e-4, 0.0, 3e-3, _MOUNT,
             "1/f^2, where f is the resonance of the sensor on soft tissue"),
    Nuisance("mount damping", "mount", "", 0.2, 0.1, 0.02, 0.6, _MOUNT, "damping ratio of this resonance"),
    Nuisance("rocking", "rocking", "", 0.0, 0.03, -0.5, 0.5, _ROCK,
             "acceleration by rotation of the leg, relative to the base"),
)  # fmt: skip
#: Of the leg, which rocks as one body.
OF_LEG = (
    _log("rocking frequency", "rocking", "Hz", 60, 0.4, 20, 150,
         "legs rock at tens of hertz; we know of no measurement", "resonance of this rotation"),
    Nuisance("rocking damping", "rocking", "", 0.1, 0.05, 0.01, 0.5, "as for soft tissue",
             "damping ratio of this rotation"),
)  # fmt: skip
#: Of the springs of the two-mass foot.
OF_SPRINGS = (
    Nuisance("relaxing", "relaxation", "", 0.0, 0.35, 0.0, 3.0, _PAD, "relaxing stiffness, relative to k_T at rest",
             constant="k_T"),
    Nuisance("relaxing", "relaxation", "", 0.0, 0.35, 0.0, 3.0, _PAD, "relaxing stiffness, relative to k_F at rest",
             constant="k_F"),
    _log("relaxation time", "relaxation", "s", 5e-3, float(np.log(2)), 5e-4, 5e-2,
         "10 to 50 Hz resolve one relaxation time", "relaxation time of both springs"),
)  # fmt: skip


def nuisances(
    recordings: Sequence[Recording],
    known: Known,
    declared: Sequence[str],
    two_mass: bool,
    sensors: Sequence[str] = MALLEOLUS,
    delay: bool = True,
) -> tuple[Nuisance, ...]:
    """What may be true of these recordings beside the model.

    Args:
        recordings: in the order of the session.
        known: what a laboratory or a user has said.
        declared: masses that the model declares.
        two_mass: the model is the two-mass foot, whose springs may relax and follow the load.
        sensors: that are fitted.
        delay: whether the recordings tell a delay from damping.
    """
    items = [*_masses(recordings, known, declared), *_shares(recordings, known, declared)]
    for sensor in sensors:
        items += _of_sensor(recordings, known, sensor)
    items += OF_LEG
    if two_mass:
        items += [*OF_SPRINGS, *_following(recordings), *_seated(recordings)]
    return tuple(
        item for item in items if item.std > 0 and item.group not in known.excluded and (delay or item.kind != "delay")
    )


def _of_sensor(recordings: Sequence[Recording], known: Known, sensor: str) -> list[Nuisance]:
    """The instrument's, with the standard deviations that the recordings or the user state."""
    sample = _DELAY_SAMPLES / min(recording.rate_hz for recording in recordings)
    stated = np.array([gain_and_delay(recording, sensor, "base") for recording in recordings]).max(axis=0)
    gain, delay = (float(s) if s > 0 else usual for s, usual in zip(stated, (_GAIN_STD, sample), strict=True))
    sizes = {
        "gain": gain if known.gain_std is None else known.gain_std,
        "delay": delay if known.delay_std_s is None else known.delay_std_s,
    }
    return [
        replace(item, sensor=sensor, std=sizes.get(item.kind, item.std), does=item.does.format(sensor=sensor))
        for item in OF_SENSOR
    ]


def _people(recordings: Sequence[Recording]) -> list[str | None]:
    """Whom a scale and a table may be wrong for; one person needs no name."""
    people = list(dict.fromkeys(recording.condition.subject for recording in recordings))
    return list(people) if len(people) > 1 else [None]


def stated_mass(recordings: Sequence[Recording], person: str | None) -> bool:
    """Whether somebody said what a person weighs; else the model's own masses stand in."""
    return all(
        recording.condition.body_mass_kg is not None
        for recording in recordings
        if person in (None, recording.condition.subject)
    )


def _masses(recordings: Sequence[Recording], known: Known, declared: Sequence[str]) -> list[Nuisance]:
    """Segments' masses, a pair for each person."""
    items = []
    for person in _people(recordings):
        for kind, symbols, std, source in (
            ("shank mass", {"m_S", "m_T"}, SHANK_STD, _SEATED),
            ("foot mass", {"m_F"}, FOOT_STD, _SEGMENTS),
        ):
            if not symbols & set(declared):
                continue
            end = 0.7
            if known.mass_std is not None:
                std = known.mass_std
            elif not stated_mass(recordings, person):
                std, end, source = _UNKNOWN_STD, _UNKNOWN_END, _NOBODY
            does = "factor on m_S, without the load" if kind == "shank mass" else "factor on m_F"
            items.append(
                Nuisance(kind, "masses", "", 0.0, std, -end, end, source, does, logarithmic=True, person=person)
            )
    return items


def _shares(recordings: Sequence[Recording], known: Known, declared: Sequence[str]) -> list[Nuisance]:
    """How much of a load on the knee the leg carries, for each person who had one."""
    if not {"m_S", "m_T", "added_mass"} & set(declared):
        return []
    items = []
    for person in _people(recordings):
        loads = [
            recording.condition.added_mass_kg
            for recording in recordings
            if person in (None, recording.condition.subject)
        ]
        if max(loads, default=0.0) > 0:
            item = Nuisance("load share", "share", "", 1.0, 0.15, 0.4, 1.0, _SHARE,
                            "share of the added mass that the leg carries", person=person)  # fmt: skip
            if known.load_share is not None:
                item = replace(item, mean=known.load_share, std=_WEIGHED_STD, upper=1.2, source=_PLATE)
            items.append(item)
    return items


def _following(recordings: Sequence[Recording]) -> list[Nuisance]:
    """How stiffness and damping change under each load beyond the smallest."""
    first, *others = sorted({recording.condition.added_mass_kg for recording in recordings})
    text = "chosen here: 10 % under 2.3 kg, in proportion to the load; a heel pad in walking would change by up to 29 %"
    return [
        Nuisance("under load", "load", "", 0.0, _LOAD_STD * (load - first) / _LOAD_KG, -1.0, 1.0, text,
                 f"factor on {name}, relative to {first:g} kg", logarithmic=True, constant=name, load_kg=load)
        for load in others
        for name in EXCHANGED
    ]  # fmt: skip


def _seated(recordings: Sequence[Recording]) -> list[Nuisance]:
    """How stiffness and damping of each seating of several recordings differ from those of the median one.

    A seating of one recording has no more to say than the scatter from recording to recording.
    """
    several = len(_people(recordings)) > 1
    conditions = [recording.condition for recording in recordings]
    seatings = Counter((c.subject if several else None, c.seating) for c in conditions if c.seating)
    if len(seatings) < 2:
        return []
    return [
        Nuisance("seating", "seating", "", 0.0, _SEATING_STD, -0.5, 0.5, _SITS, f"factor on {name}",
                 logarithmic=True, constant=name, person=person, seating=seating)
        for (person, seating), count in seatings.items() if count > 1
        for name in EXCHANGED
    ]  # fmt: skip
