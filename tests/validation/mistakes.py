"""Findings of experiments, and mistakes that must turn them red."""

from __future__ import annotations

from dataclasses import replace

from validation.experiment import Missing


def failed(finding) -> list[str]:
    """What is not as expected."""
    return [check.what for check in finding.checks if not check.passed]


def no_colorvideovdp(*args):
    """In place of the judge that takes seconds a picture."""
    raise Missing("needs ColorVideoVDP: pip install 'domesim[metrics]'")


def change(monkeypatch, module, method, changed):
    """Have a module's `solved` find changed(posed, light) in place of a method's light."""
    honest = module.solved

    def solved(posed, asked, solver=None):
        found = honest(posed, asked, solver)
        return replace(found, light=changed(posed, found.light)) if asked == method else found

    monkeypatch.setattr(module, "solved", solved)
