"""What a search keeps on the disk: what is taken again, mended or refused."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.identify.published.search_memo import HEAD, SearchMemo


def test_numbers_are_kept_in_memory_and_on_the_disk(tmp_path):
    path = tmp_path / "deep" / "search.txt"
    memo = SearchMemo(path)
    assert HEAD == "esea-gen search 1"
    assert path.read_text() == "esea-gen search 1\n"
    memo.put([("x", (0.1, -2)), ("y", np.array([1 / 3, 2.0])), ("z", 7)])
    memo.put([])
    memo.put([("x", [5.0])])
    kept = {"x": (5.0,), "y": (1 / 3, 2.0), "z": (7.0,), "none": None}
    assert {n: memo.get(n) for n in kept} == kept
    lines = path.read_text().splitlines()
    assert lines == [HEAD, '["x", 0.1, -2.0]', f'["y", {1 / 3!r}, 2.0]', '["z", 7.0]', '["x", 5.0]']
    again = SearchMemo(path)
    assert {n: again.get(n) for n in kept} == kept
    own = SearchMemo()
    own.put([("x", (1.5,))])
    assert own.get("x") == (1.5,)


@pytest.mark.parametrize(
    ("left", "kept", "known"),
    [
        ("", f"{HEAD}\n", None),
        ("esea-g", f"{HEAD}\n", None),
        (HEAD, f"{HEAD}\n", None),
        (f'{HEAD}\n["x", 1.5]\n["y", 2', f'{HEAD}\n["x", 1.5]\n', (1.5,)),
        (f'{HEAD}\n\n["x", 1.5]\n', f'{HEAD}\n\n["x", 1.5]\n', (1.5,)),
        (f'{HEAD}\n["y"]\n', f'{HEAD}\n["y"]\n', None),
    ],
)
def test_a_torn_end_is_cut_off(tmp_path, left, kept, known):
    path = tmp_path / "search.txt"
    path.write_text(left)
    assert SearchMemo(path).get("x") == known
    assert path.read_text() == kept


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("esea-gen search 2\n", "is no record of a search"),
        ("t,x,y\n1,2,3\n", "is no record of a search"),
        (f'{HEAD}\n["x", 1.5]\n["y", "two"]\n', "line 3: is damaged"),
        (f"{HEAD}\n7\n", "line 2: is damaged"),
        (f'{HEAD}\n["x", null]\n', "line 2: is damaged"),
        (f'{HEAD}\n["x", 1\n', "line 2: is damaged"),
    ],
)
def test_what_is_no_record_is_refused_and_left_as_it_is(tmp_path, text, words):
    path = tmp_path / "search.txt"
    path.write_text(text)
    with pytest.raises(UserError, match=words) as refused:
        SearchMemo(path)
    assert "Name another file for --resume." in str(refused.value)
    assert path.read_text() == text


def test_what_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(UserError, match="cannot be used"):
        SearchMemo(tmp_path)
    (tmp_path / "file").write_text("x")
    with pytest.raises(UserError, match="cannot be used"):
        SearchMemo(tmp_path / "file" / "below")
