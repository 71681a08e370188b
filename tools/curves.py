"""Curves on logarithmic axes as SVG: a few thousand characters each, and nothing to install."""

import math
from html import escape

WIDTH, HEIGHT = 640, 400
LEFT, RIGHT, TOP, BOTTOM = 70, 16, 34, 48
COLOURS = ["#2f6690", "#c0582c", "#4d8a57", "#8b6f9c", "#b9972f", "#4a4f57", "#b3352b"]


def ticks(low, high):
    """1, 2 and 5 times powers of ten from low to high."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found = [step * 10.0**decade for decade in decades for step in (1, 2, 5)]
    return [value for value in found if low <= value <= high * (1 + 1e-9)]


def plot(path, title, across, up, series):
    """Writes a plot of {name: [(x, y), …]} on two logarithmic axes to `path`; points without height are left out."""
    series = {name: [(x, y) for x, y in points if x > 0 and y > 0] for name, points in series.items()}
    points = [point for one in series.values() for point in one]
    (x_low, x_high), (y_low, y_high) = [(min(p[k] for p in points), max(p[k] for p in points)) for k in (0, 1)]
    x_low, x_high, y_low, y_high = x_low / 1.08, x_high * 1.08, y_low / 1.2, y_high * 1.2

    def place(x, y):
        along = math.log(x / x_low) / math.log(x_high / x_low)
        height = math.log(y / y_low) / math.log(y_high / y_low)
        return LEFT + along * (WIDTH - LEFT - RIGHT), HEIGHT - BOTTOM - height * (HEIGHT - TOP - BOTTOM)

    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12">',
             f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
             f'<text x="{LEFT}" y="20" font-size="14" font-weight="bold" fill="#23262b">{escape(title)}</text>']
    for x in ticks(x_low, x_high):
        at, _ = place(x, y_low)
        lines.append(f'<path d="M{at:.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#e2dfd8"/><text x="{at:.1f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle" fill="#5c6066">{x:g}</text>')
    for y in ticks(y_low, y_high):
        _, at = place(x_low, y)
        lines.append(f'<path d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}" stroke="#e2dfd8"/><text x="{LEFT - 6}" y="{at + 4:.1f}" text-anchor="end" fill="#5c6066">{y:g}</text>')
    lines.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 12}" text-anchor="middle" fill="#23262b">{escape(across)}</text>')
    lines.append(f'<text transform="translate(16 {(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)" text-anchor="middle" fill="#23262b">{escape(up)}</text>')
    for number, (name, own) in enumerate(series.items()):
        colour, dash = COLOURS[number % len(COLOURS)], ' stroke-dasharray="5 3"' if number >= len(COLOURS) else ""
        spots = [place(x, y) for x, y in sorted(own)]
        drawn = " ".join(f"{x:.1f},{y:.1f}" for x, y in spots)
        lines.append(f'<polyline points="{drawn}" fill="none" stroke="{colour}" stroke-width="2"{dash}/>')
        lines += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>' for x, y in spots]
        row = TOP + 16 + 16 * number
        lines.append(f'<path d="M{WIDTH - 190} {row - 4}h22" stroke="{colour}" stroke-width="2"{dash}/><text x="{WIDTH - 162}" y="{row}" fill="#23262b">{escape(name)}</text>')
    path.write_text("\n".join([*lines, "</svg>"]) + "\n")
