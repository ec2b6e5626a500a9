"""How fine an open-circuit curve the runs ask for beside a network's, and whether their counted charge slips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.reference.samples import Samples
from models.diagnosis.structure.nuisances import Nuisances
from models.effects.spline import SplineBasis

_RESOLUTIONS = (0, 10, 20, 40)
_RIDGES = (1e-7, 1e-5, 1e-3)
_EFFECTS_RIDGE = 1e-5
# Of one sample, against which what is open is known.
_NOISE_V = 1e-3
# A finer curve must lower the squared held-out error by this share; a slip of the charge, which looks like an offset of
# the current for a while, by this one.
_WORTH, _SLIPS_WORTH = 0.01, 0.1


@dataclass(frozen=True)
class _Tried:
    loss: float
    evidence: Evidence
    size: int


def resolved(
    samples: Samples, error: FloatArray, own: FloatArray, open_: Nuisances, others: FloatArray
) -> tuple[Evidence, int]:
    """Raise the resolution of the open-circuit curve until the held-out error stops falling.

    The effects are in the model meanwhile: beside one that is not, no finer curve would show.

    Parameters
    ----------
    samples : of all runs
    error, own : (n,), (n, p) error of the network and what its parameters may do
    open_ : what is open of it besides
    others : (n, k) regressors of all effects

    Returns
    -------
    The error beside everything that is open, and the number of bumps that the curve needs.
    """
    found, slipping = (_finest(samples, error, own, open_, others, slips=slips) for slips in (False, True))
    chosen = slipping if slipping.loss < (1.0 - _SLIPS_WORTH) * found.loss else found
    return chosen.evidence, chosen.size


def _finest(
    samples: Samples, error: FloatArray, own: FloatArray, open_: Nuisances, others: FloatArray, *, slips: bool
) -> _Tried:
    soc = np.concatenate([view.soc[view.index] for view in samples.views])
    unknown, per_run = open_.all(slips=slips), open_.per_run(slips=slips)
    best: _Tried | None = None
    for size in _RESOLUTIONS:
        curve = SplineBasis(float(soc.min()), float(soc.max()), size).matrix(soc) if size else np.zeros((len(soc), 0))
        regressors = np.hstack([own, curve, unknown])
        p, wider = regressors.shape[1], np.hstack([regressors, others])
        scale = (wider**2).sum(axis=0) + 1e-12
        plain = Evidence(error, wider, np.diag(scale), samples.blocks)
        known, losses = np.full(unknown.shape[1], _NOISE_V**2), {}
        for ridge in _RIDGES:
            prior = np.concatenate([ridge * scale[: p - len(known)], known, _EFFECTS_RIDGE * scale[p:]])
            losses[ridge] = float((plain.with_information(np.diag(prior)).null_errors_V ** 2).sum())
        ridge = min(losses, key=losses.__getitem__)
        if best is not None and losses[ridge] > (1.0 - _WORTH) * best.loss:
            break
        information = np.diag(np.concatenate([ridge * scale[: p - len(known)], known]))
        found = Evidence(error, regressors, information, samples.blocks, (p - per_run, p))
        best = _Tried(losses[ridge], found, size)
    assert best is not None
    return best
