"""Describe the findings on limits as rows of text, for the terminal."""

from collections.abc import Iterable, Mapping

import numpy as np

from qtraj.design.proof.certificate import Certificate, Finding
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.foundation.number_text import intervals, number


def limit_rows(findings: Iterable[Finding], more: Mapping[str, str], digits_of_time: int = 4) -> list[tuple[str, ...]]:
    """Return name with unit, worst value, limit, time [s], an additional text and status of each limit.

    `more` contains the additional texts by the names of the limits; a dash replaces a missing text.
    """
    return [
        (x.label, number(x.value), number(x.limit), number(x.time, digits_of_time), more.get(x.name, "-"), x.status)
        for x in findings
    ]


def limit_change_rows(before: Certificate, after: Certificate) -> list[list[tuple[str, ...]]]:
    """Return two rows for each limit, one for the path before a tuning and one for the path after it.

    The first column contains the name in the first row and the unit in the second row. The other columns contain
    "before" or "after", the value, the limit, the margin, the time [s] and the status. The margin of an active limit is
    "active".
    """
    groups = []
    for was, now in zip(before.findings(), after.findings(), strict=True):
        name, unit = now.label.rsplit(" ", 1)
        groups.append([(name, "before", *_margin_texts(was)), (unit, "after", *_margin_texts(now))])
    return groups


def route_limit_rows(certificate: RouteCertificate) -> list[tuple[str, ...]]:
    """Return the `limit_rows` of a route; the additional text is the number of segments that violate the limit."""
    status = certificate.segments.status
    violated = {name: str(int(np.sum(np.asarray(status[name]) == "broken"))) for name in certificate.names}
    return limit_rows(certificate.findings(), violated, digits_of_time=6)


def violation_texts(certificate: RouteCertificate) -> list[str]:
    """Return a sentence with the time intervals for each limit that is violated on a route."""
    spans = {name: certificate.intervals(name) for name in certificate.names}
    return [f"the limit on {name} is violated at t [s] = {intervals(x)}" for name, x in spans.items() if x]


def _margin_texts(x: Finding) -> tuple[str, ...]:
    margin = "active" if x.active else number(x.margin, 3, sign="+")
    return number(x.value), number(x.limit), margin, number(x.time, 4), x.status
