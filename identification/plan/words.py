"""Numbers with their nouns, as the sentences of a plan and a session have them."""

from fasbody.presentation import readable


def percent(share: float) -> str:
    """A share in percent, of two digits."""
    if share > 10:
        return "over 1000 %"
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"


def chance(probability: float) -> str:
    """A probability in whole percent; what is next to nothing, or next to certain, is no more than that."""
    return "under 1 %" if probability < 0.005 else "over 99 %" if probability > 0.995 else f"{100 * probability:.0f} %"


def plain(value: float, digits: int = 2) -> str:
    """A number of so many digits that never needs an exponent: all of a whole part are written."""
    return f"{value:.0f}" if abs(value) >= 10**digits - 0.5 else readable(value, digits)


def minutes(seconds: float) -> str:
    """A time in minutes: 1 minute, 4.5 minutes, 120 minutes."""
    return _in(seconds, 60, "minute")


def span(seconds: float) -> str:
    """A time in the unit that suits it."""
    if seconds < 5400:
        return minutes(seconds)
    return _in(seconds, 3600, "hour") if seconds < 48 * 3600 else _in(seconds, 86400, "day")


def _in(seconds: float, size: float, unit: str) -> str:
    text = plain(seconds / size)
    return f"{text} {unit}{'' if text == '1' else 's'}"


def repeating(repeatability: float) -> str:
    """How well recordings repeat."""
    return f"recordings repeat to {percent(repeatability)}" if repeatability else "recordings repeat exactly"


def in_the_way(repeatability: float, of: str) -> str:
    """That what more recordings average out is in the way of something, in a sentence."""
    what = "Noise and scatter between recordings limit" if repeatability else "Noise limits"
    return f"{what} {of}."
