"""The page ``report.html``: a template, and what it takes to set formulas in plain HTML."""

from __future__ import annotations

import importlib.resources
import re
from typing import Any

from graspforce.errors import MissingExtraError

# Where the package has each equation of the paper: number, what it says, where.
EQUATIONS: tuple[tuple[str, str, str], ...] = (
    ("1", "the grasp map, W c = f", "grasp_map"),
    ("2, 15", "joint torque limits", "reference.torque_limits"),
    ("3, 8, 10", "friction cones", "reference.R_mu"),
    ("5, 6", "polyhedral barrier", "reference.phi_lin"),
    ("7", "its gradient and Hessian", "reference.hess_phi_lin"),
    ("9", "second-order cone barrier", "reference.phi_soc"),
    ("11, 12", "its gradient", "reference.grad_phi_soc"),
    ("13, 14", "its Hessian", "reference.hess_phi_soc"),
    ("16", "the weighted objective", "reference.objective"),
    ("17, 18", "reduction to the null space", "reference.particular_and_nullspace"),
    ("19", "reduced derivatives", "reference.reduced_derivatives"),
    ("20", "ceilings for regrasping", "reference.ceilings"),
    ("21", "the Newton step", "reference.newton_step"),
    ("22", "friction residual", "reference.friction_residual"),
)


def template() -> Any:
    """Return the page's template, a ``jinja2.Template``.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError as error:
        raise MissingExtraError("the report", "jinja2", "figures") from error
    source = importlib.resources.files("graspforce.study.report") / "report.html.j2"
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["typeset"] = typeset
    return environment.from_string(source.read_text(encoding="utf-8"))


def typeset(text: str) -> Any:
    """Return HTML in which symbols have their indices and numbers stay with their units."""
    from markupsafe import Markup, escape

    html = str(escape(text))
    html = re.sub(r"\b([rw])_(\w)\b", r"<i>\1</i><sub>\2</sub>", html)
    html = re.sub(r"\b1e-0?(\d+)\b", r"10<sup>−\1</sup>", html)
    html = re.sub(r"(\d) (?=(N·m|N²|N|µs|s)\b)", r"\1&nbsp;", html)
    return Markup(html.replace(" = ", "&nbsp;=&nbsp;"))
