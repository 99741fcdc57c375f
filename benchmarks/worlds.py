"""Feet in worlds that depart from the model, and what their sensors record: a simulator that judges the fit.

It shares no code and no method with what it judges. The motion is periodic, so it is found by collocation: positions
at 63 instants of a period, derivatives by the discrete Fourier transform, Newton's method on the balance of forces at
those instants. What is linear in a departure (springs that relax, a soft mount, rocking) is a factor a harmonic.
tests/test_reality.py compares every world with an integrated differential equation and, where it is linear, with its
closed-form response.

Coordinates are displacements over the moving base, w1 of the shank and w2 of the foot [m], from static equilibrium.
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import circulant

from fasbody.recording.condition import Condition
from fasbody.recording.recording import Recording

FREQUENCIES_HZ = (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0)
#: Segments' share of the body mass, and what the thesis laid on the knee [kg].
SHANK, FOOT, LOADS_KG = 0.0465, 0.0145, (0.0, 2.3, 4.5)
#: Amplitude of the table [m/s^2], sampling rate [Hz], length of a recording [s].
AMPLITUDE, RATE_HZ, SECONDS = 8.95, 1000.0, 2.5
GRAVITY = 9.80665
#: Instants a period: odd, so that no harmonic stands at half the rate.
_INSTANTS = 63
_PASSES, _TOLERANCE = 40, 1e-11


@dataclass(frozen=True)
class Leg:
    """What a leg is: springs [N/m], dampers c1 exp(-c2 x) cos(c3 x) [N s/m, 1/m, 1/m] and masses without load [kg]."""

    k_T: float
    k_F: float
    c_11: float
    c_12: float
    c_13: float
    c_21: float
    c_22: float
    c_23: float
    m_S: float
    m_F: float

    @property
    def stiff_ankle(self) -> bool:
        """Whether k_T is larger than where leg and mirror image are the same."""
        return self.k_T > self.k_F * self.m_S / (self.m_S + self.m_F)


@dataclass(frozen=True)
class Departure:
    """What a world does that the model does not know of; every default is the model's own world.

    Attributes:
        mass: stated body mass over the true one.
        follow: share by which springs and dampers rise under 2.3 kg. follow_power: as a power of the static force on
            the pad, else in proportion to the load.
        relax_T, relax_F: stiffness of a Maxwell element beside each spring, as a share of it; tau_s: its time [s].
        mount_hz, mount_zeta: natural frequency and damping ratio of the malleolus' sensor on tissue; 0: rigid.
        gain, drift: error of the malleolus' gain, and its change over a session, as shares.
        rock, rock_hz, rock_zeta: what the malleolus feels of the leg's rotation, as a share of the base, a mass on a
            spring that base motion excites; rock is its share far above its resonance.
        second: second harmonic of the table, as a share.
        exponential: 1/m, springs k (exp(b x) - 1) / b. cubic: 1/m^2, springs k (x + d x^3).
        unit: factor of all written numbers.
        foot_mount_hz, foot_mount_zeta, foot_gain, foot_drift, foot_rock: the same of a sensor on the foot, where there
            is one; the leg's rotation is one motion.
    """

    mass: float = 1.0
    follow: float = 0.0
    follow_power: bool = False
    relax_T: float = 0.0
    relax_F: float = 0.0
    tau_s: float = 5e-3
    mount_hz: float = 0.0
    mount_zeta: float = 0.2
    gain: float = 0.0
    drift: float = 0.0
    rock: float = 0.0
    rock_hz: float = 60.0
    rock_zeta: float = 0.1
    second: float = 0.015
    exponential: tuple[float, float] = (0.0, 0.0)
    cubic: tuple[float, float] = (0.0, 0.0)
    unit: float = 1.0
    foot_mount_hz: float = 0.0
    foot_mount_zeta: float = 0.2
    foot_gain: float = 0.0
    foot_drift: float = 0.0
    foot_rock: float = 0.0


@dataclass(frozen=True)
class Member:
    """One leg in one world, its session and its seed.

    Attributes:
        world: its name. seed: of everything drawn. leg: the truth. departure: what is not as the model has it.
        loads_kg: recorded loads. noise: standard deviation in a sample over the amplitude of the table.
        strength: of the dampers' nonlinearity, 1: as strong as that of the laboratory's own foot.
        body_kg: true body mass.
    """

    world: str
    seed: int
    leg: Leg
    departure: Departure
    loads_kg: tuple[float, ...]
    noise: float
    strength: float
    body_kg: float
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def loaded(leg: Leg, departure: Departure, load_kg: float) -> Leg:
    """The leg under a load: heavier, and stiffer where the world says so."""
    factor = 1.0 + departure.follow * load_kg / 2.3
    if departure.follow_power and load_kg:
        weight = leg.m_S + leg.m_F
        exponent = np.log(1.0 + departure.follow) / np.log((weight + 2.3) / weight)
        factor = ((weight + load_kg) / weight) ** exponent
    return replace(
        leg, k_T=leg.k_T * factor, k_F=leg.k_F * factor, c_11=leg.c_11 * factor, c_21=leg.c_21 * factor,
        m_S=leg.m_S + load_kg,
    )  # fmt: skip


def _spring(x: np.ndarray, k: float, b: float, d: float) -> tuple[np.ndarray, np.ndarray]:
    """Force and tangent of a spring (n,)."""
    if b:
        return k / b * np.expm1(b * x), k * np.exp(b * x)
    return k * (x + d * x**3), k * (1.0 + 3.0 * d * x**2)


def _damper(x: np.ndarray, c1: float, c2: float, c3: float) -> tuple[np.ndarray, np.ndarray]:
    """Damping and its slope over x (n,)."""
    decay = c1 * np.exp(-c2 * x)
    return decay * np.cos(c3 * x), -decay * (c2 * np.cos(c3 * x) + c3 * np.sin(c3 * x))


def relaxing(s: np.ndarray, share: float, tau_s: float) -> np.ndarray:
    """Stiffness of a Maxwell element over that of the spring beside it, at s = i omega."""
    return share * s * tau_s / (1.0 + s * tau_s)


def mount(s: np.ndarray, hz: float, zeta: float) -> np.ndarray:
    """What a sensor on tissue feels of the bone's acceleration."""
    w = 2.0 * np.pi * hz
    return (w**2 + 2.0 * zeta * w * s) / (s**2 + 2.0 * zeta * w * s + w**2) if hz else np.ones_like(s)


def rocking(s: np.ndarray, share: float, hz: float, zeta: float) -> np.ndarray:
    """What the leg's rotation adds at the malleolus, over the base's acceleration."""
    w = 2.0 * np.pi * hz
    return share * s**2 / (s**2 + 2.0 * zeta * w * s + w**2)


def steady(leg: Leg, departure: Departure, hz: float, base: np.ndarray, instants: int = _INSTANTS) -> np.ndarray:
    """Harmonics (instants // 2,) of the bone's acceleration at the malleolus, from the first [m/s^2]; see `moved`."""
    return moved(leg, departure, hz, base, instants)[0]


def moved(
    leg: Leg, departure: Departure, hz: float, base: np.ndarray, instants: int = _INSTANTS
) -> tuple[np.ndarray, np.ndarray]:
    """Harmonics (instants // 2,) of the accelerations of shank and foot, from the first [m/s^2].

    Args:
        leg: as it is under its load. departure: what its springs do. hz: fundamental.
        base: harmonics (H,) of the base [m/s^2], from the first.

    Raises:
        ArithmeticError: no periodic motion was found.
    """
    n, h = instants, np.fft.fftfreq(instants, 1.0 / instants)
    s = 2j * np.pi * hz * h
    D, A = (circulant(np.fft.ifft(factor).real) for factor in (s, s**2))
    R_T, R_F = (
        circulant(np.fft.ifft(k * relaxing(s, share, departure.tau_s)).real)
        for k, share in ((leg.k_T, departure.relax_T), (leg.k_F, departure.relax_F))
    )
    spectrum = np.zeros(n, complex)
    spectrum[1 : base.size + 1] = base
    a0 = (np.fft.ifft(spectrum) * n).real
    w1, w2 = np.zeros(n), np.zeros(n)
    I = np.eye(n)  # noqa: E741
    J = np.empty((2 * n, 2 * n))
    for _ in range(_PASSES):
        z1, v1, v2 = w1 - w2, D @ (w1 - w2), D @ w2
        (S_T, dS_T), (S_F, dS_F) = (
            _spring(z, k, b, d)
            for z, k, b, d in zip((z1, w2), (leg.k_T, leg.k_F), departure.exponential, departure.cubic, strict=True)
        )
        c_T, dc_T = _damper(z1, leg.c_11, leg.c_12, leg.c_13)
        c_F, dc_F = _damper(w2, leg.c_21, leg.c_22, leg.c_23)
        F_T, F_F = S_T + R_T @ z1 + c_T * v1, S_F + R_F @ w2 + c_F * v2
        K_T = (dS_T + dc_T * v1)[:, None] * I + R_T + c_T[:, None] * D
        K_F = (dS_F + dc_F * v2)[:, None] * I + R_F + c_F[:, None] * D
        r = np.concatenate([leg.m_S * (A @ w1 + a0) + F_T, leg.m_F * (A @ w2 + a0) - F_T + F_F])
        J[:n, :n], J[:n, n:] = leg.m_S * A + K_T, -K_T
        J[n:, :n], J[n:, n:] = -K_T, leg.m_F * A + K_T + K_F
        step = np.linalg.solve(J, r)
        size = np.abs(step).max()
        step *= min(1.0, 2e-3 / max(size, 1e-300))
        w1, w2 = w1 - step[:n], w2 - step[n:]
        if size < _TOLERANCE * max(1e-9, np.abs(w1).max()):
            shank, foot = (2.0 / n * np.fft.fft(a0 + A @ w)[1 : n // 2 + 1] for w in (w1, w2))
            return shank, foot
    raise ArithmeticError(f"no periodic motion at {hz:g} Hz for {leg}")


def felt(
    leg: Leg, departure: Departure, load_kg: float, hz: float, base: np.ndarray, sensor: str = "malleolus"
) -> np.ndarray:
    """Harmonics of what a sensor feels, that of the malleolus or that of the foot, before its gain."""
    d, on_foot = departure, sensor == "foot"
    bone = moved(loaded(leg, d, load_kg), d, hz, base)[int(on_foot)]
    s = 2j * np.pi * hz * np.arange(1, bone.size + 1)
    full = np.zeros_like(bone)
    full[: base.size] = base
    moving = bone + rocking(s, d.foot_rock if on_foot else d.rock, d.rock_hz, d.rock_zeta) * full
    return moving * (mount(s, d.foot_mount_hz, d.foot_mount_zeta) if on_foot else mount(s, d.mount_hz, d.mount_zeta))


def sample(t: np.ndarray, hz: float, harmonics: np.ndarray) -> np.ndarray:
    """A periodic signal (n,) at times t."""
    return np.exp(2j * np.pi * hz * np.outer(t, np.arange(1, harmonics.size + 1))).dot(harmonics).real


def table(rng: np.random.Generator, departure: Departure) -> np.ndarray:
    """Harmonics (3,) of the table's acceleration [m/s^2]: a sine and what a shaker adds."""
    size = AMPLITUDE * np.array([1.0, departure.second, 0.008])
    return size * np.exp(1j * rng.uniform(0, 2 * np.pi, 3))


def recordings(member: Member, frequencies_hz: Sequence[float] = FREQUENCIES_HZ, foot: bool = False) -> list[Recording]:
    """What the laboratory writes: one recording a load and frequency, with the body mass as stated.

    Args:
        member: leg and world. frequencies_hz: of the sines. foot: a second sensor sits on the foot; what the others
            read is the same with it and without.
    """
    second = np.random.default_rng([member.seed, zlib.crc32(member.world.encode()), 2])
    rng = np.random.default_rng([member.seed, zlib.crc32(member.world.encode()), 1])
    d, t = member.departure, np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    each = [(load, hz) for load in member.loads_kg for hz in frequencies_hz]
    made = []
    for number, (load, hz) in enumerate(each):
        base = table(rng, d)
        gain = (1.0 + d.gain) * (1.0 + d.drift * (number / max(1, len(each) - 1) - 0.5))
        clean = sample(t, hz, base), gain * sample(t, hz, felt(member.leg, d, load, hz, base))
        a, y = (d.unit * (x + member.noise * AMPLITUDE * rng.standard_normal(t.size)) for x in clean)
        others = {}
        if foot:
            clean_foot = sample(t, hz, felt(member.leg, d, load, hz, base, "foot"))
            clean_foot *= (1.0 + d.foot_gain) * (1.0 + d.foot_drift * (number / max(1, len(each) - 1) - 0.5))
            others["foot"] = d.unit * (clean_foot + member.noise * AMPLITUDE * second.standard_normal(t.size))
        condition = Condition("made", "midstance", load, member.body_kg * d.mass, hz)
        name = f"{member.world} {member.seed}: {load:g} kg, {hz:g} Hz"
        made.append(Recording(t, a, y, condition=condition, file=name, origin="synthetic", others=others))
    return made


def leg_of(rng: np.random.Generator, body_kg: float, strength: float) -> Leg:
    """A leg of either branch, with resonances where the thesis found them and dampers as nonlinear as asked."""
    m_S, m_F = SHANK * body_kg, FOOT * body_kg
    a = m_S / (m_S + m_F)
    # sqrt(k_T a k_F) is the same on both branches; their ratio says which
    both = (m_S + m_F) * (2 * np.pi * rng.uniform(23.0, 32.0)) ** 2
    apart = np.exp(rng.uniform(0.25, 1.1) * rng.choice([-1.0, 1.0]))
    size = both / (m_S + m_F) * m_F / (2 * np.pi * 30)  # of a damper that leaves resonances visible
    c_11, c_21 = (float(c) for c in 1.8 * size * np.exp(rng.uniform(-0.6, 0.6, 2)))
    signs = rng.choice([-1.0, 1.0], 2)
    return Leg(
        k_T=float(both * np.sqrt(apart * a)), k_F=float(both / np.sqrt(apart * a)), c_11=c_11, c_21=c_21,
        c_12=float(strength * 90 * signs[0]), c_22=float(strength * 120 * signs[1]),
        c_13=float(strength * rng.uniform(40, 180)), c_23=float(strength * rng.uniform(40, 180)), m_S=m_S, m_F=m_F,
    )  # fmt: skip


def _departure(world: str, rng: np.random.Generator, leg: Leg, load_kg: float) -> Departure:
    """The size of a world's departure, drawn where the world leaves it open.

    Args:
        world: its name. rng: what draws. leg: without load. load_kg: the largest load, for typical displacements.
    """
    u, sign = rng.uniform, rng.choice([-1.0, 1.0])
    x_T = 2.0 * AMPLITUDE * (leg.m_S + load_kg) / leg.k_T
    x_F = 2.0 * AMPLITUDE * (leg.m_S + leg.m_F + load_kg) / leg.k_F
    match world:
        case "mass +10 %" | "mass +5 %" | "mass -5 %" | "mass -10 %":
            return Departure(mass=1.0 + float(world.split()[1]) / 100)
        case "stiffer under load":
            return Departure(follow=0.10, follow_power=bool(rng.integers(2)))
        case "springs relax":
            return Departure(relax_T=u(0.15, 0.6), relax_F=u(0.15, 0.6), tau_s=float(np.exp(u(*np.log([3e-3, 1e-2])))))
        case "sensor on tissue":
            return Departure(mount_hz=u(80, 150), mount_zeta=u(0.1, 0.3))
        case "gain and drift":
            return Departure(gain=0.03 * sign, drift=0.02 * float(rng.choice([-1.0, 1.0])))
        case "rocking":
            return Departure(rock=0.05 * sign, rock_hz=u(50, 75), rock_zeta=u(0.08, 0.2), second=0.1)
        case "exponential springs":
            return Departure(exponential=(sign * u(0.1, 0.4) / x_T, sign * u(0.1, 0.4) / x_F))
        case "cubic springs":
            return Departure(cubic=(u(0.05, 0.25) / x_T**2, u(0.05, 0.25) / x_F**2))
        case "in g":
            return Departure(unit=1.0 / GRAVITY)
    return Departure()


CLEAN = "clean"
WORLDS = (
    CLEAN, "mass +10 %", "mass +5 %", "mass -5 %", "mass -10 %", "stiffer under load", "springs relax",
    "sensor on tissue", "gain and drift", "rocking", "exponential springs", "cubic springs", "in g",
)  # fmt: skip


def member(world: str, seed: int) -> Member:
    """One leg in one world; the same seed gives the same leg and session, whatever else is drawn."""
    rng = np.random.default_rng([seed, zlib.crc32(world.encode()), 0])
    body, strength = rng.uniform(45, 110), float(np.exp(rng.uniform(np.log(0.03), np.log(1.3))))
    leg = leg_of(rng, body, strength)
    noise = float(np.exp(rng.uniform(np.log(0.002), np.log(0.01))))
    loads = LOADS_KG[: int(rng.choice([1, 2, 3], p=[0.25, 0.4, 0.35]))]
    if world == "stiffer under load" and len(loads) == 1:
        loads = LOADS_KG[: 2 + int(rng.integers(2))]
    made = Member(world, seed, leg, _departure(world, rng, leg, loads[-1]), loads, noise, strength, body)
    return replace(made, ranges=_ranges(made))


def _ranges(made: Member) -> dict[str, tuple[float, float]]:
    """Every constant as the range of values that it truly has over loads, frequencies and displacements.

    A spring that relaxes is any stiffness from rest to 50 Hz; one that follows the load is any stiffness over the
    recorded loads; a spring that stiffens has the tangent of rest (a range would depend on how far it moves).
    """
    d, legs = made.departure, [loaded(made.leg, made.departure, load) for load in made.loads_kg]
    found = {}
    for name in ("k_T", "k_F", "c_11", "c_21"):
        values = [getattr(leg, name) for leg in legs]
        low, high = min(values), max(values)
        if name in ("k_T", "k_F"):
            share = d.relax_T if name == "k_T" else d.relax_F
            high *= 1.0 + float(relaxing(np.array([2j * np.pi * FREQUENCIES_HZ[-1]]), share, d.tau_s)[0].real)
        found[name] = (low, high)
    return found
