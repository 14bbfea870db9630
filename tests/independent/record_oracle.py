"""What a record says of the effects planted into it, once its motion and its errors have to be found along with them.

The oracle knows the motion. A reconstruction does not, and a small slow moment may be the attitude's own error: the
effects' true columns are projected off all that the loop fits along, and off each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from brv_hypo.mechanisms import Mechanism, Term
from brv_hypo.model.columns import Column
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.linear import lengths
from brv_hypo.residuals.baseline import start_model, starting_columns, with_priors
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.fitted_model import settled_state
from brv_hypo.residuals.linearisation import see
from tests.independent.flights import Made


def f_ratios_in_record(made: Made) -> tuple[float, ...]:
    """F of each planted effect beside the others, on the part of the record that the loop fits."""
    flights, config = (made.flight,), TraceConfig()
    known = _known(made)
    model = start_model(flights, (), config.baseline)
    first = see(flights, model, config)
    model = replace(model, columns=starting_columns(model, first.frame))
    model = with_priors(model, first)
    names = [term.name for term in known.terms(first.reconstructions[0].motion, {})]
    own = tuple(Column(known.name, name, (), TimeFunction("constant"), "1") for name in names)
    mechanisms = {**model.mechanisms, known.name: known}
    state = settled_state(flights, replace(model, mechanisms=mechanisms, columns=(*model.columns, *own)), config)
    design = state.problem.design(state.problem.frame, state.problem.baseline)
    return tuple(_beyond(design, design.shape[1] - len(own) + k) for k in range(len(own)))


def _beyond(design: np.ndarray, place: int) -> float:
    """Squared length of a column beyond all the others."""
    others = np.delete(design, place, axis=1)
    basis = np.linalg.qr(others / lengths(others))[0]
    free = design[:, place] - basis @ (basis.T @ design[:, place])
    return float(free @ free)


def _known(made: Made) -> Mechanism:
    """A mechanism whose terms are the true contributions, each at the size that was planted."""
    true = made.true

    class Known(Mechanism):
        name = "known"
        title = "what was planted"
        claims = "the truth"
        source = "the simulation"
        time_variation = ("constant",)

        def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
            parts = [np.interp(motion.time, true.time, part) for part in true.parts.T]
            return tuple(Term(f"effect {k}", part.real, part.imag) for k, part in enumerate(parts))

    return Known()
