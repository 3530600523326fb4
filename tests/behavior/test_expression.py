"""The expressions of preconditions: what they are worth, and what is said of those that are none."""

from __future__ import annotations

import pytest

from mazeplan.behavior.expression import MAX_DEPTH, MAX_LENGTH, ExpressionError, parse_expression

BOARD = {
    "n": 3, "x": 2.5, "yes": True, "no": False, "word": "red", "three": "3", "less": "-0.5", "said": "false",
    "a.b": 1, "plan": object(), "none": None, "huge": 10**400, "under": "1_0", "nan": float("nan"), "list": [1],
}  # fmt: skip


def holds(text):
    return parse_expression(text).holds(BOARD.__getitem__)


@pytest.mark.parametrize(
    "text",
    [
        "true", "!false", "!!true", "1", "!0", "1 == 1.0", "1 != 2", "1 < 2", "2 <= 2", "3 > 2", "3 >= 3", "true == 1",
        "n == 3", "x > 2 && x < 3", "no || yes", "1 || 0 && 0", "!(1 && 0)", "!no && yes", "1 + 2 * 3 == 7",
        "(1 + 2) * 3 == 9", "7 - 2 - 1 == 4", "8 / 4 / 2 == 1", "-n == 0 - 3", "- -n == +3", "2 * -3 == -6",
        "word == 'red'", 'word != "blue"', "word + 'dish' == 'reddish'", "'a' < 'b'", "three == 3", "3 >= three",
        "three * 2 == 6", "less < 0", "!said", "said == false", "a.b == 1", "1e3 == 1000.", ".5 + .5 == 1",
        "'&& (' != 'x'", "yes || missing", "!(no && missing)", "n==3&&x==2.5", "\tn\n== 3 ", "!(1 < 2 == false)",
        "nan != nan",
    ],
)  # fmt: skip
def test_what_holds(text):
    if text == "!(1 < 2 == false)":
        with pytest.raises(ExpressionError, match="column 9: got '==', expected && or"):
            holds(text)
        return
    assert holds(text) is True
    assert holds(f"!({text})") is False


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "column 1: got the end, expected a number, 'text', true, false, a name, ( or !"),
        ("n >", "column 4: got the end, expected a number"),
        ("n > * 2", "column 5: got '*', expected a number"),
        ("(n > 2", "column 7: got the end, expected an operator or )"),
        ("n > 2)", "column 6: got ')', expected an operator or the end"),
        ("n 2", "column 3: got '2', expected an operator or the end"),
        ("n = 2", "column 3: got '= 2', expected numbers, 'text', true, false, names"),
        ("n := 2", "column 3: got ':= 2', expected"),
        ("n == 'red", 'column 6: got "\'red", expected'),
        ("n & 2", "column 3: got '& 2', expected"),
        ("1 < n < 4", "column 7: got '<', expected && or || between two comparisons"),
        ("f(2)", "column 2: got '(', expected an operator"),
        ("n[0]", "column 2: got '[0]', expected"),
        ("__import__('os')", "column 11: got '(', expected"),
        ("2x", "column 1: got '2x', expected"),
        ("1_0", "column 1: got '1_0', expected"),
        ("1.2.3", "column 1: got '1.2.3'"),
        ("1e999", "column 1: got 1e999, expected a number below"),
        ("é", "column 1: got 'é'"),
        ("(" * (MAX_DEPTH + 1) + "1" + ")" * (MAX_DEPTH + 1), f"expected at most {MAX_DEPTH} parentheses and signs"),
        ("!" * 400 + "1", "parentheses and signs"),
        ("1 + " * MAX_LENGTH + "1", f"expected at most {MAX_LENGTH}"),
    ],
)
def test_what_cannot_be_read_is_named_with_its_column(text, said):
    with pytest.raises(ExpressionError) as error:
        parse_expression(text)
    assert said in str(error.value)
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("missing", "missing"),
        ("word", "got the text 'red', expected something true or false"),
        ("word < 3", "got 'red' beside <, expected a number"),
        ("word == 3", "got 'red' beside ==, expected a number"),
        ("-word > 0", "got 'red' beside -"),
        ("word - 'e' == 'rd'", "got 'red' beside -"),
        ("word + 1 == 2", "got 'red' beside +"),
        ("plan == 1", "plan is a object, expected a number, text or true or false"),
        ("none", "none is a NoneType"),
        ("list", "list is a list"),
        ("huge > 1", "huge is a int"),
        ("under == 10", "got '1_0' beside =="),
        ("'nan' * 1 > 0", "got 'nan' beside *"),
        ("'--1' * 1 > 0", "got '--1' beside *"),
        ("n / (x - 2.5)", "got 3 / 0, expected a divisor other than 0"),
    ],
)
def test_what_has_no_value_is_named(text, said):
    with pytest.raises(ExpressionError) as error:
        holds(text)
    assert said in str(error.value)


def test_numbers_too_large_are_infinite_and_end_no_tick():
    assert holds("1e308 * 10 > 1e308")
