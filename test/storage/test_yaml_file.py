"""YAML of somebody else: what it may say, what it may cost, and what is said of it."""

from __future__ import annotations

import re
import time

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.yaml_file import parse_yaml, read_yaml

MEBIBYTE = 1 << 20


def nested(levels: int, across: int = 10) -> str:
    """Lists of aliases that stand for across ** levels values."""
    lines = ["a0: &a0 [" + ",".join("x" * across) + "]"]
    lines += [f"a{n}: &a{n} [" + ",".join([f"*a{n - 1}"] * across) + "]" for n in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    "text",
    ["1", "-5", "0x1F", "017", "1_000", "1.5", ".5", "-.inf", ".nan", "yes", "Off", "~", "", "null", "00", "0b11"]
    + ["text", "'1'", '"yes"', "[1, {a: b}]", "{a: [], b: {}}", "|\n  block\n", "&x [1]", "- 1\n- 2", "09", "+3", "1."]
    + ["18446744073709551615"],
)
def test_plain_scalars_read_as_any_reader_reads_them(text) -> None:
    whole = text if text.startswith("-") and "\n" in text else f"k: {text}"
    assert repr(parse_yaml(whole, "file")) == repr(yaml.safe_load(whole))


@pytest.mark.parametrize("text", ["1e-3", "+5E2", "0E0"])
def test_a_number_without_a_point_is_one_as_in_yaml_1_2(text) -> None:
    """PyYAML, of YAML 1.1, reads it as text and so writes such text without quotes."""
    assert parse_yaml(f"k: {text}", "file") == {"k": float(text)}
    assert parse_yaml(f"k: '{text}'", "file") == {"k": text}


def words(longest: int) -> st.SearchStrategy[str]:
    return st.text(max_size=longest).filter(lambda text: not re.fullmatch(r"[-+]?[0-9]+[eE][-+]?[0-9]+", text))


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-(10**17), 10**17) | st.floats() | words(20),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(words(8), inner, max_size=4),
        max_leaves=20,
    )
)
@settings(max_examples=150, deadline=None)
def test_what_is_written_is_read_as_any_reader_reads_it(value) -> None:
    text = yaml.safe_dump(value, allow_unicode=True, sort_keys=False)
    assert repr(parse_yaml(text, "file")) == repr(yaml.safe_load(text))


def test_a_date_is_text_and_what_only_looks_like_one_is_refused() -> None:
    assert parse_yaml("d: 2026-11-28", "file") == {"d": "2026-11-28"}
    assert parse_yaml("d: 2026-11-28T10:00:00Z", "file") == {"d": "2026-11-28T10:00:00Z"}
    for slip in ("2024-13-45", "2024-02-30", "2024-01-01 25:00:00"):
        with pytest.raises(InputError, match="line 1.*no date"):
            parse_yaml(f"d: {slip}", "file")
        assert parse_yaml(f"d: '{slip}'", "file") == {"d": slip}


def test_a_key_is_read_before_its_value() -> None:
    assert parse_yaml("&name x: *name", "a") == {"x": "x"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("n: " + "9" * 5000, "5000 digits"),
        ("n: !!int abc", "tag 'int'"),
        ("n: !!binary aaaa", "tag"),
        ("!!python/object/apply:os.system ['true']", "tag"),
        ("n: &a [*a]", "line 1"),
        ("n: *b", r"\*b"),
        ("? [1, 2]\n: 3", "a key must be"),
        ("? {a: 1}\n: 3", "a key must be"),
        ("a: 1\n{}: 3", "a key must be"),
        ("a: 1\n[]: 3", "a key must be"),
        ("'" + "k" * 500 + "': 1", "a key must be"),
        ("a: 1\n---\nb: 2", "second document"),
        ("[" * 100 + "]" * 100, "within lists"),
        ("- " * 100 + "1", "within lists"),
        (nested(9), "150000 values"),
        ("a: &a " + "x" * 100_000 + "\nb: [" + "*a," * 200 + "]", "150000 values"),
        ("%TAG !a! x\n" * 1000 + "--- 1", "begin with %"),
        ("a: \x00", "valid YAML"),
        ("a: [", "line 1|line 2"),
    ],
)
def test_each_kind_of_mischief_has_one_short_line(text, words) -> None:
    with pytest.raises(InputError, match=words) as refused:
        parse_yaml(text, "file")
    assert str(refused.value).startswith("file ") and str(refused.value).isprintable() and len(str(refused.value)) < 300


@pytest.mark.parametrize(
    "text",
    ["a: [" + "1," * (MEBIBYTE // 2 - 10) + "1]", "".join(f"key{n}: 1\n" for n in range(80_000)), "[" * MEBIBYTE]
    + ["".join(f"- &a{n} x\n" for n in range(80_000)), "a: " + "x" * (MEBIBYTE - 10), "%TAG !a! x\n" * 90_000]
    + ["{" * 500_000, "- " * 500_000, "#" * MEBIBYTE, "\n" * MEBIBYTE, '"' + "\\x41" * 250_000 + '"', "? " * 500_000],
    ids=range(12),
)
@pytest.mark.skipif(not yaml.__with_libyaml__, reason="the parser in C is not there")
def test_a_mebibyte_costs_a_second_at_most(text) -> None:
    began = time.process_time()
    try:
        parse_yaml(text[:MEBIBYTE], "file")
    except InputError as error:
        assert len(str(error)) < 300
    assert time.process_time() - began < 1.0


def test_files_are_bounded_and_tags_can_be_passed_over(tmp_path) -> None:
    (tmp_path / "large.yaml").write_text("# " + "x" * MEBIBYTE)
    with pytest.raises(InputError, match="too large for a target file"):
        read_yaml(tmp_path / "large.yaml", "target")
    (tmp_path / "cv.yaml").write_text("K: !!opencv-matrix\n  rows: 3\n")
    with pytest.raises(InputError, match="opencv-matrix"):
        read_yaml(tmp_path / "cv.yaml", "camera")
    assert read_yaml(tmp_path / "cv.yaml", "camera", tags=("opencv-matrix",)) == {"K": {"rows": 3}}
