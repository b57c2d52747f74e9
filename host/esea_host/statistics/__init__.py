"""Paired comparisons, effect sizes, power: arrays in, results out."""

from esea_host.statistics.agreement import Agreement, cohens_kappa
from esea_host.statistics.bayes import BayesPaired, bayes_paired
from esea_host.statistics.checks import NoStatisticError
from esea_host.statistics.crossover import Crossover, Effect, crossover
from esea_host.statistics.mixed import MixedModel, mixed_model
from esea_host.statistics.multiplicity import holm
from esea_host.statistics.paired_t import PairedEffect, standardised_difference
from esea_host.statistics.power import (
    PowerStatement,
    detectable_effect,
    paired_t_power,
    participants_needed,
    power_statement,
    signed_rank_power,
)
from esea_host.statistics.signed_rank import (
    ImpliedEffect,
    SignedRank,
    attainable_p,
    effect_from_p,
    signed_rank,
)

__all__ = [
    "Agreement",
    "BayesPaired",
    "Crossover",
    "Effect",
    "ImpliedEffect",
    "MixedModel",
    "NoStatisticError",
    "PairedEffect",
    "PowerStatement",
    "SignedRank",
    "attainable_p",
    "bayes_paired",
    "cohens_kappa",
    "crossover",
    "detectable_effect",
    "effect_from_p",
    "holm",
    "mixed_model",
    "paired_t_power",
    "participants_needed",
    "power_statement",
    "signed_rank",
    "signed_rank_power",
    "standardised_difference",
]
