"""A result's words as a piece of HTML, for notebooks."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.words import Verdict, sentence


def words_html(figures: str, verdict: Verdict, findings: Iterable[Finding]) -> str:
    """figures: lines of text. Whatever comes from outside, names above all, is escaped."""
    items = "".join(f"<li>{'<b>!</b> ' * finding.concern}{escape(sentence(finding.line))}</li>" for finding in findings)
    told = " ".join(map(escape, verdict.sentences))
    return f"<pre>{escape(figures)}</pre><p><b>{escape(verdict.headline)}</b> {told}</p><ul>{items}</ul>"
