"""The plugin border: all that a mechanism package needs to know.

A plugin is a module that an entry point of the group `brv_hypo.mechanisms` names. It implements one hook:

    # my_package/ablation.py
    from brv_hypo.mechanisms import Mechanism, Term, hookimpl

    class Ablation(Mechanism):
        name, title = "ablation", "moment from uneven ablation"
        claims, source = "out-of-plane moment proportional to alpha", "my report, Eq. 1"

        def terms(self, motion, theta):
            return (Term("C_Zalpha", 0.0 * motion.alpha, motion.alpha, "1/rad"),)

    @hookimpl
    def brv_hypo_mechanisms():
        return [Ablation()]

    # pyproject.toml
    [project.entry-points."brv_hypo.mechanisms"]
    ablation = "my_package.ablation"

Class variables say what else is known of the mechanism (contract.py): how coefficients may change in time,
whether its terms enter together, and which of them are `characteristic`. Where a fit uses none of those, the
residual loop prefers a description in generic terms that fits as well, and states the mechanism as its look-alike.

A process is a moment, or an error of the record, with an unknown smooth time history. It is no hypothesis; every
hypothesis has it. The same hooks give processes:

    class FourLobes(MomentProcess):
        name, title = "four_lobes", "moment of a four-lobed cross-section"
        family, splines = "harmonic", 5

        def shapes(self, motion):
            return (motion.alpha * np.exp(4j * motion.windward_meridian),)

A `RecordProcess` has channels, units and size, and `changed`, which adds a time history to a channel of the record.

The built-in mechanisms are registered in this way and in no other. `brv-hypo mechanisms new NAME` writes such
a package, `brv-hypo mechanisms check NAME` tests one against the contract.
"""

from __future__ import annotations

from collections.abc import Sequence

import pluggy

from brv_hypo.mechanisms.contract import Mechanism, RecordEffect

PROJECT = "brv_hypo"
ENTRY_POINT_GROUP = "brv_hypo.mechanisms"

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@hookspec
def brv_hypo_mechanisms() -> Sequence[Mechanism]:
    """Moments of the vehicle, functions of the motion, processes too; one instance of each, with default options."""
    raise NotImplementedError


@hookspec
def brv_hypo_record_effects() -> Sequence[RecordEffect]:
    """Effects on the record, of instruments or environment: each is a perturbation of the flight record."""
    raise NotImplementedError
