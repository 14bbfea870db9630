"""A reconstruction as a page."""

from __future__ import annotations

from brv_hypo.motion import Reconstruction
from brv_hypo.report import figures
from brv_hypo.report.pages import Block, bullets, drawn, page
from brv_hypo.report.reconstruction import reconstruction_line


def reconstruction_page(result: Reconstruction) -> str:
    """Motion and moments with their standard deviations, as a page."""
    usable = result.moments.usable
    plane = result.plane_moments[usable]
    moments = figures.moment_figure(
        result.motion.time[usable], (plane.real, plane.imag), result.moments.sigma[usable], {}
    )
    motion = figures.motion_figure(result.motion.time, result.motion.alpha, result.motion.windward_meridian)
    blocks = [
        Block("Warnings", bullets(result.warnings)),
        Block("Motion", drawn(motion)),
        Block("Moments", drawn(moments)),
        Block("Notes", bullets(result.flight.notes)),
    ]
    title = f"Reconstruction: {result.flight.title or result.flight.path}"
    return page(title, f"{result.flight.samples} samples", reconstruction_line(result), blocks)
