"""Every test against R: ties, zeros, missing periods, 2 to 200 people.

Base R and nlme, with R's own function where there is one, else enumeration or integration there.
"""

from __future__ import annotations

import subprocess

import numpy as np
import pytest

from esea_host import statistics
from tests.conftest import require_tool

pytestmark = pytest.mark.ci

FUNCTIONS = """
suppressPackageStartupMessages(library(nlme)); options(warn = -1)
two <- function(s, o) min(1, 2 * min(mean(s <= o + 1e-9), mean(s >= o - 1e-9)))
signs <- function(d) {
  r <- rank(abs(d)); all <- as.matrix(expand.grid(rep(list(0:1), length(d))))
  two(all %*% r, sum(r[d > 0])) }
bayes <- function(x) {
  n <- length(x); s <- sqrt(n) * mean(x) / sd(x)
  like <- function(d) dt(s, n - 1, d * sqrt(n)) * dcauchy(d, 0, sqrt(0.5))
  log(dt(s, n - 1)) - log(integrate(like, -Inf, Inf, rel.tol = 1e-10, subdivisions = 1000)$value) }
mixed <- function(y, id, a, b) {
  m <- lme(y ~ a + b, random = ~1 | factor(id), method = "REML",
    control = lmeControl(returnObject = TRUE, tolerance = 1e-12, msTol = 1e-14))
  s <- summary(m)$tTable; c(s[2, c(1, 2, 5)], s[3, c(1, 2, 5)], s[2, 3]) }
kappa <- function(m) {
  n <- sum(m); p <- m / n; d <- rowSums(p); e <- colSums(p); o <- sum(diag(p)); x <- sum(d * e)
  k <- (o - x) / (1 - x); w <- outer(e, d, "+")
  v <- sum(diag(p) * (1 - diag(w) * (1 - k))^2) + (1 - k)^2 * (sum(p * w^2) - sum(diag(p * w^2)))
  v <- (v - (k - x * (1 - k))^2) / n / (1 - x)^2; k + c(0, -1, 1) * qnorm(0.975) * sqrt(v) }
"""


def vector(values):
    return f"c({','.join(repr(float(v)) for v in values)})"


def flags(values):
    return f"as.logical({vector(values)})"


def samples():
    """Normal, five-level, tenths, heavy tails, skew: each of 2 to 200 people."""
    rng = np.random.default_rng(5)
    for n in (2, 3, 4, 5, 7, 10, 15, 19, 30, 51, 200):
        for draw in (
            lambda n: rng.normal(0.4, 1, n),
            lambda n: np.round(rng.normal(0.5, 1.5, n)),
            lambda n: np.round(rng.normal(0.3, 1, n), 1),
            lambda n: rng.standard_t(3, n),
            lambda n: rng.exponential(1, n) - 0.5,
        ):
            yield n, draw, rng


def paired(d):
    """Ours, and R's expression, of one sample of differences."""
    text, n = vector(d), len(d)
    if d.any():
        found = statistics.signed_rank(d)
        if found.method == "normal":
            yield found.p, f"wilcox.test({text}, exact = FALSE)$p.value"
        if n <= 15:
            kept = vector(d[d != 0])
            yield found.p, f"signs({kept})"
        if len(np.unique(np.abs(d))) == n and n <= 50 and d.all():
            both = found.hodges_lehmann, found.low, found.high
            test = f"wilcox.test({text}, exact = TRUE, conf.int = TRUE)"
            yield (found.p, *both), f"with({test}, c(p.value, estimate, conf.int))"
    if np.std(d) > 0:
        e = statistics.standardised_difference(d)
        yield (e.p, e.low, e.high), f"with(t.test({text}), c(p.value, conf.int))"
        yield statistics.bayes_paired(d).log_bayes_factor_01, f"bayes({text})"


def periods(n, draw, rng):
    one = 3 * draw(n) + 10
    two = one + draw(n)
    first = rng.permutation(n) < max(2, round(0.4 * n))
    found = statistics.crossover(one, two, np.where(first, "A", "B").tolist(), ("A", "B"))
    change = np.round(one - two, 9)
    turned = np.where(first, -change, change)
    effects = found.treatment, found.period, found.carry_over
    for effect, v in zip(effects, (change, turned, np.round(one + two, 9)), strict=True):
        if np.isfinite(effect.p):
            groups = f"{vector(v[first])}, {vector(v[~first])}"
            yield effect.p, f"t.test({groups}, var.equal = TRUE)$p.value"
    y, who = np.concatenate([one, two]), np.tile(np.arange(n), 2)
    a, b = np.concatenate([first, ~first]), np.repeat([False, True], n)
    for share in (0, 0.25):
        here = rng.random(2 * n) >= share
        columns = y[here], who[here], a[here], b[here]
        try:
            m = statistics.mixed_model(
                columns[0],
                columns[1],
                np.where(columns[2], "A", "B").tolist(),
                np.where(columns[3], 2, 1).tolist(),
                ("A", "B"),
            )
        except statistics.NoStatisticError:
            continue
        effects = m.treatment, m.treatment_se, m.treatment_p, m.period, m.period_se, m.period_p
        yield (*effects, m.df), f"mixed({', '.join(map(vector, columns))})"


def cases():
    for n, draw, rng in samples():
        yield from paired(draw(n))
        if n >= 4:
            yield from periods(n, draw, rng)
        p = rng.uniform(0, 1, n) ** 3
        yield statistics.holm(p), f"p.adjust({vector(p)}, 'holm')"
        one, other = rng.choice(list("abc"), (2, n + 3), p=[0.6, 0.2, 0.2])
        if (one != other).any():
            k = statistics.cohens_kappa(one, other)
            if k.low > -1 and k.high < 1:
                table = f"matrix({vector(np.ravel(k.table, 'F'))}, {len(k.table)})"
                yield (k.kappa, k.low, k.high), f"kappa({table})"
        for size in (0.1, 0.5, 1.0, 3.0):
            test = f"power.t.test({n}, {size}, 1, type = 'paired', strict = TRUE)$power"
            yield statistics.paired_t_power(n, size), test


def test_every_function_against_r(tmp_path):
    found = list(cases())
    program = tmp_path / "all.R"
    lines = [f'cat(sprintf("%.17g", {text}), "\\n")' for _, text in found]
    program.write_text("\n".join([FUNCTIONS, *lines]))
    command = [require_tool("Rscript"), program]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    theirs = run.stdout.splitlines()
    assert len(theirs) == len(found) > 700
    for (ours, text), line in zip(found, theirs, strict=True):
        # lme stops within some 1e-5 of the likelihood's maximum.
        close = 2e-4 if text.startswith("mixed") else 2e-6
        values = [float(x) for x in line.split()]
        assert np.atleast_1d(ours) == pytest.approx(values, rel=close, abs=close / 10), text
