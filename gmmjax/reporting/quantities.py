"""Numbers in words: probabilities, lengths, areas and volumes with their unit, angles."""

import math

# What a length in metres is shown in, and from how many metres on; the last one below that.
METRIC = ((1.0, "m", 1.0), (0.01, "cm", 0.01), (0.0, "mm", 0.001))


def rounded_up(length: float) -> float:
    """Return the next length of 1, 2 or 5 times a power of ten, at least this one."""
    power = 10.0 ** math.floor(math.log10(length))
    return float(power * next(step for step in (1, 2, 5, 10) if step * power >= length * (1 - 1e-9)))


def rounded_down(length: float) -> float:
    """Return the greatest length of 1, 2 or 5 times a power of ten that is at most this one."""
    power = 10.0 ** math.floor(math.log10(length))
    return float(max(step * power for step in (1, 2, 5) if step * power <= length))


def percent(probability: float) -> str:
    """Give a probability to whole percents; only certainty is 100 %."""
    shown = math.floor(probability * 100) if 0.99 < probability < 1 else round(probability * 100)
    return f"{shown} %"


def share(part: float) -> str:
    """Give a share to whole percents; "under 1 %" where there is some."""
    return "under 1 %" if 0 < part < 0.01 else percent(part)


def number_text(value: float) -> str:
    """Give a number with two significant digits below 1 and three from there on: "0.10", "1.23", "12,300"."""
    magnitude = abs(value)
    if magnitude == 0:
        return "0"
    if not 1e-6 <= magnitude < 1e12:
        return f"{value:.2e}"
    # Rounded first: 0.0996 is 0.10, not 0.100.
    digits = 2 if magnitude < 1 else 3
    rounded = float(f"{value:.{digits - 1}e}")
    decimals = (2 if abs(rounded) < 1 else 3) - 1 - math.floor(math.log10(abs(rounded)))
    return f"{rounded:,.{max(decimals, 0)}f}"


def length_text(value: float, unit: str | None) -> str:
    """Give a length in the unit of the clouds, such as "0.10 m"; the plain number where the unit is not known."""
    return number_text(value) if unit is None else f"{number_text(value)} {unit}"


def metric_text(values: tuple[float, ...], unit: str | None, joint: str = " to ") -> str:
    """Give lengths in a readable unit: metres as "30 cm", "3.3 to 1.3 mm", "14 cm to 1.3 mm"; others in their own.

    Those that are alike have one unit, that of the greatest.
    """
    if unit != "m":
        return joint.join(map(_short, values)) + (f" {unit}" if unit else "")
    if len(values) > 1 and min(map(abs, values)) < max(map(abs, values)) / 10:
        return joint.join(metric_text((value,), unit) for value in values)
    _, name, metres = next(row for row in METRIC if max(map(abs, values)) >= row[0])
    return joint.join(_short(value / metres) for value in values) + f" {name}"


def area_text(value: float, unit: str | None) -> str:
    """Give an area such as "0.35 m²", and below 0.01 m² "35.0 cm²"; the plain number where the unit is not known."""
    if unit == "m" and 0 < value < 0.01:
        return f"{number_text(value * 1e4)} cm²"
    return number_text(value) if unit is None else f"{number_text(value)} {unit}²"


def volume_text(value: float, unit: str | None, error: float | None = None, *, greatest: float | None = None) -> str:
    """Give a volume such as "0.35 m³", and below 0.01 m³ "350 cm³"; the plain number where the unit is not known.

    With the `error`, half the width of its interval, it is "17.3 ± 0.4 m³". The `greatest` of the volumes that it is
    shown among tells the unit of all of them.
    """
    small = 0 < abs(value if greatest is None else greatest) < 0.01
    scale, name = (1e6, " cm³") if unit == "m" and small else (1.0, f" {unit}³" if unit else "")
    text = number_text(value * scale) if error is None else _uncertain_text(value * scale, error * scale)
    return f"{text}{name}"


def _uncertain_text(value: float, error: float) -> str:
    """Give a number to the digits that its error leaves: one is shown or, where the error begins with 1, two."""
    if error <= 0:
        return number_text(value)
    digits = 2 if f"{error:.0e}"[0] == "1" else 1
    rounded = float(f"{error:.{digits - 1}e}")
    decimals = digits - 1 - math.floor(math.log10(rounded))
    if not 1e-6 <= rounded or max(abs(value), rounded) >= 1e9:
        return f"{value:.3g} ± {rounded:.{digits}g}"
    places = max(decimals, 0)
    return f"{round(value, decimals) + 0.0:,.{places}f} ± {rounded:,.{places}f}".replace("-", "−")


def degrees_text(angle: float) -> str:
    """Give an angle in degrees, to a tenth below ten: "0.4°", "6°", "35°"."""
    return f"{angle:.0f}°" if angle >= 10 else f"{angle:.1f}".removesuffix(".0") + "°"


def _short(value: float) -> str:
    """Give two significant digits, or all that are before the point: a residual is not known to more."""
    if value == 0:
        return "0"
    decimals = max(1 - math.floor(math.log10(abs(value))), 0)
    text = f"{value:,.{min(decimals, 9)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
