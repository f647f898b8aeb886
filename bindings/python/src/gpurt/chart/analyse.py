"""From runs to curves, fronts, slopes and tables. Nothing here renders or draws."""

from __future__ import annotations

import dataclasses
import math
import statistics
from typing import Any, Dict, List, Optional, Sequence, Tuple

from gpurt.chart.measure import Curve

MEASURES = ("relmse", "trimmed")


@dataclasses.dataclass
class Spread:
    """Of one quantity over the seeds."""

    median: float
    low: float
    high: float


@dataclasses.dataclass
class Point:
    """The pictures of one setting with one number of samples."""

    spp: int
    seconds: float  #: load, build and render
    render_seconds: float
    relmse: Spread
    trimmed: Spread
    bias: float
    repeats: int

    def error(self, measure: str) -> Spread:
        spread = getattr(self, measure)
        assert isinstance(spread, Spread)
        return spread


@dataclasses.dataclass
class Fit:
    """error = at_one_second x render seconds ^ slope, by least squares of the logarithms."""

    slope: float
    slope_error: float  #: standard error; nan for two points
    at_one_second: float


@dataclasses.dataclass
class Result:
    name: str
    curve: Curve
    load_seconds: float
    build_seconds: float
    points: List[Point]
    fits: Dict[str, Optional[Fit]]


def spread(values: Sequence[float]) -> Spread:
    return Spread(statistics.median(values), min(values), max(values))


def summarise(curve: Curve) -> Result:
    """Medians over the seeds; a number of samples counts where every seed reached it."""
    load = statistics.median(run.load_seconds for run in curve.runs)
    build = statistics.median(run.build_seconds for run in curve.runs)
    points = []
    for samples in zip(*(run.samples for run in curve.runs)):
        render = statistics.median(s.render_seconds for s in samples)
        points.append(Point(samples[0].spp, load + build + render, render, spread([s.relmse for s in samples]),
                            spread([s.trimmed for s in samples]), statistics.fmean(s.bias for s in samples),
                            len(samples)))
    return Result(curve.setting.name, curve, load, build, points,
                  {m: fit([(p.render_seconds, p.error(m).median) for p in later_half(points)]) for m in MEASURES})


def later_half(points: List[Point]) -> List[Point]:
    """Where slopes are fitted: the first few samples miss rare paths, so their trimmed error is too low. At least 3."""
    return points[-max(3, (len(points) + 1) // 2):]


def fit(points: Sequence[Tuple[float, float]]) -> Optional[Fit]:
    """None for fewer than two points with a positive error."""
    logs = [(math.log(t), math.log(e)) for t, e in points if t > 0 and e > 0]
    n = len(logs)
    if n < 2:
        return None
    mean_x, mean_y = (math.fsum(v) / n for v in zip(*logs))
    sxx = math.fsum((x - mean_x) ** 2 for x, _ in logs)
    if sxx == 0:
        return None
    slope = math.fsum((x - mean_x) * (y - mean_y) for x, y in logs) / sxx
    offset = mean_y - slope * mean_x
    rest = math.fsum((y - offset - slope * x) ** 2 for x, y in logs)
    return Fit(slope, math.sqrt(rest / (n - 2) / sxx) if n > 2 else math.nan, math.exp(offset))


def pareto_front(results: Sequence[Result], measure: str) -> List[Tuple[float, float, str]]:
    """The points (seconds, error, setting) that no other point beats in both, by time."""
    candidates = sorted((p.seconds, p.error(measure).median, r.name) for r in results for p in r.points
                        if p.error(measure).median > 0)
    front: List[Tuple[float, float, str]] = []
    for candidate in candidates:
        if not front or candidate[1] < front[-1][1]:
            front.append(candidate)
    return front


def between(x: float, a: Tuple[float, float], b: Tuple[float, float]) -> float:
    """Linear in the logarithms."""
    if a[0] == b[0]:
        return b[1]
    share = (math.log(x) - math.log(a[0])) / (math.log(b[0]) - math.log(a[0]))
    return math.exp(math.log(a[1]) + share * (math.log(b[1]) - math.log(a[1])))


def error_at(result: Result, seconds: float, measure: str) -> Optional[float]:
    """The error after `seconds`, load and build included; None outside what was measured."""
    curve = [(p.seconds, p.error(measure).median) for p in result.points if p.error(measure).median > 0]
    for a, b in zip(curve, curve[1:]):
        if a[0] <= seconds <= b[0]:
            return between(seconds, a, b)
    return None


def seconds_to(result: Result, error: float, measure: str) -> Optional[float]:
    """The time after which the error first falls to `error`; None where it was not reached, or from the start."""
    curve = [(p.error(measure).median, p.seconds) for p in result.points if p.error(measure).median > 0]
    for a, b in zip(curve, curve[1:]):
        if a[0] >= error >= b[0]:
            return between(error, a, b)
    return None


@dataclasses.dataclass
class Crossing:
    """Where one curve falls below another."""

    seconds: float
    error: float
    above: str  #: the setting whose error is larger from here on
    below: str
    measured: bool = True  #: False: the curves end before; their slopes meet here


def crossings(results: Sequence[Result], measure: str) -> List[Crossing]:
    """Of every two settings whose pipelines or devices differ, by time. Curves are lines in the logarithms, and are
    compared over the times that both cover; where they do not cross there, their slopes may say where they would."""
    found: List[Crossing] = []
    for i, a in enumerate(results):
        for b in results[i + 1:]:
            if kind(a) != kind(b):
                found += crossings_of_two(a, b, measure)
    return sorted(found, key=lambda c: c.seconds)


def kind(result: Result) -> Tuple[str, str]:
    return result.curve.resolved["pipeline"], result.curve.device.name


def crossings_of_two(a: Result, b: Result, measure: str) -> List[Crossing]:
    times = sorted(p.seconds for r in (a, b) for p in r.points)
    errors = [(t, error_at(a, t, measure), error_at(b, t, measure)) for t in times]
    common = [(t, ea, eb) for t, ea, eb in errors if ea is not None and eb is not None]
    found: List[Crossing] = []
    ahead = 0.0  # how far b was above the last time that they differed, in logarithms
    last = (0.0, 0.0)
    for t, ea, eb in common:
        difference = math.log(eb / ea)
        if ahead * difference < 0:
            share = ahead / (ahead - difference)
            at = math.exp(math.log(last[0]) + share * math.log(t / last[0]))
            error = error_at(a, at, measure)
            names = (a.name, b.name) if difference < 0 else (b.name, a.name)
            found.append(Crossing(at, last[1] if error is None else error, *names))
        if difference != 0:
            ahead, last = difference, (t, ea)
    if common and not found:
        found += expected_crossing(a, b, measure, common[-1][0])
    return found


def expected_crossing(a: Result, b: Result, measure: str, after: float) -> List[Crossing]:
    """Where the fitted lines of two falling curves meet, if that is later than `after` and within a thousand times that:
    a line of a few points says nothing about more."""
    fa, fb = a.fits[measure], b.fits[measure]
    if fa is None or fb is None or not max(fa.slope, fb.slope) < 0 or fa.slope == fb.slope:
        return []
    exponent = math.log(fb.at_one_second / fa.at_one_second) / (fa.slope - fb.slope)
    if not math.log(after) < exponent < math.log(1000 * after):
        return []
    names = (a.name, b.name) if fb.slope < fa.slope else (b.name, a.name)
    at = math.exp(exponent)
    return [Crossing(at, fa.at_one_second * at ** fa.slope, *names, measured=False)]


def round_values(low: float, high: float, steps: Sequence[float]) -> List[float]:
    """Values step x 10^k within [low, high]."""
    if not 0 < low <= high:
        return []
    exponents = range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 1)
    return sorted(float(f"{s}e{k}") for k in exponents for s in steps if low <= float(f"{s}e{k}") <= high)


def middle(values: List[float], count: int) -> List[float]:
    """At most `count` of the values, spread evenly, the last included."""
    if len(values) <= count:
        return values
    return [values[round(i * (len(values) - 1) / (count - 1))] for i in range(count)]


def equal_times(results: Sequence[Result]) -> List[float]:
    """Round times that at least two curves cover, or the only one."""
    starts = sorted(r.points[0].seconds for r in results)
    ends = sorted(r.points[-1].seconds for r in results)
    least = min(2, len(results))
    times = [t for t in round_values(starts[least - 1], ends[-least], (1, 2, 5))
             if sum(r.points[0].seconds <= t <= r.points[-1].seconds for r in results) >= least]
    return middle(times, 6)


def picture_seconds(results: Sequence[Result]) -> float:
    """How long the pictures at equal time take: as long as the shortest curve."""
    return min(r.points[-1].seconds for r in results)


def equal_errors(results: Sequence[Result], measure: str) -> List[float]:
    """Round errors that some curve covers, the largest first."""
    errors = [p.error(measure).median for r in results for p in r.points if p.error(measure).median > 0]
    if not errors:
        return []
    return middle(round_values(min(errors), max(errors), (1, 2, 5)), 5)[::-1]


def tables(results: Sequence[Result]) -> Dict[str, Any]:
    """Equal time: the error of each setting. Equal error: the seconds of each setting. None: outside its curve."""
    times = equal_times(results)
    return {
        "equal_time": [{"seconds": t, "errors": {r.name: {m: error_at(r, t, m) for m in MEASURES} for r in results}}
                       for t in times],
        "equal_error": {m: [{"error": e, "seconds": {r.name: seconds_to(r, e, m) for r in results}}
                            for e in equal_errors(results, m)] for m in MEASURES},
    }
