"""From what each effect explains to what is named: parsimony, rivals, significance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.diagnosis.evidence.candidates import Candidate, Comparison, noise_V2
from models.diagnosis.evidence.forms import Forms, forms_of, nested

# What an effect must explain for each of its regressors, or it is not worth them: the logarithm of the number of
# samples in units of the noise (Schwarz, Annals of Statistics 6, 1978), and this share of the squared error as far as
# the model's own error is systematic.
_SHARE_EACH = 0.005
# Two effects cannot be told apart where their remaining errors differ by less than this share of the model's own
# systematic error and by less than this logarithm of the likelihood ratio.
_OF_SYSTEMATIC, _LOG_LIKELIHOOD = 0.25, 10.0
# A special case is told beside its general form where it explains at least this share of it.
_SPECIAL_CASE = 0.3
# Least size of an effect: absolute, and relative to the model's own error and to the systematic part of that.
_LEAST_V, _LEAST_OF_OWN, _LEAST_OF_BIAS = 3e-4, 0.2, 0.4
# Least of what a refit without it leaves, in units of the noise: less is also left by corners of the model.
_LEAST_SHOWN = 0.4
# Before anything counts as new, the squared error must go beyond the model's own by this share of the latter, and by
# this multiple of what the latter has beyond the measurement's noise: a model that is wrong in one record is about as
# wrong in another.
_LEAST_BEYOND, _LEAST_OF_SYSTEMATIC = 0.08, 1.2
# Least ratio of the squared error to the model's own for saying that something unknown is there.
_UNKNOWN_RATIO = 1.5
# Where the model is as good as the measurement's noise, chance alone decides, and an effect this many times above it is
# none; elsewhere an effect has to show in held-out blocks.
_GOOD_MODEL, _ABOVE_CHANCE, _SURELY_NEW = 0.25, 10.0, 20.0
# There, an effect this many times above chance is named for what it explains, as long as it leaves no more than this
# multiple of the model's own squared error: a model of one record is that far off in another one.
_FAR_ABOVE_CHANCE, _OFF_ELSEWHERE = 40.0, 1.15
# Least share of what is new that a named effect must explain.
_LEAST_SHARE_OF_NEW = 0.5
_LEAST_HELD_OUT_SHARE = 0.03


@dataclass(frozen=True)
class Ranking:
    """Effects in order, with what decides about them.

    Attributes
    ----------
    candidates : the named one first, then by what they explain
    rivals : of the named one, those that these data cannot tell from it
    ratio : squared error over the model's own on the training runs
    size_V : size of the named effect
    shown_V : what a refit without it leaves of that, in the root mean square
    share : of the squared error that the named effect explains
    share_of_new : of what goes beyond the model's own error
    held_out_share : share that it explains in held-out blocks
    margin : by how much the best rival's remaining error is larger; below 1 the two cannot be told apart
    own_V, bias_V, noise_V : the model's own error on the training runs, the part of it beyond the measurement's noise,
        and that
    something_new : whether the error goes beyond the model's own
    beyond_chance : whether the named effect explains more than chance does
    stands_out : whether it does so by far, and leaves little
    forms, price : every form of the candidates, and what each parameter must explain, V^2
    """

    candidates: tuple[Candidate, ...]
    rivals: tuple[str, ...]
    ratio: float
    size_V: float
    shown_V: float
    share: float
    share_of_new: float
    held_out_share: float
    margin: float
    own_V: float
    bias_V: float
    noise_V: float
    something_new: bool
    beyond_chance: bool
    stands_out: bool
    forms: Forms
    price: float

    @property
    def least_V(self) -> float:
        """Size below which an effect would not be named."""
        return max(_LEAST_V, _LEAST_OF_OWN * self.own_V + _LEAST_OF_BIAS * self.bias_V)

    @property
    def significant(self) -> bool:
        """Whether the named effect is more than chance and more than the model's own error."""
        large = self.size_V >= self.least_V and self.shown_V >= _LEAST_SHOWN * self.noise_V
        return self.something_new and large and self.beyond_chance

    @property
    def figures(self) -> dict[str, float]:
        """What decided, for a person who wants to know."""
        return {
            "margin": self.margin,
            "size_mV": 1e3 * self.size_V,
            "least_mV": 1e3 * self.least_V,
            "held_out_share": self.held_out_share,
            "ratio": self.ratio,
            "n_rivals": len(self.rivals),
        }

    @property
    def explained(self) -> bool:
        """Whether the named effect explains most of what is new, or all but what is hardly worth a word."""
        return self.share_of_new >= _LEAST_SHARE_OF_NEW or self.stands_out

    @property
    def unknown(self) -> bool:
        """Whether there is something new that no effect explains."""
        return self.something_new and self.ratio >= _UNKNOWN_RATIO and not (self.significant and self.explained)


def rank(comparison: Comparison, candidates: list[Candidate]) -> Ranking:
    """Order candidates and judge the best."""
    evidence = comparison.evidence
    n, cost = len(evidence.error_V), evidence.cost
    noise = noise_V2(comparison, min(candidates, key=lambda each: each.solution.cost))
    systematic = comparison.own_mse - comparison.noise_mse
    price = max(float(np.log(n)) * noise, _SHARE_EACH * cost * systematic / comparison.own_mse)
    forms = forms_of(comparison, candidates)
    spent = {each.effect.name: forms.spent(each.effect, price) for each in candidates}
    named, held_out = _best(comparison, candidates, forms, price)
    unit = _OF_SYSTEMATIC * n * systematic + 2.0 * _LOG_LIKELIHOOD * noise
    margins = {name: (price - spent[named.effect.name]) / unit for name, price in spent.items()}
    others = sorted((each for each in candidates if each is not named), key=lambda each: margins[each.effect.name])
    foreign = [each for each in others if margins[each.effect.name] < 0.0 or not nested(each.effect, named.effect)]
    rivals = [each for each in foreign if margins[each.effect.name] < 1.0 or each.effect.name == named.effect.twin]
    rivals += [each for each in _special_cases(named, others, cost) if each not in rivals]
    least = 2.0 * _LOG_LIKELIHOOD * noise
    rivals += [each for each in others if forms.imitates(each.effect, named.effect, price, least)]
    rivals.sort(key=lambda each: each.effect.name != named.effect.twin)
    rest = [each for each in others if each not in rivals]
    gained, own = cost - named.solution.cost, n * comparison.own_mse
    allowance = comparison.bias_allowance
    beyond = _LEAST_BEYOND * comparison.own_mse + _LEAST_OF_SYSTEMATIC * allowance * systematic
    good = systematic <= _GOOD_MODEL * comparison.noise_mse
    above_chance = good and held_out > 0.0 and gained >= _ABOVE_CHANCE * named.size * noise
    surely_new = good and gained >= _SURELY_NEW * named.size * noise
    far_above = above_chance and gained >= _FAR_ABOVE_CHANCE * named.size * noise
    return Ranking(
        (named, *rivals, *rest),
        tuple(each.effect.name for each in rivals),
        ratio=cost / own,
        size_V=float(np.sqrt(np.mean(named.contribution_V**2))),
        shown_V=float(np.sqrt(max(gained, 0.0) / n)),
        share=gained / cost,
        share_of_new=gained / max(cost - own, gained, 1e-300),
        held_out_share=held_out,
        margin=min(
            (margins[each.effect.name] for each in foreign if each.effect.name != named.effect.twin), default=10.0
        ),
        own_V=float(np.sqrt(comparison.own_mse)),
        bias_V=allowance * float(np.sqrt(max(systematic, 0.0))),
        noise_V=float(np.sqrt(comparison.noise_mse)),
        something_new=surely_new or cost / n - comparison.own_mse >= beyond,
        beyond_chance=held_out >= _LEAST_HELD_OUT_SHARE or above_chance,
        stands_out=far_above and named.solution.cost <= _OFF_ELSEWHERE * own,
        forms=forms,
        price=price,
    )


def _best(comparison: Comparison, candidates: list[Candidate], forms: Forms, price: float) -> tuple[Candidate, float]:
    """The one that leaves least; where it makes held-out blocks worse, the best with one parameter that does not.

    A curve over SoC can be fitted wherever the record stays, and says nothing of where it has not been.
    """
    order = sorted(candidates, key=lambda each: forms.spent(each.effect, price))
    best = order[0], _held_out_share(comparison, order[0], forms, price)
    if best[1] >= 0.0:
        return best
    for each in order[1:]:
        if each.size == 1 and (share := _held_out_share(comparison, each, forms, price)) >= _LEAST_HELD_OUT_SHARE:
            return each, share
    return best


def _held_out_share(comparison: Comparison, named: Candidate, forms: Forms, price: float) -> float:
    """Share of the squared error in held-out blocks that an effect explains, in its full or its best form."""
    evidence, form = comparison.evidence, forms.forms[forms.best(named.effect, price)]
    gained = float(evidence.gains(named.columns, named.target_V).sum())
    if form.fixed_V is None and form.columns is not named.columns:
        gained = max(gained, float(evidence.gains(form.columns).sum()))
    return gained / float((evidence.null_errors_V**2).sum())


def _special_cases(named: Candidate, others: list[Candidate], cost: float) -> list[Candidate]:
    """The best special case of a general effect, where it explains a good part of it."""
    inner = [each for each in others if each.effect.name in named.effect.contains]
    gained = cost - named.solution.cost
    worth = [each for each in inner if cost - each.solution.cost >= _SPECIAL_CASE * gained]
    # A constant resistance inside a resistance over SoC is a part of the finding, not another explanation.
    return worth[:1] if named.effect.local is not None and named.effect.absorbed else []
