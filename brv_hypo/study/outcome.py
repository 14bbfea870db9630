"""What is kept of one flight of a study."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

from brv_hypo.study.draws import Draw

EstimateKind = Literal["theta", "knot", "coefficient", "derived"]


class _Kept(BaseModel):
    model_config = ConfigDict(frozen=True, ser_json_inf_nan="constants")


class Estimate(_Kept):
    """A planted value and its estimate, both in `units`; None where the fit holds no such parameter.

    `kind`: `theta` (a delay), `knot` (onset or end, s), `coefficient`, or `derived` (phi_b).
    """

    name: str
    kind: EstimateKind
    units: str
    truth: float
    value: float | None = None
    std_error: float | None = None

    @property
    def sigmas(self) -> float | None:
        """Error over standard error; None where there is no estimate, or no standard error."""
        if self.value is None or not self.std_error:
            return None
        return (self.value - self.truth) / self.std_error


class Outcome(_Kept):
    """One flight: what was drawn, what was planted, and what `compare` made of it.

    `effect_in_plane`, `effect_out_of_plane`: rms of what is planted, while it lasts, over the rms of the
    whole moment in that time. `outcome` is the verdict's, `faults` what the trial of the record named, as
    "channel: fault"; `fault_named` whether a planted fault is among them, None without one. `information` is the
    criterion of each hypothesis. `estimates` are those of the planted mechanism's own fit. A flight that failed has
    its `reason`.
    """

    draw: Draw
    status: Literal["compared", "refused", "not simulated", "not compared"]
    reason: str = ""
    outcome: str = ""
    faults: tuple[str, ...] = ()
    fault_named: bool | None = None
    effect_in_plane: float = 0.0
    effect_out_of_plane: float = 0.0
    first: str | None = None
    winner: str | None = None
    equivalent: tuple[str, ...] = ()
    probability: dict[str, float] = {}
    information: dict[str, float] = {}
    prediction_error: dict[str, float] = {}
    verdict: str = ""
    estimates: tuple[Estimate, ...] = ()
    alpha_sigma_rad: float | None = None
    phi_w_sigma_rad: float | None = None
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def planted(self) -> str:
        """The hypothesis that is true."""
        return self.draw.planted

    @property
    def effect(self) -> float:
        """The larger of the two effects."""
        return max(self.effect_in_plane, self.effect_out_of_plane)

    @property
    def right(self) -> bool:
        """True where the planted mechanism ranks first."""
        return self.first == self.planted

    @property
    def won(self) -> bool:
        """True where the verdict names the planted mechanism."""
        return self.winner == self.planted
