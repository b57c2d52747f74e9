"""The database of responses: who answered how, where; one file with its provenance.

Categories come from the data: any number, of any joint.
"""

from __future__ import annotations

import hashlib
import io
import json
import warnings
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_gen.files import written_whole
from esea_host.assess import MEASURED_NOTICE, NOTICE
from esea_host.assess.patients import DEG, Array
from esea_host.assess.responses import ERROR_STAYS_S, Location, Passage

FORMAT = 2
RECORDINGS = "recordings"  # as the source of a database of people
KERNEL_RAD, KERNEL_rad_s = 6 * DEG, 10 * DEG
LEAST_WEIGHT_S = 0.1  # of a recording near a location, to say anything of it


@dataclass(frozen=True, eq=False)
class LocationGrid:
    """Locations of the map: centres of a grid of angle x rate, flattened angle by angle."""

    angle_rad: Array
    rate_rad_s: Array

    @classmethod
    def spanning(
        cls, angle_rad: tuple[float, float], rate_rad_s: tuple[float, float], shape: tuple[int, int]
    ) -> LocationGrid:
        edges = (
            np.linspace(*x, n + 1) for x, n in zip((angle_rad, rate_rad_s), shape, strict=True)
        )
        a, r = (0.5 * (e[1:] + e[:-1]) for e in edges)
        return cls(a, r)

    @property
    def cells(self) -> int:
        return len(self.angle_rad) * len(self.rate_rad_s)

    @property
    def centres(self) -> Array:
        """Shape (cells, 2): angle, rate."""
        a, r = np.meshgrid(self.angle_rad, self.rate_rad_s, indexing="ij")
        return np.stack([a.ravel(), r.ravel()], axis=1)

    def location(self, cell: int) -> Location:
        a, r = self.centres[cell]
        return Location(float(a), float(r))

    def weights(self, where: Location, known: npt.NDArray[np.bool_]) -> Array | None:
        """Bilinear weights of the cells, shape (cells,), of known ones alone; None outside."""
        out = np.zeros(self.cells)
        parts = []
        for grid, x in ((self.angle_rad, where.angle_rad), (self.rate_rad_s, where.rate_rad_s)):
            step = float(grid[1] - grid[0])
            if not grid[0] - step / 2 <= x <= grid[-1] + step / 2:
                return None
            place = float(np.clip((x - grid[0]) / step, 0, len(grid) - 1))
            low = min(int(place), len(grid) - 2)
            parts.append(((low, low + 1), (1 - (place - low), place - low)))
        for i, wi in zip(*parts[0], strict=True):
            for j, wj in zip(*parts[1], strict=True):
                out[i * len(self.rate_rad_s) + j] = wi * wj
        out[~known] = 0
        total = float(out.sum())
        # More than half of what it would lean on is unknown: say so.
        return out / total if total >= 0.5 else None


# 130 deg peak to peak, about 120 deg/s (thesis chapter 8).
KNEE_GRID = LocationGrid.spanning((0, 130 * DEG), (-120 * DEG, 120 * DEG), (13, 12))


@dataclass(frozen=True)
class CellResponses:
    """Responses of one person at the grid's locations.

    values: local linear estimates, shape (cells,), NaN where the person has not been; passes:
    separate ones (samples of one pass count once); weights: of the samples at ``time_s`` in each
    value, shape (cells, samples).
    """

    values: Array
    passes: Array
    weights: Array
    time_s: Array

    def error_Nm2(self, error_Nm: float) -> Array:
        """Covariance of the values, from an error of the sensor that stays for a while."""
        late = np.abs(self.time_s[:, None] - self.time_s)
        return error_Nm**2 * self.weights @ np.exp(-late / ERROR_STAYS_S) @ self.weights.T


def responses_at(p: Passage, grid: LocationGrid) -> CellResponses:
    every = max(1, round(0.02 / float(p.time_s[1] - p.time_s[0])))
    strained = p.strained[::every]
    columns = p.angle_rad, p.rate_rad_s, p.response_Nm, p.time_s
    a, r, y, t = (x[::every][~strained] for x in columns)
    h = every * float(p.time_s[1] - p.time_s[0])
    centres = grid.centres
    da = (a - centres[:, :1]) / KERNEL_RAD
    dr = (r - centres[:, 1:]) / KERNEL_rad_s
    w = np.exp(-0.5 * (da**2 + dr**2))
    seen = h * w.sum(axis=1) >= LEAST_WEIGHT_S
    basis = np.stack([np.ones_like(da), da, dr], axis=2)
    normal = np.einsum("cs,csi,csj->cij", w, basis, basis)
    # A little ridge on the slopes: where all lies on one line, the slope across it stays near 0.
    normal += w.sum(axis=1)[:, None, None] * np.diag([0, 0.02, 0.02])
    first = np.zeros((len(centres), 3))
    first[seen] = np.linalg.inv(normal[seen])[:, 0]
    weights = np.einsum("ci,csi,cs->cs", first, basis, w)
    near = da**2 + dr**2 < 1.5**2
    begins = near & ~np.concatenate([np.zeros((len(near), 1), bool), near[:, :-1]], axis=1)
    values = np.where(seen, weights @ y, np.nan)
    return CellResponses(values, begins.sum(axis=1).astype(np.float64), weights, t)


# Category, responses, passes, and of the first of a category the covariance of the errors.
Answers = tuple[str, Array, Array, Array | None]


def answered(people: Iterable[tuple[str, Passage]], grid: LocationGrid) -> Iterator[Answers]:
    known = set()
    for name, p in people:
        found = responses_at(p, grid)
        error = None if name in known else found.error_Nm2(p.error_Nm)
        known.add(name)
        yield name, found.values, found.passes, error


@dataclass(frozen=True)
class ResponseDataBase:
    """Responses of many people of known categories.

    categories: in the order of the numbers in ``category``; ``reference`` names the one (if any)
        that stands for no disorder: it is no diagnosis, but mixtures are measured from it.
    category: number of each person's category, shape (people,).
    responses: shape (people, cells), NaN where a person has not been; passes likewise.
    provenance: where all this comes from; calibration: numbers fitted on other people.
    error_Nm2: covariance that the sensor's error alone gives a person's responses, shape (cells,
        cells); none: not known.
    """

    grid: LocationGrid
    categories: tuple[str, ...]
    category: npt.NDArray[np.int64]
    responses: Array
    passes: Array
    provenance: Mapping[str, Any]
    reference: str | None = None
    calibration: Mapping[str, float] | None = None
    error_Nm2: Array | None = None

    def __post_init__(self) -> None:
        # As files hold them, in seven digits: small, and the same where machines' last ones differ.
        for name in ("responses", "error_Nm2"):
            if (found := getattr(self, name)) is not None:
                seven = np.asarray(found, dtype=np.float32).astype(np.float64)
                object.__setattr__(self, name, seven)

    @classmethod
    def of(
        cls,
        people: Iterable[Answers],
        grid: LocationGrid,
        provenance: Mapping[str, Any],
        reference: str | None = None,
    ) -> ResponseDataBase:
        """Build from responses of people, in recordings or as simulated knees."""
        names, rows, counts, of_first = zip(*people, strict=True)
        categories = tuple(dict.fromkeys(names))
        if len(categories) < 2:
            raise UserError(
                f"database: {len(categories)} categories.", "Record at least 2 of them."
            )
        # Paths are much the same: the first of each category stands for its errors.
        errors = [of_first[names.index(c)] for c in categories]
        return cls(
            grid,
            categories,
            np.array([categories.index(n) for n in names]),
            np.array(rows),
            np.array(counts),
            dict(provenance),
            reference,
            error_Nm2=np.mean(errors, axis=0),
        )

    @property
    def diagnoses(self) -> tuple[str, ...]:
        return tuple(c for c in self.categories if c != self.reference)

    def rows(self, category: str) -> Array:
        """Responses of the people of one category, shape (people, cells)."""
        if category not in self.categories:
            raise UserError(
                f"database: no category {category!r}.", f"Use {', '.join(self.categories)}."
            )
        return np.asarray(self.responses[self.category == self.categories.index(category)])

    def mean(self, category: str) -> Array:
        """Mean response, shape (cells,); NaN where nobody has been."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a cell where nobody has been is NaN
            return np.asarray(np.nanmean(self.rows(category), axis=0))

    @property
    def common(self) -> npt.NDArray[np.bool_]:
        """Locations that nearly all people of every category have passed: the extent of the map."""
        shares = [np.isfinite(self.rows(c)).mean(axis=0) for c in self.categories]
        return np.asarray(np.min(shares, axis=0) >= 0.8)

    @property
    def notice(self) -> str:
        return MEASURED_NOTICE if self.provenance.get("source") == RECORDINGS else NOTICE

    @cached_property
    def digest(self) -> str:
        return _digest(*self._content())

    def _content(self) -> tuple[dict[str, Any], dict[str, Any]]:
        head = {
            "format": FORMAT,
            "categories": list(self.categories),
            "reference": self.reference,
            "provenance": dict(self.provenance),
            "calibration": None if self.calibration is None else dict(self.calibration),
        }
        arrays = {
            "angle_rad": self.grid.angle_rad,
            "rate_rad_s": self.grid.rate_rad_s,
            "category": self.category,
            "responses_Nm": np.asarray(self.responses, np.float32),
            "passes": self.passes,
            "error_Nm2": np.asarray([] if self.error_Nm2 is None else self.error_Nm2, np.float32),
        }
        return head, arrays

    def save(self, path: Path) -> str:
        """Write as one file, the same bytes for the same content; return its digest."""
        head, arrays = self._content()
        head["digest"] = self.digest
        arrays["head"] = np.frombuffer(json.dumps(head, sort_keys=True).encode(), np.uint8)
        with written_whole(path) as scratch, zipfile.ZipFile(scratch, "w") as file:
            for name, array in arrays.items():
                buffer = io.BytesIO()
                np.save(buffer, array, allow_pickle=False)
                entry = zipfile.ZipInfo(f"{name}.npy")  # without a time
                file.writestr(entry, buffer.getvalue(), zipfile.ZIP_DEFLATED)
        return self.digest

    @classmethod
    def load(cls, path: Path) -> ResponseDataBase:
        """Read one file; refuse one that was changed or cut."""
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {n: file[n] for n in file.files}
            head = json.loads(arrays.pop("head").tobytes())
            claimed = head.pop("digest")
        except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
            raise UserError(
                f"{path}: no response database ({error}).", "Make one: esea-host assess build FILE"
            ) from error
        if head.get("format") != FORMAT:
            raise UserError(
                f"{path}: format {head.get('format')}, not {FORMAT}.", "Build it again."
            )
        if _digest(head, arrays) != claimed:
            raise UserError(f"{path}: the content was changed after saving.", "Build it again.")
        fitted = list((head["calibration"] or {}).values())
        if np.isinf(arrays["responses_Nm"]).any() or not np.all(np.isfinite(fitted)):
            raise UserError(
                f"{path}: a response or a calibrated number is infinite or missing.",
                "Build it again; NaN is allowed only where a person was not measured.",
            )
        return cls(
            LocationGrid(arrays["angle_rad"], arrays["rate_rad_s"]),
            tuple(head["categories"]),
            arrays["category"],
            arrays["responses_Nm"],
            arrays["passes"],
            head["provenance"],
            head["reference"],
            head["calibration"],
            arrays["error_Nm2"] if arrays["error_Nm2"].size else None,
        )


def shipped() -> ResponseDataBase:
    """The simulated knee's database, which comes with the tool (see ``build``)."""
    return ResponseDataBase.load(Path(__file__).with_name("knee.npz"))


def _digest(head: Mapping[str, Any], arrays: Mapping[str, Any]) -> str:
    found = hashlib.sha256(json.dumps(head, sort_keys=True).encode())
    for name in sorted(arrays):
        found.update(f"{name}{arrays[name].shape}{arrays[name].dtype}".encode())
        found.update(np.ascontiguousarray(arrays[name]).tobytes())
    return found.hexdigest()
