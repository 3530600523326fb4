"""Scripts: what they are worth, what they assign, and what is said of those that are none."""

from __future__ import annotations

import time

import pytest

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.script import MAX_DEPTH, MAX_LENGTH, parse_script
from mazeplan.btree.script_values import ScriptError

VALUES = {
    "n": 3, "x": 2.5, "yes": True, "no": False, "word": "red", "three": "3", "less": "-0.5", "said": "false",
    "plan": object(), "none": None, "huge": 10**400, "under": "1_0", "nan": float("nan"), "list": [1], "zero": 0,
}  # fmt: skip
ENUMS = {"RED": 1, "GREEN": 2}


def scope():
    return Blackboard(values=VALUES, enums=ENUMS)


def value(text):
    return parse_script(text).evaluate(scope())


@pytest.mark.parametrize(
    "text",
    [
        "true", "!false", "!!true", "1", "!0", "1 == 1.0", "1 != 2", "1 < 2", "2 <= 2", "3 > 2", "3 >= 3", "true == 1",
        "n == 3", "x > 2 && x < 3", "no || yes", "1 || 0 && 0", "!(1 && 0)", "!no && yes", "1 + 2 * 3 == 7",
        "(1 + 2) * 3 == 9", "7 - 2 - 1 == 4", "8 / 4 / 2 == 1", "-n == 0 - 3", "- -n == 3", "2 * -3 == -6",
        "word == 'red'", 'word != "blue"', "word + 'dish' == 'reddish'", "'a' < 'b'", "three == 3", "3 >= three",
        "less < 0", "!(said == true)", "said == false", "1e3 == 1000", "0.5 + 0.5 == 1", "'&& (' != 'x'",
        "n==3&&x==2.5", "\tn\n== 3 ", "nan != nan", "1 < n < 4", "!(1 < n < 2)", "1 < 2 == true || 1",
        "0x1F == 31", "0xff & 0x0f == 15 || 1", "(6 & 3) == 2", "(6 | 3) == 7", "(6 ^ 3) == 5", "~0 == -1",
        "1 | 2 ^ 3 == 0 || 1", "10 / 4 == 2.5", "n / 2 == 1.5", "RED == 1", "RED < GREEN", "'GREEN' == 2",
        "0.1 + 0.2 == 0.3", "n > 2 ? true : false", "n > 9 ? 0 : n > 2 ? 1 : 0", "three ? 1 : 0", "('0' ? 1 : 0) == 0",
        "'a' .. 1 == 'a1'", "'a' .. 1.5 == 'a1.500000'", "2 .. 'b' == '2b'", "1; 0; 1", "a := 1 a == 1", "a := n; a",
    ],
)  # fmt: skip
def test_what_holds(text):
    assert parse_script(text).holds(scope()) is True


@pytest.mark.parametrize(("text", "value"), [("true", False), ("1", False), ("false", True), ("0", True)])
def test_not_reads_texts_of_truth(text, value):
    assert parse_script(f"!'{text}'").holds(scope()) is value


@pytest.mark.parametrize("text", ["said && 1", "1 && said", "said || 1", "'false' || 1", "!'yes'"])
def test_a_text_beside_a_sign_of_logic_is_an_error_though_it_is_a_condition_alone(text):
    assert parse_script("'true'").holds(scope()) is True
    with pytest.raises(ScriptError):
        parse_script(text).holds(scope())


@pytest.mark.parametrize(
    ("text", "name", "worth"),
    [
        ("a := 1", "a", 1),
        ("a := 1.5", "a", 1.5),
        ("a := 'x'", "a", "x"),
        ("a := b := 4", "b", 4.0),
        ("n = 7", "n", 7),
        ("n += 2", "n", 5),
        ("n -= 2", "n", 1),
        ("n *= 2", "n", 6),
        ("x /= 2", "x", 1.25),
        ("word += 'dish'", "word", "reddish"),
        ("n = '4'", "n", 4),
        ("x = 'true'", "x", 1.0),
        ("a := n > 2 ? 'far' : 'near'", "a", "far"),
        ("a := 1; a += 1; a *= 5", "a", 10),
        ("x = n", "x", 3.0),
        ("@top := 5", "top", 5),
    ],
)
def test_what_is_assigned(text, name, worth):
    place = scope()
    parse_script(text).run(place)
    assert place.get(name) == worth
    assert place.find(name).changes >= 1


def test_a_script_knows_what_it_reads_and_writes():
    script = parse_script("a := n + b; c += a")
    assert script.writes == {"a"}
    assert script.reads >= {"n", "b", "c"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "column 1: got the end, expected a script"),
        ("n >", "column 4: got the end, expected a number"),
        ("n > * 2", "column 5: got '*', expected a number"),
        ("n <> 2", "column 4: got '>', expected a number"),
        ("(n > 2", "column 7: got the end, expected an operator or )"),
        ("n > 2)", "column 6: got ')', expected a number"),
        ("n == 'red", "column 6: the text that begins here has no end, expected ' after it"),
        ('a := "', 'column 6: the text that begins here has no end, expected " after it'),
        ("f(2", "column 4: got the end, expected an operator or )"),
        ("n[0]", "column 2: got '[0]', expected"),
        ("2x", "column 1: got '2x', expected"),
        ("1_0", "column 1: got '1_0', expected"),
        ("1.2.3", "column 1: got '1.2.3'"),
        ("1.", "column 1: got '1.'"),
        ("0x", "column 1: got '0x'"),
        ("1e999", "column 1: got 1e999, expected a number of 64 bits"),
        ("9" * 30, "expected a number of 64 bits"),
        ("n + 1 = 2", "column 7: got '=', expected a name on the blackboard to the left of it"),
        ("3 := n", "column 3: got ':=', expected a name"),
        ("n ? 1", "column 6: got the end, expected an operator or :"),
        ("+n", "column 1: got '+'"),
        ("1 " * MAX_LENGTH, f"got {2 * MAX_LENGTH} characters, expected at most {MAX_LENGTH}"),
        ("(" * 3000, f"expected at most {MAX_DEPTH} expressions in each other"),
        ("-" * 3000 + "1", f"expected at most {MAX_DEPTH} expressions in each other"),
    ],
)
def test_what_cannot_be_read_is_named_with_its_column(text, said):
    with pytest.raises(ScriptError) as error:
        parse_script(text)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("missing", "the blackboard has no 'missing'"),
        ("1 || missing", "the blackboard has no 'missing'"),
        ("missing = 1", "the blackboard has no 'missing'; := makes it, = does not"),
        ("word == 3", "got 'red' beside ==, expected a number"),
        ("word - 1", "got 'red' beside -, expected a number"),
        ("three * 2", "got '3' beside *, expected a number"),
        ("1 .. 2", "beside .., expected text on one side at least"),
        ("-word", "got the text 'red' after -, expected a number"),
        ("1 / zero", "got 1 / 0, expected a divisor other than 0"),
        ("x & 1", "got 2.5 beside &, expected a whole number"),
        ("(1e308 * 10) & 1", "got inf beside &, expected a whole number"),
        ("1 | (1e308 * 10 - 1e308 * 10)", "got nan beside |, expected a whole number"),
        ("~(1e308 * 10)", "got inf after ~, expected a finite number"),
        ("word ? 1 : 0", "got the text 'red' before ?, expected a number"),
        ("huge", "huge is '1000000000"),
        ("n = 1e300", "for n, which is a whole number"),
        ("plan", "plan is a object, expected a number or text"),
        ("none == 1", "none is a NoneType"),
        ("list", "list is a list"),
        ("n = 2.5", "got '2.500000' for n, which is a whole number"),
        ("n = 'far'", "got 'far' for n, which is a whole number"),
        ("word = 3", "got '3' for word, which is text"),
        ("word -= 'd'", "got 'd' after -=, expected a number"),
        ("n += 0.5", "for n, which is a whole number"),
        ("word && 1", "got 'red' beside &&, expected a number"),
    ],
)
def test_what_cannot_be_evaluated_is_named(text, said):
    with pytest.raises(ScriptError) as error:
        value(text)
    assert said in str(error.value)


def test_text_alone_is_true_or_false_as_it_reads():
    assert parse_script("said").holds(scope()) is False
    with pytest.raises(ScriptError, match="got the text 'red', expected something true or false"):
        parse_script("word").holds(scope())


@pytest.mark.parametrize("text", ["1+" * 50_000 + "1", "(" * 10_000 + "1" + ")" * 10_000, "!" * 9_999 + "1"])
def test_endless_scripts_are_refused_at_once(text):
    began = time.process_time()
    with pytest.raises(ScriptError):
        parse_script(text)
    assert time.process_time() - began < 1.0
