"""Searching the torque model's numbers: exact slopes, methods by name, resuming, watching."""

import math
import sqlite3
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.identify.drafting import draft
from esea_gen.identify.published.fit import SEARCHES, interior_point, search_named
from esea_gen.identify.published.plant import FittedPlant
from esea_gen.identify.published.search_problem import Searching, SearchMemo, SearchProblem
from esea_gen.identify.published.space import Space
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.recording.reading import load_recordings
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS
from esea_gen.report.figures import search_picture
from tests.benchmarks.identification import KEYS, NumpyPopulation
from tests.rigs import rig, written

# Slopes of a Block.


# The problem: costs, gradients, refinement.


class Waves:
    """A plant whose torque is known: k1 x + k3 x^3 + alpha sin(x / omega) exp(-beta x^2)."""

    rate_terms, shape_keys, digest = False, ("omega_rad", "beta_1_rad"), "waves"

    def __init__(self, omega: float = 0.05, beta: float = 3.0, alpha: float = 2.0) -> None:
        self.x = np.linspace(-0.5, 0.5, 400)
        self.weight = np.full(400, 0.05)
        self.streams = (SimpleNamespace(theta_rad=self.x, training=(np.arange(400),)),)
        self.calls = 0
        self.measured = self.basis({"omega_rad": omega, "beta_1_rad": beta}) @ [5, 20, alpha]

    def basis(self, shape):
        self.calls += 1
        wave = np.sin(self.x / shape["omega_rad"]) * np.exp(-shape["beta_1_rad"] * self.x**2)
        return np.stack([self.x, self.x**3, wave], axis=1)

    def tangent(self, shape, linear):
        omega, bell = shape["omega_rad"], np.exp(-shape["beta_1_rad"] * self.x**2)
        by_omega = -self.x / omega**2 * np.cos(self.x / omega) * bell
        by_beta = -(self.x**2) * np.sin(self.x / omega) * bell
        return linear[2] * np.stack([by_omega, by_beta], axis=1)


SPACE = Space(False, 0.5, 1.0, 10.0)


def problem(plant=None, memo=None, **how) -> SearchProblem:
    return SearchProblem(
        plant or Waves(), SPACE, memo or SearchMemo(), Searching(**how), lambda count, best: None
    )


def at(omega: float, beta: float) -> np.ndarray:
    return np.array([math.log(omega), math.log1p(beta * 0.5)])


def cost(p, x):
    return p.costs(x[None])[0]


def by_differences(p, x, step=1e-6):
    return np.array([(cost(p, x + e) - cost(p, x - e)) / (2 * step) for e in step * np.eye(len(x))])


# A wave of the other sign cannot be taken up: alpha is then at its bound 0.
@pytest.mark.parametrize("alpha", [2.0, -2.0])
def test_the_gradient_is_that_of_the_cost_with_the_linear_part_solved(alpha):
    p = problem(Waves(alpha=alpha))
    for x in (at(0.055, 2.0), at(0.04, 6.0), at(0.09, 0.5)):
        found, slope = p.gradient(x)
        assert found == pytest.approx(cost(p, x), rel=1e-13)
        expected = by_differences(p, x)
        assert slope == pytest.approx(expected, rel=1e-5, abs=1e-9 + 1e-6 * np.abs(expected).max())


def test_a_refinement_ends_by_its_tolerances_in_few_runs():
    plant = Waves()
    (cost, x), (again, _) = problem(plant).refined([at(0.053, 2.0), at(0.047, 4.0)], 500)
    assert max(cost, again) < 1e-12
    assert np.exp(x[0]) == pytest.approx(0.05, rel=1e-5)
    assert np.expm1(x[1]) / 0.5 == pytest.approx(3.0, rel=1e-4)
    assert plant.calls < 60


def test_the_sensors_own_c_gives_the_gradient(elbow):
    """All seven numbers, over a sweep that starts at rest, where a power's base is 0."""
    t = np.arange(1500) / 100
    theta = 0.15 * np.sin(2 * np.pi * (0.05 + 0.05 * t) * t) * (t > 0.5)
    rows = np.arange(1500)
    recording = SimpleNamespace(
        label="sweep",
        time_s=t,
        theta_rad=theta,
        tau_Nm=12 * theta,
        conditions=(),
        sets=(SimpleNamespace(label="a", training=rows, held_out=rows[:0], cycles={}),),
    )
    plant = FittedPlant(elbow, [recording], 100.0)
    space = Space(True, 0.15, 1.0, 15.0)
    p = SearchProblem(plant, space, SearchMemo(), Searching(jobs=1), lambda count, best: None)
    true = {k.rsplit(".", 1)[-1]: q.value for k, q in elbow.quantities() if "elastomer." in k}
    plant.measured = plant.torque({k: true[k] for k in (*MODEL_KEYS, *RATE_KEYS)})
    # The bench's model in NumPy is the same function: both sum the same noise-free residual.
    one = {k: 1.03 * true[k] for k in (*MODEL_KEYS, *RATE_KEYS)}
    error = plant.weight * (plant.torque(one) - plant.measured)
    peer = NumpyPopulation(plant, 10).costs(np.array([[one[k], true[k]] for k in KEYS]))
    assert peer == pytest.approx([error @ error, 0.0], rel=1e-9, abs=1e-20)
    x = np.array([-3.8, 2.2, math.log(0.05), math.log(12), 2.5, math.log(50), 0.7])
    expected = by_differences(p, x)
    assert np.all(np.abs(expected) > 1e-4 * np.abs(expected).max())
    assert p.gradient(x)[1] == pytest.approx(expected, rel=1e-4, abs=1e-5 * np.abs(expected).max())


# Methods.


def test_the_interior_point_method_takes_exact_gradients_to_a_bound_and_inside():
    def noisy():
        plant = Waves()
        plant.measured = plant.measured + np.random.default_rng(2).normal(0, 0.01, 400)
        return problem(plant)

    p = noisy()
    found = interior_point(p, at(0.052, 2.0))
    assert found == pytest.approx(at(0.05, 3.0), abs=1e-2)
    assert cost(p, found) == pytest.approx(p.refined([found], 50)[0][0], rel=1e-5)
    # The truth is below the least spacing that may be searched.
    narrow = noisy()
    narrow.low = at(0.051, 0.1)
    assert interior_point(narrow, at(0.053, 3.0))[0] == pytest.approx(math.log(0.051), abs=1e-4)


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    source = load_mapping(written(tmp_path_factory.mktemp("rig"), *rig(*(0.05,) * 4, *(0.1,) * 4)))
    recordings = load_recordings(source)
    return FittedPlant(draft(source, recordings, False), recordings, None, 200)


def fitted(plant, tell=lambda count, best: None, method="multi-start", **how):
    """What was found, best first, and after how many runs."""
    memo, space = SearchMemo(how.get("resume")), Space(False, 0.1, 1.0, 10.0)
    p = SearchProblem(plant, space, memo, Searching(method, **how), tell)
    ends = sorted(search_named(method)(p, 7, 32), key=lambda e: e[0])
    p.over()
    return [(cost, x.tolist()) for cost, x in ends], p.evaluations


@pytest.mark.ci
def test_every_method_finds_the_same_optimum(plant):
    found = {m: fitted(plant, method=m)[0][0][0] for m in SEARCHES}
    assert max(found.values()) < 1.001 * min(found.values()), found


def test_cores_and_an_interruption_change_nothing(plant, tmp_path):
    whole = fitted(plant, jobs=1)
    assert fitted(plant, jobs=3) == whole

    def pulled(count, best):
        if count > 100:
            raise KeyboardInterrupt

    memo = tmp_path / "new" / "memo.db"
    with pytest.raises(KeyboardInterrupt):
        fitted(plant, pulled, resume=memo)
    assert 10 < kept(memo) < whole[1]
    assert fitted(plant, resume=memo) == whole
    # All is known now: nothing is added.
    every = kept(memo)
    assert fitted(plant, resume=memo) == whole
    assert kept(memo) == every


def kept(memo) -> int:
    with closing(sqlite3.connect(memo)) as file:
        return file.execute("SELECT COUNT(*) FROM search").fetchone()[0]


def test_who_watches_sees_each_improvement_and_the_end(plant):
    seen = []
    ends, _ = fitted(plant, watch=lambda best, last: seen.append((best, last)))
    costs = [best.cost for best, last in seen]
    assert costs[:-1] == sorted(costs[:-1], reverse=True)
    assert [last for _, last in seen] == [False] * (len(seen) - 1) + [True]
    best = seen[-1][0]
    assert best.cost == pytest.approx(ends[0][0], rel=1e-9)
    # Every data set counts the same: the cost is the mean of their mean squares.
    squares = [np.mean((model - measured) ** 2) for _, measured, model in best.sets]
    assert np.mean(squares) == pytest.approx(best.cost, rel=1e-9)
    figure = search_picture(best)
    assert len(figure.axes) == 1 + len(best.sets)
    assert figure.axes[1].get_lines()[1].get_ydata() == pytest.approx(best.sets[0][2])


# What a search keeps on the disk.


def test_what_is_no_record_is_refused_and_left_as_it_is(tmp_path):
    path = tmp_path / "search.db"
    SearchMemo(path).put((str(k), np.arange(9.0)) for k in range(999))
    torn = bytearray(path.read_bytes())
    torn[4096:8192] = bytes(4096)
    for content, why in ((b"t,x,y\n1,2,3\n", "not a database"), (bytes(torn), "")):
        path.write_bytes(content)
        with pytest.raises(UserError, match=f"cannot be used .*{why}") as refused:
            SearchMemo(path)
        assert "Name another file for --resume." in str(refused.value)
        assert path.read_bytes() == content


def test_what_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(UserError, match="cannot be used"):
        SearchMemo(tmp_path)
    (tmp_path / "file").write_text("x")
    with pytest.raises(UserError, match="cannot be used"):
        SearchMemo(tmp_path / "file" / "below")


# From searched numbers to a file's parameters.

X = np.array([math.log(0.01), 0.7, math.log(0.5), math.log(20.0), 1.5, math.log(4.0), 0.6])


def test_slopes_of_the_shape_are_those_by_differences():
    space, h = Space(True, 0.2, 3.0, 10.0), 1e-6
    slopes = space.shape_slopes(X)
    for i in range(len(X)):
        step = h * np.eye(len(X))[i]
        up, down = space.shape(X + step), space.shape(X - step)
        for key in up:
            by = (up[key] - down[key]) / (2 * h)
            assert slopes.get(key, {}).get(i, 0.0) == pytest.approx(by, rel=1e-6, abs=1e-7), (
                key,
                i,
            )
