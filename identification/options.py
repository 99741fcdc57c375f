"""Options that several commands read alike: lists of parameters, and limits such as k_F=3e3:1e6."""

from collections.abc import Iterable

from fasbody.exceptions import SettingError


def names(text: str | None) -> tuple[str, ...] | None:
    """Names with commas between them, None where there is no such option."""
    return None if text is None else tuple(name.strip() for name in text.split(",") if name.strip())


def limits(texts: Iterable[str] | None, option: str = "--bounds") -> dict[str, tuple[float, float]]:
    """Limits by name, in the order of the names, from any number of NAME=LOWER:UPPER.

    Raises:
        SettingError: one of them cannot be read.
    """
    return dict(sorted(_limit(text, option) for text in texts or ()))


def _limit(text: str, option: str) -> tuple[str, tuple[float, float]]:
    name, _, both = text.partition("=")
    try:
        low, high = (float(part) for part in both.split(":"))
    except ValueError:
        raise SettingError(f"{option} {text!r} is not NAME=LOWER:UPPER, for example k_F=3e3:1e6.") from None
    return name.strip(), (low, high)
