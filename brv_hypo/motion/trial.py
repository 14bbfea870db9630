"""The trial of a record, before anything is fitted to it: `try_record`.

Faults of single channels are masked (`brv_hypo.flight.faults`). Then gyros, accelerometers and air data are held
against each other (consistency.py), as read and under every mistake of sign, axis and unit that is tried
(corrections.py). The record contradicts itself where it breaks a relation by more than its own noise and the
tolerances of any instrument explain, and one such mistake, undone, mends it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from brv_hypo.flight.assemble import masked_flight
from brv_hypo.flight.faults import RecordFault, RecordTrial
from brv_hypo.flight.record import Flight
from brv_hypo.motion.consistency import Consistency, Record, consistency, made_ready
from brv_hypo.motion.corrections import AS_IT_IS, Correction, corrections

# A relation is broken where this share is left beyond so many times what noise leaves. Sound records leave 0.04 at
# most: 90 simulated flights with all instrument grades, and the measured entry of Opportunity.
BROKEN = 0.012
TIMES_NOISE = 4.0
# Where the accelerometers cannot tell, the gyros alone must leave so much; mechanisms leave up to 0.5.
BROKEN_ALONE = 0.7
# Sensed deceleration, density, slope of the normal force: beyond these factors no tolerance explains them.
AXIAL_WITHIN = (0.5, 2.0)
PRESSURE_WITHIN = (0.3, 3.0)
NORMAL_WITHIN = (0.04, 30.0)
# A mistake is named where undoing it raises ln likelihood by this much, and leaves this share of what was broken.
DECISIVE = 2.2
MENDED = 0.4
# Nothing mends it, and hardly anything of one instrument follows from the others.
UNRELATED = 0.8
QUIET = 0.1


def try_record(flight: Flight) -> tuple[Flight, RecordTrial]:
    """The flight with faulty stretches masked (the same object where there are none), and what the trial found.

    Raises nothing that reading the flight did not: a fault that leaves too little of a channel is reported as
    decisive, and the channel left as it is.
    """
    masked, faults = masked_flight(flight)
    found = (*faults, *_contradictions(masked))
    trial = RecordTrial(sound=not any(fault.decisive for fault in found), faults=found)
    return (masked if masked.faults == faults else replace(masked, faults=faults)), trial


def _contradictions(flight: Flight) -> tuple[RecordFault, ...]:
    """At most one: the mistake that, undone, mends the record best."""
    record = made_ready(flight)
    if not record.segments:
        return ()
    as_read = consistency(record, AS_IT_IS)
    broken = _broken(as_read)
    if not broken:
        return ()
    best, gain = _best(record, as_read)
    mended = consistency(record, best)
    if gain >= DECISIVE and _mends(mended, as_read, broken):
        return (_fault(flight, best.channel, best.fault, f"{best.words}: correct the map or pass --accept-record"),)
    unrelated = as_read.informative & (as_read.left > UNRELATED) & (as_read.noise < QUIET)
    if unrelated.all():
        words = (
            "gyros and accelerometers do not follow from each other under any signs and axes that were tried: "
            "their axes, signs and units are in doubt. Check the map, or pass --accept-record"
        )
        return (_fault(flight, "p, q, r, ay, az", "axes", words),)
    return ()


def _best(record: Record, as_read: Consistency) -> tuple[Correction, float]:
    gains = [(consistency(record, one).better_than(as_read), one) for one in corrections()]
    gain, best = max(gains, key=lambda pair: pair[0])
    return best, gain


def _broken(found: Consistency) -> Sequence[str]:
    """The checks that the record fails by more than any tolerance."""
    failed = []
    if found.informative[0] and found.left[0] > BROKEN + TIMES_NOISE * found.noise[0]:
        failed.append("path")
    if not found.informative[0] and found.informative[2] and found.left[2] > BROKEN_ALONE:
        failed.append("gyros")
    if found.axial_known and not AXIAL_WITHIN[0] < found.axial < AXIAL_WITHIN[1]:
        failed.append("axial")
    if found.pressure is not None and not PRESSURE_WITHIN[0] < found.pressure < PRESSURE_WITHIN[1]:
        failed.append("pressure")
    if found.normal_slope is not None and not NORMAL_WITHIN[0] < found.normal_slope < NORMAL_WITHIN[1]:
        failed.append("slope")
    return failed


def _mends(mended: Consistency, as_read: Consistency, broken: Sequence[str]) -> bool:
    """Whether a correction leaves none of the checks broken, or nearly so."""
    left = set(_broken(mended)) & {"axial", "pressure", "slope"}
    path = "path" not in broken or mended.left[0] < MENDED * as_read.left[0]
    alone = "gyros" not in broken or mended.left[2] < MENDED * as_read.left[2]
    return not (left & set(broken)) and path and alone


def _fault(flight: Flight, channel: str, fault: str, action: str) -> RecordFault:
    return RecordFault(channel, fault, float(flight.time[0]), float(flight.time[-1]), action, decisive=True)
