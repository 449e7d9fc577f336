"""Words: reading, counting, inserting, dropping, rotating."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contimpact.errors import InputError
from contimpact.models.guards import LONGEST_WORD, Word, parse_word

READ = [
    ("1:1", "BT", 1),
    ("2:1", "BBT", 1),
    ("1:2", "BTT", 1),
    ("3:2", "BBBTT", 1),
    ("1:0", "B", 1),
    ("0:1", "T", 1),
    ("0:2/3T", "TTTTTT", 3),
    ("1:1/1T", "BT", 1),
    ("1:1/2T", "BTBT", 2),
    ("2:1/2T", "BBTBBT", 2),
    ("01:1", "BT", 1),
    ("B", "B", 1),
    ("TB", "TB", 1),
    ("BTBT", "BTBT", 1),
    ("BTBT/2T", "BTBT", 2),
    ("B/3T", "B", 3),
    ("BBTBBTT/2T", "BBTBBTT", 2),
]

WRONG = [
    "",
    " ",
    "1",
    "1:1:1",
    "0:0",
    "0:0/2T",
    "1:1/0T",
    "BT/0T",
    "1:1/",
    "1:1/T",
    "1:1/2",
    "1:1/2t",
    "1:1/-1T",
    "1:1/1.5T",
    "-1:1",
    "1.0:1",
    "1;1",
    "bt",
    "BX",
    "S",
    "B T",
    "B1",
    "B_T",
    "1:B",
    " 1:1",
    "1:1 ",
    "1:1\n",
    "BT\n",
    "BT/2TT",
    "BT/2T/2T",
    None,
    5,
    1.5,
    b"BT",
    ["B", "T"],
    ("1", "1"),
]


@pytest.mark.parametrize(("text", "walls", "period"), READ)
def test_read(text, walls, period):
    word = parse_word(text, "BT")
    assert word == Word(walls, period)
    assert len(word) == len(walls)


@pytest.mark.parametrize(("text", "walls", "period"), READ)
def test_printed_word_reads_back(text, walls, period):
    word = Word(walls, period)
    assert parse_word(str(word), "BT") == word
    assert ("/" in str(word)) == (period != 1)


@pytest.mark.parametrize("text", WRONG)
def test_wrong(text):
    with pytest.raises(InputError) as caught:
        parse_word(text, "BT", "follow.orbits[0]")
    assert caught.value.where == "follow.orbits[0]"
    assert repr(text) in caught.value.found


@pytest.mark.parametrize(
    ("text", "walls", "period"),
    [("1", "S", 1), ("2", "SS", 1), ("1/2T", "SS", 2), ("S/2T", "S", 2), ("SSS/2T", "SSS", 2)],
)
def test_one_wall(text, walls, period):
    assert parse_word(text, ["S"]) == Word(walls, period)


def test_one_wall_has_no_colon():
    with pytest.raises(InputError, match=r"give n, n/pT, a word such as 'S' or 'S/2T'"):
        parse_word("1:1/xT", ["S"])
    with pytest.raises(InputError, match="counts 2 walls of 1"):
        parse_word("1:1", ["S"])


def test_errors_say_what_would_do():
    with pytest.raises(InputError, match=r"has the wall 'X'; the walls are B, T"):
        parse_word("BXT", "BT")
    with pytest.raises(InputError, match=r"give n:m, n:m/pT, a word such as 'BT' or 'BT/2T'"):
        parse_word("?", "BT")


def test_longest():
    assert len(parse_word(f"{LONGEST_WORD}:0", "BT")) == LONGEST_WORD
    assert len(parse_word(f"1:1/{LONGEST_WORD // 2}T", "BT")) == LONGEST_WORD
    assert len(parse_word("B" * LONGEST_WORD, "BT")) == LONGEST_WORD
    for text in (
        f"{LONGEST_WORD}:1",
        f"1:1/{LONGEST_WORD // 2 + 1}T",
        "B" * (LONGEST_WORD + 1),
        "9" * 30 + ":1",
        "1:1/" + "9" * 30 + "T",
    ):
        with pytest.raises(InputError, match=f"at most {LONGEST_WORD} impacts"):
            parse_word(text, "BT")


@pytest.mark.parametrize(
    ("walls", "period", "notation"),
    [
        ("BT", 1, "1:1"),
        ("BBT", 1, "2:1"),
        ("BTBT", 1, "2:2"),
        ("BTBT", 2, "1:1/2T"),
        ("BBTBBTT", 2, "(4:3)/2T"),
        ("B", 1, "1:0"),
        ("B", 3, "(1:0)/3T"),
        ("TTT", 3, "0:1/3T"),
    ],
)
def test_notation(walls, period, notation):
    assert Word(walls, period).notation("BT") == notation


@pytest.mark.parametrize(
    ("text", "notation"),
    [("1:1:0:1", "CRK"), ("CRS", "CRS"), ("CRSS/2T", "CRSS/2T"), ("0/2T", "0/2T")],
)
def test_orbits_of_more_than_two_walls_are_called_by_their_words(text, notation):
    """Counts of three walls and more are read, but not written."""
    word = parse_word(text, "CRSK")
    assert word.notation("CRSK") == notation
    assert parse_word(word.notation("CRSK"), "CRSK") == word


def test_insert_and_drop():
    word = Word("BT", 2)
    assert word.insert(0, "B") == Word("BBT", 2)
    assert word.insert(1, "T") == Word("BTT", 2)
    assert Word("BBT").drop(0) == Word("BT")
    assert Word("BBT").drop(2) == Word("BB")


def test_rotations():
    assert Word("BT").rotations() == [0]
    assert Word("BTBT").rotations() == [0, 2]
    assert Word("BBB").rotations() == [0, 1, 2]
    assert Word("BTB").rotations() == [0]


def test_words_are_values():
    assert Word("BT") == Word("BT", 1)
    assert len({Word("BT"), Word("BT", 1), Word("BT", 2)}) == 2
    with pytest.raises(AttributeError):
        Word("BT").walls = "TB"


SETTINGS = settings(deadline=None, derandomize=True, max_examples=100, database=None)
WORDS = st.builds(Word, st.text("BT", min_size=1, max_size=12), st.integers(1, 9))


@SETTINGS
@given(WORDS)
def test_any_word_reads_back(word):
    assert parse_word(str(word), "BT") == word


@SETTINGS
@given(st.integers(0, 9), st.integers(0, 9), st.integers(1, 5))
def test_any_count_reads_back(n, m, p):
    text = f"{n}:{m}" if p == 1 else f"{n}:{m}/{p}T"
    if n + m == 0:
        with pytest.raises(InputError):
            parse_word(text, "BT")
        return
    word = parse_word(text, "BT")
    assert word.notation("BT") == text
    assert word == Word(("B" * n + "T" * m) * p, p)


@SETTINGS
@given(WORDS, st.data())
def test_a_dropped_insertion_changes_nothing(word, data):
    flight = data.draw(st.integers(0, len(word) - 1))
    wall = data.draw(st.sampled_from("BT"))
    longer = word.insert(flight, wall)
    assert longer.walls[flight + 1] == wall
    assert longer.drop(flight + 1) == word


@SETTINGS
@given(WORDS)
def test_rotations_map_the_word_to_itself(word):
    shifts = word.rotations()
    assert shifts[0] == 0
    assert len(word) % len(shifts) == 0
    for shift in range(len(word)):
        rotated = word.walls[shift:] + word.walls[:shift]
        assert (rotated == word.walls) == (shift in shifts)


@pytest.mark.full
@SETTINGS
@given(st.text(max_size=12))
def test_any_text_is_a_word_or_refused(text):
    try:
        word = parse_word(text, "BT")
    except InputError:
        return
    assert set(word.walls) <= {"B", "T"}
    assert 1 <= len(word) <= LONGEST_WORD


@pytest.mark.parametrize("text", ["1:1/२T", "१:1", "BT/२T", "9" * 5000 + ":1", "B" * 5000])
def test_digits_are_ascii_and_words_short(text):
    with pytest.raises(InputError):
        parse_word(text, "BT")


def test_one_is_not_plural():
    with pytest.raises(InputError, match="0 impacts in 1 period;"):
        parse_word("0:0", "BT")


SOFT = {"C": "R", "R": "C"}
"""Letters that can follow each letter at a soft stop."""


@pytest.mark.parametrize(
    ("text", "walls", "period"),
    [
        ("CR", "CR", 1),
        ("RC/2T", "RC", 2),
        ("1:1", "CR", 1),
        ("2:2", "CRCR", 1),
        ("1:1/2T", "CRCR", 2),
        ("2:2/3T", "CRCRCRCRCRCR", 3),
    ],
)
def test_words_are_paths_through_the_graph(text, walls, period):
    assert parse_word(text, "CR", graph=SOFT) == Word(walls, period)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("CC", "CC has C after C; after C can come R"),
        ("CRR/2T", "CRR/2T has R after R; after R can come C"),
        ("C", "C has C after C"),  # run around
        ("2:1", "2:1, the word CCR, has C after C"),
    ],
)
def test_words_that_are_no_paths_are_refused_with_what_could_follow(text, says):
    with pytest.raises(InputError, match=says):
        parse_word(text, "CR", graph=SOFT)


@pytest.mark.parametrize("text", ["0", "0/2T"])
@pytest.mark.parametrize("letters", ["S", "BT"])
def test_the_word_without_impacts(text, letters):
    word = parse_word(text, letters)
    assert (len(word), word.period, str(word)) == (0, 1 if text == "0" else 2, text)
    assert word.notation(letters) == text
    assert word.rotations() == [0]
    assert word.repeated() == ([] if text == "0" else [Word("")])
    assert word.insert(0, "CR").walls == "CR"


def test_letters_are_inserted_and_dropped_together():
    assert Word("CRCR").drop(1, 2) == Word("CR")
    assert Word("CRCR").drop(3, 0) == Word("RC")
    assert Word("CR").insert(1, "CR") == Word("CRCR")


def test_words_that_a_word_repeats():
    assert Word("BTBT", 2).repeated() == [Word("BT")]
    assert Word("BTBTBTBT", 4).repeated() == [Word("BT"), Word("BTBT", 2)]
    assert Word("BT" * 3, 3).repeated() == [Word("BT")]
    assert Word("BTBT").repeated() == []  # half of it is no whole period
    assert Word("BBT", 3).repeated() == []
