"""Rebuild the example inputs of `graspforce solve` from their formulas.

    python examples/make_examples.py            writes them beside this script
    python examples/make_examples.py DIRECTORY  writes them there

Numbers are rounded to 12 decimals, so that the files come out the same on every machine.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

import graspforce as gf


def paper_grasp() -> dict[str, Any]:
    """The cube of Section IV-A at rest, held by the four-fingered hand of the paper."""
    scenario = gf.scenarios.get("static")
    grasp = scenario.grasp(0.0)
    assert grasp.J is not None
    return {
        "comment": "Section IV-A of the WBF paper: a cube of 250 g and 0.075 m, centre at "
        "(0.025, -0.05, 0.1) m, turned by 0.1 rad, mu 0.5, twelve joints of 0.5 N m. "
        "alpha from 0.01 (firm) to 100 (light) is what the paper varies.",
        "name": "paper, static",
        "contacts": [
            {
                "point": contact.point.tolist(),
                "normal": contact.normal.tolist(),
                "tangent": contact.tangent.tolist(),
                "model": "PCWF",
                "mu": 0.5,
            }
            for contact in grasp.contacts
        ],
        "origin": scenario.state(0.0).position.tolist(),
        "f": scenario.wrench(0.0).tolist(),
        "J": grasp.J.tolist(),
        "tau_lo": -0.5,
        "tau_hi": 0.5,
        "alpha": 5,
    }


def nose_cone(mu: float = 0.3) -> dict[str, Any]:
    """A nose cone z = x² + y² lifted by five contacts (Lobo, Vandenberghe, Boyd, Lebret 1998).

    The fingers touch the surface from outside at p_j = (0.3 + cos(2πj/5), sin(2πj/5)).
    """
    contacts: list[dict[str, Any]] = []
    for j in range(1, 6):
        x, y = 0.3 + math.cos(2 * math.pi * j / 5), math.sin(2 * math.pi * j / 5)
        # The gradient of z − x² − y² points up and inwards, into the solid above the surface.
        inward = np.array([-2 * x, -2 * y, 1.0]) / math.sqrt(4 * x * x + 4 * y * y + 1)
        contacts.append(
            {"point": [x, y, x * x + y * y], "normal": inward.tolist(), "model": "PCWF", "mu": mu}
        )
    return {
        "comment": "Lifting a nose cone z = x^2 + y^2 of unit weight. Without joints nothing but "
        "c_max bounds the grip: some contact needs at least 0.4911, and 2 leaves room.",
        "name": f"nose cone, mu {mu:g}",
        "contacts": contacts,
        "f": [0, 0, 1, 0, 0, 0],
        "c_max": 2,
    }


def can(weight: float) -> dict[str, Any]:
    """A can of radius 0.04 m between three fingers, at most 20 N each."""
    directions = [(math.cos(a), math.sin(a)) for a in (0, 2 * math.pi / 3, 4 * math.pi / 3)]
    return {
        "name": f"can, {weight:g} N",
        "contacts": [
            {"point": [0.04 * x, 0.04 * y, 0], "normal": [-x, -y, 0], "model": "PCWF", "mu": 0.5}
            for x, y in directions
        ],
        "f": [0, 0, weight, 0, 0, 0],
        "c_max": 20,
    }


def card() -> dict[str, Any]:
    """A card between two soft fingers, which alone can hold it against turning."""
    soft = {"model": "SFC", "mu": 0.8, "gamma": 0.005}
    return {
        "name": "card, two soft fingers",
        "contacts": [
            {"point": [0.001, 0, 0], "normal": [-1, 0, 0], **soft},
            {"point": [-0.001, 0, 0], "normal": [1, 0, 0], **soft},
        ],
        "f": [0, 0, 0.5, 0.01, 0, 0],
        "c_max": 15,
    }


def fixture() -> dict[str, Any]:
    """A plate between five frictionless pins in the plane; rows of W: force x, y, torque."""
    pins = [
        ((-0.1, 0.02), (1, 0)),
        ((-0.1, -0.05), (1, 0)),
        ((0.1, -0.02), (-1, 0)),
        ((-0.02, -0.1), (0, 1)),
        ((0.02, 0.1), (0, -1)),
    ]
    columns = [[nx, ny, x * ny - y * nx] for (x, y), (nx, ny) in pins]
    return {
        "name": "plate, five pins",
        "W": np.transpose(columns).tolist(),
        "models": [{"model": "FPC"}],
        "f": [0, 20, 0.1],
        "c_max": 100,
    }


def several_grasps() -> dict[str, Any]:
    """Several grasps in one file; two of them are asked for too much."""
    slippery = nose_cone(mu=0.2)
    del slippery["comment"]
    return {
        "comment": "The heavy can needs more than 3 x 0.5 x 20 N of friction, and the nose cone "
        "more than mu 0.2156 (at 0.2, no grip is firm enough): both are infeasible.",
        "grasps": [can(2.5), can(35), card(), fixture(), slippery],
    }


EXAMPLES = {
    "paper_grasp.json": paper_grasp,
    "nose_cone.json": nose_cone,
    "several_grasps.json": several_grasps,
}


def rounded(value: Any) -> Any:
    """Round every number to 12 decimals; −0.0 and whole numbers become integers."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    if isinstance(value, float):
        number = round(value, 12)
        return int(number) if number.is_integer() else number
    return value


def as_text(value: Any, indent: str = "") -> str:
    """Return JSON with everything on one line that fits on one."""
    flat = json.dumps(value)
    if len(indent) + len(flat) <= 100 or not isinstance(value, dict | list):
        return flat
    inner = indent + "  "
    if isinstance(value, dict):
        lines = [f"{json.dumps(key)}: {as_text(item, inner)}" for key, item in value.items()]
    else:
        lines = [as_text(item, inner) for item in value]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return f"{opening}\n" + ",\n".join(inner + line for line in lines) + f"\n{indent}{closing}"


if __name__ == "__main__":
    directory = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for name, make in EXAMPLES.items():
        (directory / name).write_text(as_text(rounded(make())) + "\n", encoding="utf-8")
