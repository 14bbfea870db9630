"""One instrument's clock is late against the gyros'."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms import Component, RecordEffect, hookimpl

_INSTRUMENTS = {
    "gyros": ("p", "q", "r"),
    "accelerometers": ("ax", "ay", "az"),
    "air data": ("velocity", "dynamic_pressure", "mach", "reynolds"),
}
# Its clock is the record's: all instruments late together are a motion that much later, which nothing tells but the
# ends of the record, where a shifted channel has to be continued.
_CLOCK = "gyros"


class TimeSkew(RecordEffect):
    """The channels of one instrument hold what was so a constant time before their stamp, that of the gyros."""

    name = "time_skew"
    title = "time skew between instruments"
    claims = "one instrument is late against the gyros by a constant time"
    source = "Morelli and Klein, Aircraft System Identification, 2016, chapter 10 (data compatibility)"
    kind = "instrument"

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One delay for each instrument beside the gyros; the tolerance is that of one clock against another."""
        size = float(flight.instruments.time_skew[0])
        return tuple(Component(name, "s", size) for name in _INSTRUMENTS if name != _CLOCK)

    def plantable(self, flight: Flight) -> tuple[str, ...]:
        """Any instrument may be late, the gyros too: the others are early against them then."""
        return tuple(_INSTRUMENTS)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with that instrument late by `value` s more.

        Shifted in the spectrum, so that white noise stays white: interpolation between samples would smooth it.
        """
        late: dict[str, FloatArray] = {
            name: _late(channel, flight.segments, value / flight.step)
            for name in _INSTRUMENTS[component]
            if (channel := getattr(flight, name)) is not None
        }
        return replace(flight, **late)  # type: ignore[arg-type]


def _late(channel: FloatArray, segments: Sequence[tuple[int, int]], samples: float) -> FloatArray:
    """The channel (n,) some samples later, each segment by itself.

    What is left of a straight line between its ends, continued as an odd function, is periodic and smooth.
    """
    out = np.array(channel, dtype=float)
    for a, b in segments:
        place = np.arange(b - a) / max(b - a - 1, 1)
        first, last = channel[a], channel[b - 1]
        left = channel[a:b] - first - (last - first) * place
        periodic = np.concatenate([left, -left[-2:0:-1]])
        turn = np.exp(-2j * np.pi * np.fft.rfftfreq(periodic.size) * samples)
        shifted = np.fft.irfft(np.fft.rfft(periodic) * turn, periodic.size)[: b - a]
        out[a:b] = shifted + first + (last - first) * (place - samples / max(b - a - 1, 1))
    return out


@hookimpl
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """The effects of this module."""
    return [TimeSkew()]
