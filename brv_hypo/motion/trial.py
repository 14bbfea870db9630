"""The trial of a record, before anything is fitted to it: `try_record`.

Faults of single channels are masked (`brv_hypo.flight.faults`). Then gyros, accelerometers and air data are held
against each other (consistency.py), as read and under every mistake of sign, axis and unit that is tried
(corrections.py). The record contradicts itself where it breaks a relation by more than its own noise and the
tolerances of any instrument explain, and one such mistake, undone, mends it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from brv_hypo.constants import (
    TRIAL_AXIAL_SIGMAS,
    TRIAL_AXIAL_WITHIN,
    TRIAL_BROKEN,
    TRIAL_BROKEN_ALONE,
    TRIAL_DECISIVE,
    TRIAL_DECISIVE_IF_STRAINED,
    TRIAL_MENDED,
    TRIAL_NEARLY_EQUAL,
    TRIAL_NORMAL_WITHIN,
    TRIAL_PRESSURE_WITHIN,
    TRIAL_QUIET,
    TRIAL_STRAINED,
    TRIAL_TIMES_NOISE,
    TRIAL_UNRELATED,
)
from brv_hypo.errors import FlightRecordError
from brv_hypo.flight.assemble import masked_flight
from brv_hypo.flight.averaging import averaged
from brv_hypo.flight.faults import RecordFault, RecordTrial
from brv_hypo.flight.record import Flight
from brv_hypo.flight.schema import MINIMUM_SAMPLES
from brv_hypo.motion.consistency import Consistency, Record, consistency, made_ready
from brv_hypo.motion.corrections import AS_IT_IS, Correction, corrections

MOST_OTHERS = 2  # corrections told beside the best
UNRELATED_WORDS = (
    "{share:.0f} % of what the accelerometers sense across the axis does not follow from the gyros and the speed, "
    "where noise leaves {noise:.1g} %, and no mistake of sign, axis or unit that was tried clearly mends it: axes and "
    "signs of the gyros are in doubt, or gusts and controls move the vehicle more than its own motion does. Check the "
    "map, or take another window (--start, --stop)"
)


def try_record(flight: Flight) -> tuple[Flight, RecordTrial]:
    """The flight with faulty stretches masked (the same object where there are none), and what the trial found.

    Never raises: a fault that leaves too little of a channel is reported as decisive, and the channel left as it is;
    so is a flight that is no valid record, or of which masking leaves nothing. A window of a sound record that is too
    short for any record is not tried.
    """
    if flight.time.size < MINIMUM_SAMPLES:
        return flight, RecordTrial(sound=True, faults=())
    try:
        masked, faults = masked_flight(flight)
    except FlightRecordError as error:
        unusable = _fault(flight, "record", "unusable", str(error))
        return flight, RecordTrial(sound=False, faults=(*flight.faults, unusable))
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small: threads only cost
        found = (*faults, *_contradictions(averaged(masked)))
    trial = RecordTrial(sound=not any(fault.decisive for fault in found), faults=found)
    return (masked if masked.faults == faults else replace(masked, faults=faults)), trial


def _contradictions(flight: Flight) -> tuple[RecordFault, ...]:
    """The mistake that, undone, mends the record best; and whether the gyros are at odds with it even so."""
    record = made_ready(flight)
    if not record.segments:
        return ()
    as_read = consistency(record, AS_IT_IS)
    broken = _broken(as_read)
    if not broken:
        return ()
    found = []
    least = TRIAL_DECISIVE if set(broken) - {"path, strained"} else TRIAL_DECISIVE_IF_STRAINED
    ranked = _ranked(record, as_read)
    mended = ranked[0][2]
    likely = [
        correction
        for correction, gain, after in ranked
        if gain >= max(least, ranked[0][1] - TRIAL_NEARLY_EQUAL) and _mended(after, as_read, broken)
    ]
    if likely and likely[0] is ranked[0][0]:
        found.append(_named(flight, likely))
    if "path" in broken and _unrelated(as_read) and (not found or _unrelated(mended)):
        words = UNRELATED_WORDS.format(share=100.0 * as_read.left[0], noise=100.0 * as_read.noise[0])
        found.append(_fault(flight, "p, q, r, ay, az", "axes", words))
    return tuple(found)


def _ranked(record: Record, as_read: Consistency) -> list[tuple[Correction, float, Consistency]]:
    """Every correction with what it gains and leaves, the best first."""
    tried = [(one, consistency(record, one)) for one in corrections()]
    ranked = [(one, after.better_than(as_read), after) for one, after in tried]
    return sorted(ranked, key=lambda entry: -entry[1])


def _named(flight: Flight, likely: Sequence[Correction]) -> RecordFault:
    """The fault of the likeliest correction; others that mend the record nearly as well are told."""
    best, others = likely[0], likely[1 : 1 + MOST_OTHERS]
    nearly = f" (nearly as likely: {'; or '.join(one.words for one in others)})" if others else ""
    action = f"{best.words}{nearly}: correct the map"
    return _fault(flight, best.channel, best.fault, action)


def _broken(found: Consistency) -> Sequence[str]:
    """The checks that the record fails by more than any tolerance."""
    failed = []
    beyond_noise = found.left[0] - TRIAL_TIMES_NOISE * found.noise[0]
    if found.informative[0] and beyond_noise > TRIAL_STRAINED:
        failed.append("path" if beyond_noise > TRIAL_BROKEN else "path, strained")
    if not found.informative[0] and found.informative[2] and found.left[2] > TRIAL_BROKEN_ALONE:
        failed.append("gyros")
    doubt = TRIAL_AXIAL_SIGMAS * found.axial_sigma
    if found.axial + doubt < TRIAL_AXIAL_WITHIN[0] or found.axial - doubt > TRIAL_AXIAL_WITHIN[1]:
        failed.append("axial")
    if found.pressure is not None and not TRIAL_PRESSURE_WITHIN[0] < found.pressure < TRIAL_PRESSURE_WITHIN[1]:
        failed.append("pressure")
    if found.normal_slope is not None and not TRIAL_NORMAL_WITHIN[0] < found.normal_slope < TRIAL_NORMAL_WITHIN[1]:
        failed.append("slope")
    return failed


def _mended(mended: Consistency, as_read: Consistency, broken: Sequence[str]) -> bool:
    """Whether a correction mends any of the broken checks, and breaks no other."""
    still = set(_broken(mended))
    if mended.left[0] < TRIAL_MENDED * as_read.left[0]:
        still -= {"path", "path, strained"}
    if mended.left[2] < TRIAL_MENDED * as_read.left[2]:
        still.discard("gyros")
    return still < set(broken)


def _unrelated(found: Consistency) -> bool:
    """Whether much of each instrument does not follow from the others, though noise would let it."""
    tells = found.informative & (found.noise < TRIAL_QUIET)
    return bool(tells[0] and (found.left[tells] > TRIAL_UNRELATED).all())


def _fault(flight: Flight, channel: str, fault: str, action: str) -> RecordFault:
    return RecordFault(channel, fault, float(flight.time[0]), float(flight.time[-1]), action, decisive=True)
