"""Grasps in, results out: what is written comes back, and what is wrong is refused by name."""

from __future__ import annotations

import csv
import json
import math
import random
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from conftest import ALLEGRO
from grasps import nose_cone
from jsonschema import Draft202012Validator
from pages import blocks
from test_columns import make_problems

import graspforce as gf
from graspforce import files
from graspforce.columns import Columns, ProblemColumns
from graspforce.files import json_grasps, npz_grasps

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"

CAN = {
    "name": "can",
    "contacts": [
        {"point": [0.04, 0, 0], "normal": [-1, 0, 0], "model": "PCWF", "mu": 0.5},
        {"point": [-0.04, 0, 0], "normal": [1, 0, 0], "model": "SFC", "mu": 0.5, "gamma": 0.01},
        {"point": [0, -0.04, 0], "normal": [0, 1, 0], "model": "FPC"},
        {"point": [0, 0.04, 0], "normal": [0, -1, 0], "model": "FPC"},
    ],
    "f": [0, 0, 2.5, 0, 0, 0],
    "c_max": 20,
}


def save(path, document):
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def changed(**changes):
    return {key: value for key, value in (CAN | changes).items() if value is not None}


def with_contact(**changes):
    first = {k: v for k, v in (CAN["contacts"][0] | changes).items() if v is not None}
    return changed(contacts=[first, *CAN["contacts"][1:]])


# ---- reading JSON ------------------------------------------------------------------------------


def test_json_grasp_is_the_problem_that_python_makes(tmp_path):
    rng = np.random.default_rng(0)
    J = rng.normal(size=(9, 2))
    A = rng.normal(size=(1, 9))
    document = changed(
        origin=[0.01, 0.02, 0.03],
        J=J.tolist(),
        tau_lo=-1,
        tau_hi=[1, 2],
        tau_bias=[0.1, 0.2],
        c_max=[10, 11, 12, 13],
        c_min=0.1,
        engagement=[1, 1, 0.5, 1],
        A=A.tolist(),
        b=[3],
        alpha=2,
        comment="for people",
    )
    document["contacts"][0] = document["contacts"][0] | {"tangent": [0, 2, 2]}
    ((name, problem),) = files.read(save(tmp_path / "g.json", document))

    contacts = [
        gf.Contact((0.04, 0, 0), (-1, 0, 0), gf.PCWF(0.5), tangent=(0, 2, 2)),
        gf.Contact((-0.04, 0, 0), (1, 0, 0), gf.SFC(0.5, 0.01)),
        gf.Contact((0, -0.04, 0), (0, 1, 0), gf.FPC()),
        gf.Contact((0, 0.04, 0), (0, -1, 0), gf.FPC()),
    ]
    expected = gf.ForceProblem(
        gf.grasp_map(contacts, (0.01, 0.02, 0.03)),
        CAN["f"],
        [contact.model for contact in contacts],
        J=J,
        tau_lo=-1,
        tau_hi=[1, 2],
        tau_bias=[0.1, 0.2],
        c_max=[10, 11, 12, 13],
        c_min=0.1,
        engagement=[1, 1, 0.5, 1],
        A=A,
        b=[3],
        alpha=2,
    )
    assert name == "can"
    assert problem == expected


def of_contacts(rng, kinds, **further):
    """A random grasp as a file has it, and as Python makes it."""
    contacts, entries = [], []
    for kind in kinds:
        unit = rng.normal(size=3)
        unit /= np.linalg.norm(unit)
        coefficients = {"FPC": {}, "PCWF": {"mu": 0.5}, "SFC": {"mu": 1, "gamma": 0.01}}[kind]
        model = getattr(gf, kind)(**coefficients)
        tangent = rng.normal(size=3).tolist() if rng.random() < 0.5 else None
        given = {"point": (-0.04 * unit).tolist(), "normal": unit.tolist()}
        contacts.append(gf.Contact(*given.values(), model, tangent))
        entries.append(given | {"model": kind, **coefficients})
        if tangent is not None:
            entries[-1]["tangent"] = tangent
    origin = rng.normal(size=3).tolist() if rng.random() < 0.5 else (0, 0, 0)
    f = rng.normal(size=6).tolist()
    problem = gf.Grasp(contacts, origin=origin).problem(f, **further)
    return {"contacts": entries, "f": f, "origin": list(origin), **further}, problem


def of_map(rng, kinds, **further):
    kinds = [gf.PCWF(0.5) if kind == "PCWF" else gf.FPC(pull=2) for kind in kinds]
    W = rng.normal(size=(6, sum(kind.dim for kind in kinds)))
    f = rng.normal(size=6)
    names = [{"model": "PCWF", "mu": 0.5} if kind.dim == 3 else {"model": "FPC", "pull": 2}
             for kind in kinds]  # fmt: skip
    document = {"W": W.tolist(), "f": f.tolist(), "models": names, **further}
    return document, gf.ForceProblem(W, f, kinds, **further)


def random_file(rng, count=60):
    """Grasps of many kinds, mixed, and the problems that Python makes of them."""
    kinds = (["PCWF"] * 3, ["PCWF", "SFC", "FPC"], ["SFC"] * 4, ["PCWF"] * 2)
    limits = ({"c_max": 20}, {"c_max": 20, "c_min": 0.5, "alpha": 2}, {"f_soft": 0.1, "c_max": 9})
    for _ in range(count):
        make = of_contacts if rng.random() < 0.6 else of_map
        own = dict(limits[rng.integers(len(limits))])
        each = [kind if make is of_contacts else kind.replace("SFC", "FPC")
                for kind in kinds[rng.integers(len(kinds))]]  # fmt: skip
        if rng.random() < 0.3:
            own["c_max"] = [20 + i for i in range(len(each))]
        yield make(rng, each, **own)


def test_json_of_many_kinds_is_what_python_makes_and_read_at_once(tmp_path, monkeypatch):
    """To the last bit, and never by the parser and the loop that look for what is wrong."""
    documents, problems = zip(*random_file(np.random.default_rng(3)), strict=True)
    documents[4]["name"] = 'a "name" \\ with \\" ä and no other "key": 1'
    monkeypatch.setattr(json_grasps, "_parse", None)
    path = save(tmp_path / "many.json", {"comment": '"', "grasps": documents})
    grasps = files.read(path)
    assert [problem for _, problem in grasps] == list(problems)
    assert [name for name, _ in grasps][3:6] == ["many[3]", documents[4]["name"], "many[5]"]
    assert len(files.load(path).grasps.problems.groups) < 48  # kinds that there may be


def broken(documents, at, what):
    grasp = documents[at]
    if what == "a row too short":
        grasp["W" if "W" in grasp else "c_max"] = [[1.0] * 9] * 5 + [[1.0] * 8]
    elif what == "no tangent":
        grasp["contacts"][1]["tangent"] = grasp["contacts"][1]["normal"]
    elif what == "no unit":
        grasp["contacts"][1]["normal"] = [1, 1, 1]
    elif what == "a number too large":
        grasp["f"][2] = 10**400
    elif what == "limits that cross":
        grasp["c_min"] = 30
    elif what == "too few":
        grasp["f"] = grasp["f"][:5]
    elif what == "one for all":
        grasp["c_max"] = [20]
    return json.dumps({"grasps": documents})


@pytest.mark.parametrize(
    ("what", "message"),
    {
        "a row too short": r"W: not a regular array|\$\.grasps\[{}\]\.c_max\[0\]: got 9 entries",
        "no tangent": r"grasp {} 'many\[{}\]': contacts\[1\]: tangent: got",
        "no unit": r"grasp {} 'many\[{}\]': contacts\[1\]: normal: got \[1.0, 1.0, 1.0\]",
        "a number too large": r"\$\.grasps\[{}\]\.f\[2\]: got inf",
        "limits that cross": r"grasp {} 'many\[{}\]': c_min\[0\]: got 30, expected at most c_max",
        "too few": r"grasp {} 'many\[{}\]': f: got shape \(5,\)",
        "one for all": r"grasp {} 'many\[{}\]': c_max: got shape \(1,\)",
    }.items(),
)
def test_json_of_many_kinds_names_the_grasp_that_is_wrong(tmp_path, what, message):
    rng = np.random.default_rng(4)
    documents = [document for document, _ in random_file(rng, 30)]
    at = next(i for i in range(10, 30) if "contacts" in documents[i])
    path = tmp_path / "many.json"
    path.write_text(broken(documents, at, what))
    with pytest.raises(gf.InvalidInputError, match=message.replace("{}", str(at))):
        files.read(path)


@pytest.mark.parametrize("key", ["comment", "f", "mu", "point", "grasps"])
def test_json_key_given_twice_is_found_behind_quotes_in_texts(tmp_path, key):
    text = json.dumps({"comment": 'a \\" b \\\\', "grasps": [changed(comment='"\\'), CAN]})
    text = text.replace(f'"{key}":', f'"{key}": 1, "{key}":', 1)
    (tmp_path / "twice.json").write_text(text)
    with pytest.raises(gf.InvalidInputError, match=f'the key "{key}" is given twice'):
        files.read(tmp_path / "twice.json")


def test_json_slips_of_every_grasp_are_those_of_python(tmp_path):
    rng = np.random.default_rng(5)
    documents = [of_contacts(rng, ["PCWF"] * n)[0] for n in (3, 4, 3, 4, 3)]
    for at, scale in ((1, 1000.0), (2, -1.0), (4, 1000.0)):
        for contact in documents[at]["contacts"]:
            contact["point"] = [scale * x for x in contact["point"]]
    with warnings.catch_warnings(record=True) as expected:
        warnings.simplefilter("always")
        for each in documents:
            gf.Grasp([
                gf.Contact(c["point"], c["normal"], gf.PCWF(0.5)) for c in each["contacts"]
            ])  # fmt: skip
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        files.read(save(tmp_path / "slips.json", {"grasps": documents}))
    assert [str(each.message) for each in caught] == [str(each.message) for each in expected]
    assert len(caught) == 3
    assert {each.filename for each in caught} == {__file__}


def test_json_grasp_by_W(tmp_path):
    document = {"W": [[1, -1]], "models": [{"model": "FPC"}], "f": [2], "c_max": 5}
    ((name, problem),) = files.read(save(tmp_path / "plane.json", document))
    assert name == "plane"
    assert problem == gf.ForceProblem([[1, -1]], [2], [gf.FPC(), gf.FPC()], c_max=5)


def test_files_several_grasps_keep_their_order_and_get_names(tmp_path):
    unnamed = changed(name=None)
    document = {"grasps": [unnamed, CAN, unnamed]}
    names = [name for name, _ in files.read(save(tmp_path / "x.JSON", document))]
    assert names == ["x[0]", "can", "x[2]"]


def test_files_byte_order_mark_is_no_error(tmp_path):
    path = tmp_path / "g.json"
    path.write_text(json.dumps(CAN), encoding="utf-8-sig")
    assert files.read(path)[0].name == "can"


BAD_TEXTS = {
    "empty": (b"", "empty"),
    "blank": (b" \n\n", "empty"),
    "truncated": (json.dumps(CAN).encode()[:-9], r"line 1, column \d+: not JSON"),
    "not JSON": (b"point: 1", "line 1, column 1: not JSON"),
    "second document": (b"{}\n{}", "line 2, column 1: not JSON"),
    "Latin-1": ('{"name": "Ä"}'.encode("latin-1"), r"byte 10: got 0xc4, expected UTF-8"),
    "UTF-16": (json.dumps(CAN).encode("utf-16"), "byte 0: .* expected UTF-8"),
    "NaN": (b'{"f": [0, NaN]}', r"\$\.f\[1\]: got nan, expected a finite number"),
    "Infinity": (b'{"c_max": -Infinity}', r"\$\.c_max: got -inf, expected a finite"),
    "overflow": (b'{"c_max": 1e999}', r"\$\.c_max: got inf"),
    "huge integer": (b'{"c_max": 1' + b"0" * 5000 + b"}", r"\$\.c_max: got inf"),
    "key twice": (
        b'{"grasps": [{"contacts": [{"mu": 1, "mu": 2}]}]}',
        r'\$\.grasps\[0\]\.contacts\[0\]: the key "mu" is given twice',
    ),
    "deep": (b"[" * 100_000 + b"]" * 100_000, "nested too deeply"),
    "array": (b"[]", r"\$: got 0 entries, expected an object"),
    "number": (b"3", r"\$: got 3, expected an object"),
    "null": (b"null", r"\$: got null, expected an object"),
    "no grasps": (b'{"grasps": []}', r"\$\.grasps: got 0 entries, expected 1 or more"),
    "grasps no list": (b'{"grasps": {}}', r"\$\.grasps: got an object, expected an array"),
}


@pytest.mark.parametrize(("text", "message"), BAD_TEXTS.values(), ids=BAD_TEXTS)
def test_files_bad_text_is_refused(tmp_path, text, message):
    path = tmp_path / "bad.json"
    path.write_bytes(text)
    with pytest.raises(gf.InvalidInputError, match=message) as caught:
        files.read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


BAD_GRASPS = {
    "unknown key": (
        changed(frction=1),
        r'\$: unknown key "frction"; expected one of .*contacts.*c_max.*, grasps$',
    ),
    "unknown key of a contact": (
        with_contact(modle="PCWF", model=None),
        r'\$\.contacts\[0\]: unknown key "modle"; expected one of point, normal, tangent, model, '
        "mu, gamma, pull$",
    ),
    "unknown key in a list": (
        {"grasps": [CAN, changed(alhpa=1)]},
        r'\$\.grasps\[1\]: unknown key "alhpa"; .*alpha$',
    ),
    "unknown key beside grasps": (
        {"grasps": [CAN], "alpha": 1},
        r'\$: unknown key "alpha"; expected one of \$schema, comment, grasps$',
    ),
    "no f": (changed(f=None), r'\$: missing key "f"'),
    "no contacts": (changed(contacts=None), r'\$: missing key "contacts"'),
    "empty contacts": (changed(contacts=[]), r"\$\.contacts: got 0 entries, expected 1 or more"),
    "no point": (with_contact(point=None), r'\$\.contacts\[0\]: missing key "point"'),
    "no model": (with_contact(model=None), r'\$\.contacts\[0\]: missing key "model"'),
    "no mu": (with_contact(mu=None), r'\$\.contacts\[0\]: missing key "mu"'),
    "no gamma": (with_contact(model="SFC"), r'\$\.contacts\[0\]: missing key "gamma"'),
    "gamma of a PCWF": (
        with_contact(gamma=1),
        r"\$\.contacts\[0\]\.gamma: a PCWF contact has no torsion",
    ),
    "mu of an FPC": (with_contact(model="FPC"), r"\$\.contacts\[0\]\.mu: an FPC contact has no"),
    "unknown model": (
        with_contact(model="PCF"),
        r'\.model: got "PCF", expected one of "FPC", "PCWF", "SFC"',
    ),
    "two numbers": (
        with_contact(point=[0, 0]),
        r"\$\.contacts\[0\]\.point: got 2 entries, expected 3$",
    ),
    "four numbers": (with_contact(normal=[1, 0, 0, 0]), r"\.normal: got 4 entries, expected 3$"),
    "text for a number": (with_contact(mu="0.5"), r'\.mu: got "0\.5", expected a number'),
    "bool for a number": (with_contact(mu=True), r"\.mu: got true, expected a number"),
    "null for a number": (changed(f=[0, 0, 1, 0, 0, None]), r"\$\.f\[5\]: got null, expected a n"),
    "text for either": (changed(c_max="20"), r'c_max: got "20", expected a number or an array'),
    "object for either": (changed(c_max={}), "c_max: got an object, expected a number or an ar"),
    "long text": (with_contact(mu="x" * 500), r'got "x+…, expected a number'),
    "name no text": (changed(name=3), r"\$\.name: got 3, expected a string"),
    "mu 0": (with_contact(mu=0), r"\.mu: got 0, expected more than 0"),
    "c_max 0": (changed(c_max=[1, 1, 1, 0]), r"\$\.c_max\[3\]: got 0, expected more than 0"),
    "c_min below 0": (changed(c_min=-1), r"\$\.c_min: got -1, expected 0 or more"),
    "engagement above 1": (changed(engagement=1.5), "engagement: got 1.5, expected 1 or less"),
    "alpha 0": (changed(alpha=0), r"\$\.alpha: got 0, expected more than 0"),
    "W beside contacts": (
        changed(W=[[1]], models=[{"model": "FPC"}]),
        r"\$\.contacts: not expected beside W",
    ),
    "W without models": (changed(contacts=None, W=[[1]]), r'\$: missing key "models"'),
    "models without W": (changed(models=[{"model": "FPC"}]), r"\$\.models: expected only beside"),
    "normal of another length": (
        with_contact(normal=[-2, 0, 0]),
        r"grasp 0 'can': contacts\[0\]: normal: got .* of length 2, expected a unit vector",
    ),
    "short f": (changed(f=[0, 0, 1]), r"grasp 0 'can': f: got shape \(3,\), expected shape \(6,"),
    "ragged J": (
        changed(J=[[1, 2], [3]], tau_lo=-1, tau_hi=1),
        "grasp 0 'can': J: not a regular array",
    ),
    "J without limits": (changed(J=[[1]] * 9), "grasp 0 'can': tau_lo: missing; J came without"),
    "limits without J": (changed(tau_lo=-1, tau_hi=1), "grasp 0 'can': J: missing; tau_lo and"),
    "limits that cross": (
        changed(J=[[1]] * 9, tau_lo=2, tau_hi=1),
        r"grasp 0 'can': tau_lo\[0\]: got 2, expected less than tau_hi",
    ),
    "second of two": (
        {"grasps": [CAN, changed(name="mug", c_min=30)]},
        r"grasp 1 'mug': c_min\[0\]: got 30, expected at most c_max",
    ),
    "name that steers the terminal": (
        changed(name="\x1b[2J", f=[1]),
        r"grasp 0 '\\x1b\[2J': f: got shape",
    ),
}


@pytest.mark.parametrize(("document", "message"), BAD_GRASPS.values(), ids=BAD_GRASPS)
def test_files_bad_grasp_is_refused(tmp_path, document, message):
    path = save(tmp_path / "bad.json", document)
    with pytest.raises(gf.InvalidInputError, match=message) as caught:
        files.read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_files_the_can_itself_is_fine(tmp_path):
    """Else the cases above could be refused for the wrong reason."""
    ((_, problem),) = files.read(save(tmp_path / "can.json", CAN))
    assert gf.solve(problem).status is gf.Status.SOLVED


def test_unreadable_files(tmp_path):
    with pytest.raises(gf.InvalidInputError, match=r"none\.json: cannot read the file: No such"):
        files.read(tmp_path / "none.json")
    with pytest.raises(gf.InvalidInputError, match=r"none\.npz: cannot read the file: No such"):
        files.read(tmp_path / "none.npz")
    with pytest.raises(gf.InvalidInputError, match=r"ending in '\.txt', expected one in \.json"):
        files.read(tmp_path / "grasps.txt")
    (tmp_path / "folder.json").mkdir()
    with pytest.raises(gf.InvalidInputError, match=r"folder\.json: cannot read the file"):
        files.read(tmp_path / "folder.json")


def test_files_schema_is_valid_and_describes_what_the_reader_reads():
    schema = files.schema()
    Draft202012Validator.check_schema(schema)
    arguments = {"f", "W", "J", "tau_lo", "tau_hi", "tau_bias", "c_max", "c_min", "engagement"}
    arguments |= {"f_soft", "internal", "cone_weight", "c_last", "dc_max", "A", "b", "alpha"}
    arguments |= {"models"}
    keys = set(schema["$defs"]["grasp"]["properties"])
    assert keys - arguments == {"$schema", "comment", "name", "contacts", "origin"}
    assert arguments == set(gf.ForceProblem([[1.0]], [1], gf.FPC()).arguments())


# ---- reading NPZ -------------------------------------------------------------------------------


def stacks(B=3, n=2, joints=4, seed=0):
    rng = np.random.default_rng(seed)
    m = 3 * n
    return {
        "W": rng.normal(size=(B, 6, m)),
        "f": rng.normal(size=(B, 6)),
        "mu": rng.uniform(0.2, 1, size=(B, n)),
        "J": rng.normal(size=(B, m, joints)),
        "tau_limit": rng.uniform(1, 2, size=(B, joints)),
        "c_max": rng.uniform(5, 9, size=B),
        "alpha": rng.uniform(1, 9, size=B),
        "names": np.array([f"grasp {i} ä" for i in range(B)]),
    }


def test_npz_stacks_are_the_problems_that_python_makes(tmp_path):
    data = stacks()
    np.savez(tmp_path / "s.npz", **data)
    grasps = files.read(tmp_path / "s.npz")
    assert [name for name, _ in grasps] == data["names"].tolist()
    for i, (_, problem) in enumerate(grasps):
        assert problem == gf.ForceProblem(
            data["W"][i],
            data["f"][i],
            [gf.PCWF(mu) for mu in data["mu"][i]],
            J=data["J"][i],
            tau_lo=-data["tau_limit"][i],
            tau_hi=data["tau_limit"][i],
            c_max=data["c_max"][i],
            alpha=data["alpha"][i],
        )


def geometry(B=3, n=2, seed=1):
    """Points around the origin, and unit normals to it as data sets hold them: in float32."""
    points = np.random.default_rng(seed).normal(size=(B, n, 3)) * 0.04
    normals = -points / np.linalg.norm(points, axis=-1, keepdims=True)
    data = stacks(B, n) | {"points": points, "normals": normals.astype(np.float32)}
    del data["W"]
    return data


@pytest.mark.parametrize("origin", [None, [0.0, 0.01, 0.02], np.eye(3) * 0.01])
@pytest.mark.parametrize("tangents", [None, np.random.default_rng(4).normal(size=(3, 2, 3))])
def test_npz_points_and_normals_are_the_grasps_that_python_makes(tmp_path, origin, tangents):
    data = geometry()
    extra = {"origin": origin, "tangents": tangents}
    np.savez(tmp_path / "s.npz", **data, **{k: v for k, v in extra.items() if v is not None})
    grasps, unused = files.load(tmp_path / "s.npz")
    assert unused == []
    for i, (name, problem) in enumerate(grasps):
        assert name == data["names"][i]
        contacts = [
            gf.Contact(
                data["points"][i, j], data["normals"][i, j], gf.PCWF(data["mu"][i, j]),
                None if tangents is None else tangents[i, j],
            )
            for j in range(2)
        ]  # fmt: skip
        about = (0, 0, 0) if origin is None else np.broadcast_to(origin, (3, 3))[i]
        expected = gf.Grasp(contacts, origin=about).problem(
            data["f"][i], J=data["J"][i], tau_lo=-data["tau_limit"][i], tau_hi=data["tau_limit"][i],
            c_max=data["c_max"][i], alpha=data["alpha"][i],
        )  # fmt: skip
        np.testing.assert_allclose(problem.W, expected.W, atol=1e-15)
        assert problem.replace(W=expected.W) == expected


def test_npz_points_beside_w_are_left_alone(tmp_path):
    """W says what the grasps are; its frames may be others than the package chooses."""
    data = geometry() | {"points": np.ones((7, 3)), "origin": 3.0} | {"W": stacks()["W"]}
    np.savez(tmp_path / "s.npz", **data)
    grasps, unused = files.load(tmp_path / "s.npz")
    assert sorted(unused) == sorted(files.unused_keys(tmp_path / "s.npz"))
    assert sorted(unused) == ["normals", "origin", "points"]
    np.savez(tmp_path / "s.npz", **stacks())
    assert [each.problem for each in grasps] == [p for _, p in files.read(tmp_path / "s.npz")]


def test_npz_points_that_look_like_a_slip_are_warned_of_once(tmp_path):
    data = geometry()
    np.savez(tmp_path / "s.npz", **data | {"points": data["points"] * 1000})
    with pytest.warns(gf.GraspForceWarning, match="millimetres") as caught:
        files.read(tmp_path / "s.npz")
    assert len(caught) == 1


BAD_GEOMETRY = {
    "no normals": ({"normals": None}, r"normals: missing; expected normals \(B, n, 3\) beside"),
    "no points": ({"points": None}, "W: missing; expected at least W .*, or points and normals"),
    "one grasp's": ({"points": np.ones((2, 3))}, r"points: got shape \(2, 3\), .*\(B, n, 3\)"),
    "none": ({"points": np.ones((0, 2, 3))}, r"points: got shape \(0, 2, 3\), expected at least"),
    "no contacts": (
        {"points": np.ones((3, 0, 3))},
        r"points: got shape \(3, 0, 3\), expected shape",
    ),
    "flat": (
        {"points": np.ones((3, 2, 2))},
        r"points: got shape \(3, 2, 2\), expected .*\(3, n, 3",
    ),
    "fewer": ({"normals": np.ones((2, 2, 3))}, "normals: got 2 entries, .* grasp in points"),
    "other n": (
        {"normals": np.ones((3, 4, 3))},
        r"normals: got shape \(3, 4, 3\), expected .*2, 3",
    ),
    "long": (
        {"normals": 2 * geometry()["normals"]},
        r"grasp 0 'grasp 0 ä': contacts\[0\]: normal: got .* of length 2, expected a unit vector",
    ),
    "along": ({"tangents": geometry()["normals"]}, r"contacts\[0\]: tangent: .* across the normal"),
    "scalar origin": ({"origin": 1.0}, r"origin: got shape \(\), expected a stack \(B, 3\)"),
    "NaN": ({"points": np.full((3, 2, 3), np.nan)}, r"points\[0, 0, 0\]: got nan"),
}


@pytest.mark.parametrize(("changes", "message"), BAD_GEOMETRY.values(), ids=BAD_GEOMETRY)
def test_npz_bad_points_are_refused(tmp_path, changes, message):
    path = tmp_path / "bad.npz"
    data = {key: value for key, value in (geometry() | changes).items() if value is not None}
    np.savez(path, **data)
    with pytest.raises(gf.InvalidInputError, match=message) as caught:
        files.read(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_npz_scalars_stand_for_all(tmp_path):
    data = stacks()
    short = data | {"mu": 0.5, "tau_limit": 1.5, "c_max": 7, "alpha": 2}
    long = data | {
        "mu": np.full((3, 2), 0.5),
        "tau_limit": np.full((3, 4), 1.5),
        "c_max": np.full((3, 2), 7),
        "alpha": np.full(3, 2.0),
    }
    per_grasp = short | {"mu": [0.5] * 3, "tau_limit": [1.5] * 3, "c_max": [7] * 3}
    np.savez(tmp_path / "a.npz", **short)
    np.savez(tmp_path / "b.npz", **long)
    np.savez(tmp_path / "c.npz", **per_grasp)
    assert files.read(tmp_path / "a.npz") == files.read(tmp_path / "b.npz")
    assert files.read(tmp_path / "a.npz") == files.read(tmp_path / "c.npz")


def test_npz_all_limits(tmp_path):
    data = stacks() | {"A": np.ones((3, 2, 6)), "b": np.ones((3, 2))}
    del data["tau_limit"]
    extra = {"tau_lo": -1.0, "tau_hi": 2.0, "tau_bias": 0.1, "c_min": 0.2, "engagement": 0.5}
    np.savez(tmp_path / "s.npz", **data, **extra)
    problem = files.read(tmp_path / "s.npz")[2].problem
    assert problem == gf.ForceProblem(
        data["W"][2], data["f"][2], [gf.PCWF(mu) for mu in data["mu"][2]], J=data["J"][2],
        c_max=data["c_max"][2], alpha=data["alpha"][2], A=data["A"][2], b=data["b"][2], **extra,
    )  # fmt: skip


def test_npz_every_limit_of_every_grasp_has_its_own_numbers(tmp_path):
    rng = np.random.default_rng(3)
    data = stacks(B=4)
    del data["tau_limit"], data["c_max"]
    data |= {
        "tau_lo": rng.uniform(-2, -1, 4), "tau_hi": rng.uniform(1, 2, (4, 4)), "tau_bias": 0.1,
        "c_max": rng.uniform(5, 9, (4, 2)), "c_min": rng.uniform(0.1, 0.2, 4),
        "engagement": rng.uniform(0.5, 1, (4, 2)), "c_last": rng.normal(size=(4, 6)),
        "dc_max": rng.uniform(1, 2, 4), "A": rng.normal(size=(4, 2, 6)),
        "b": rng.normal(size=(4, 2)),
    }  # fmt: skip
    np.savez(tmp_path / "s.npz", **data)
    for i, (_, problem) in enumerate(files.read(tmp_path / "s.npz")):
        own = {
            key: value[i] if np.ndim(value) else value
            for key, value in data.items()
            if key not in ("mu", "names")
        }
        assert problem == gf.ForceProblem(models=[gf.PCWF(mu) for mu in data["mu"][i]], **own)


def test_npz_problems_cannot_be_written_to(tmp_path):
    np.savez(tmp_path / "s.npz", **stacks())
    problem = files.read(tmp_path / "s.npz")[1].problem
    with pytest.raises(ValueError, match="read-only"):
        problem.f[0] = 1.0


def test_npz_names(tmp_path):
    data = stacks()
    names = data.pop("names")
    path = tmp_path / "s.npz"
    np.savez(path, **data)
    assert [name for name, _ in files.read(path)] == ["s[0]", "s[1]", "s[2]"]
    np.savez(path, **data, object=[7, 8, 9])
    assert [name for name, _ in files.read(path)] == ["7", "8", "9"]
    np.savez(path, **data, object=[7, 8, 9], names=names)
    assert [name for name, _ in files.read(path)] == names.tolist()


def test_npz_other_keys_are_left_alone_and_listed(tmp_path):
    # One of them could not even be read without unpickling.
    other = {"mass": np.ones(5), "poses": np.array([{"a": 1}], dtype=object)}
    np.savez(tmp_path / "s.npz", **stacks(), **other)
    assert len(files.read(tmp_path / "s.npz")) == 3
    assert sorted(files.unused_keys(tmp_path / "s.npz")) == ["mass", "poses"]
    assert sorted(files.load(tmp_path / "s.npz").unused_keys) == ["mass", "poses"]
    assert files.unused_keys(tmp_path / "any.json") == []
    assert files.load(save(tmp_path / "can.json", CAN)).unused_keys == []
    with pytest.raises(gf.InvalidInputError, match=r"none\.npz: cannot read"):
        files.unused_keys(tmp_path / "none.npz")


class Bomb:
    """Would leave a file behind if anybody unpickled it."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (Path.touch, (self.path,))


def test_npz_is_never_unpickled(tmp_path):
    trace = tmp_path / "trace"
    for key in ("W", "names"):
        np.savez(tmp_path / "s.npz", **stacks() | {key: np.array([Bomb(trace)] * 3)})
        with pytest.raises(gf.InvalidInputError, match=f"{key}: cannot read the array: .*pickle"):
            files.read(tmp_path / "s.npz")
    assert not trace.exists()


def last_nan():
    J = np.ones((3, 6, 4))
    J[2, 5, 3] = np.nan
    return J


BAD_STACKS = {
    "no W": ({"W": None}, r"W: missing; expected at least W .*, or points and normals"),
    "no f": ({"f": None}, "f: missing"),
    "no mu": ({"mu": None}, "mu: missing"),
    "one grasp's W": ({"W": np.ones((6, 6))}, r"W: got shape \(6, 6\), expected a stack \(B, k, "),
    "scalar f": ({"f": 3.0}, r"f: got shape \(\), expected a stack \(B, k\)"),
    "no grasps": ({"W": np.ones((0, 6, 6))}, r"W: got shape \(0, 6, 6\), expected at least one"),
    "shorter f": ({"f": np.ones((2, 6))}, "f: got 2 entries, expected 3, one for each grasp"),
    "longer names": ({"names": ["a"] * 4}, "names: got 4 entries, expected 3"),
    "names no text": ({"names": np.ones(3)}, r"names: got type float64 .* expected text"),
    "W of text": ({"W": np.full((3, 6, 6), "a")}, "grasp 0 'grasp 0 ä': W: got type str"),
    "W complex": ({"W": np.ones((3, 6, 6)) * 1j}, "W: got type complex128"),
    "seven columns": ({"W": np.ones((3, 6, 7))}, "W: got 7 columns, expected 3 for each contact"),
    "NaN": ({"f": np.full((3, 6), np.nan)}, r"grasp 0 'grasp 0 ä': f\[0\]: got nan"),
    "mu 0": ({"mu": [0.5, 0.0, 0.5]}, "grasp 1 'grasp 1 ä': PCWF.mu: got 0.0"),
    "three mu": ({"mu": np.ones((3, 3))}, r"mu: got shape \(3,\), expected shape \(2,\)"),
    "tau_limit 0": ({"tau_limit": [1, 1, 0]}, r"grasp 2 .*: tau_limit\[0\]: got 0, expected more"),
    "NaN in the last": ({"J": last_nan()}, r"grasp 2 .*: J\[5, 3\]: got nan, expected"),
    "tau_limit of text": ({"tau_limit": "a"}, "tau_limit: got type str"),
    "no J": ({"J": None}, "J: missing; tau_lo and tau_hi came without it"),
    "no tau_limit": ({"tau_limit": None}, "tau_lo: missing; J came without it"),
    "two kinds of limit": ({"tau_lo": -1.0}, "tau_limit: given beside tau_lo or tau_hi"),
    "unsigned tau_limit": ({"tau_limit": np.full(3, 2, np.uint8), "f": np.ones(3)}, "f: got shape"),
}


@pytest.mark.parametrize(("changes", "message"), BAD_STACKS.values(), ids=BAD_STACKS)
def test_files_bad_stacks_are_refused(tmp_path, changes, message):
    path = tmp_path / "bad.npz"
    data = {key: value for key, value in (stacks() | changes).items() if value is not None}
    np.savez(path, **data)
    with pytest.raises(gf.InvalidInputError, match=message) as caught:
        files.read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_npz_unsigned_limits_do_not_wrap(tmp_path):
    np.savez(tmp_path / "s.npz", **stacks() | {"tau_limit": np.full(3, 2, np.uint8)})
    problem = files.read(tmp_path / "s.npz")[0].problem
    assert problem.tau_lo.tolist() == [-2.0] * 4
    assert problem.tau_hi.tolist() == [2.0] * 4


@pytest.mark.parametrize("content", [b"", b"\x00" * 99, b"PK\x03\x04 and no more", b'{"f": 1}'])
def test_npz_that_is_none_is_refused(tmp_path, content):
    path = tmp_path / "bad.npz"
    path.write_bytes(content)
    with pytest.raises(gf.InvalidInputError, match=r"bad\.npz: not an NPZ archive"):
        files.read(path)


def test_npy_named_npz_is_refused(tmp_path):
    with (tmp_path / "bad.npz").open("wb") as file:
        np.save(file, np.ones(3))
    with pytest.raises(gf.InvalidInputError, match="not an NPZ archive"):
        files.read(tmp_path / "bad.npz")


@pytest.mark.filterwarnings("ignore")  # NumPy warns of some damaged headers before it gives up
@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_damaged_npz_is_refused_or_read(tmp_path, save):
    """Cut it anywhere, or overwrite any bytes: an InvalidInputError or grasps, nothing else."""
    whole, broken = tmp_path / "whole.npz", tmp_path / "broken.npz"
    save(whole, **stacks())
    data = whole.read_bytes()
    rng = random.Random(0)
    refused = 0
    for trial in range(300):
        damaged = bytearray(data)
        if trial % 3 == 0:
            del damaged[rng.randrange(len(data)) :]
        else:
            for _ in range(rng.choice([1, 3, 30])):
                damaged[rng.randrange(len(data))] = rng.randrange(256)
        broken.write_bytes(damaged)
        try:
            assert len(files.read(broken)) == 3
        except gf.InvalidInputError:
            refused += 1
    assert refused > 150


# ---- writing -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def results():
    """Solved and infeasible, with joints and without, of different sizes, one contact removed."""
    grasps = [
        *files.read(EXAMPLES / "several_grasps.json"),
        *files.read(EXAMPLES / "paper_grasp.json"),
    ]
    paper = grasps[-1].problem
    away = paper.replace(c_max=20, engagement=[1, 1, 0, 1])
    unbounded = grasps[0].problem.replace(c_max=None, engagement=None)
    grasps += [("three fingers", away), ('comma, "quote"\nline ä', unbounded)]
    return [files.NamedSolution(name, gf.solve(problem)) for name, problem in grasps]


def numbers_and_vectors(results):
    """What is written of every result, from its columns, whose tests judge the numbers."""
    columns = Columns(solution for _, solution in results)
    for i, solution in enumerate(columns):
        names = [
            "phi", "suboptimality", "violation", "friction_residual", "torque_residual",
            "wrench_error", "newton_steps", "nearest",
        ]  # fmt: skip
        numbers = {name: columns.rows(name)[i] for name in names}
        names = ["c", "tau", "normal_forces", "friction_margins", "torque_margins", "nu", "missing"]
        vectors = {name: columns.rows(name)[i] for name in names}
        proof = solution.certificate
        vectors["certificate_y"] = proof.y if proof else np.empty(0)
        vectors["certificate_z"] = proof.z if proof else np.empty(0)
        yield numbers | {"alpha": solution.problem.alpha}, vectors


@pytest.mark.parametrize("ending", ["json", "csv", "npz"])
def test_arrays_of_results_are_written_as_one_result_after_the_other(tmp_path, ending):
    problems = [p for p in make_problems() for _ in range(2)]
    problems.append(problems[0].replace(f=1e300 * problems[0].f))
    names = [str(i) for i in range(len(problems))]
    columns = ProblemColumns.of(problems).solve()
    assert {gf.Status.INVALID_NUMBERS, gf.Status.INFEASIBLE} < set(columns.status.tolist())
    together, one_by_one = tmp_path / f"a.{ending}", tmp_path / f"b.{ending}"
    files.write(together, files.NamedSolutions(names, columns))
    files.write(one_by_one, list(zip(names, columns, strict=True)))
    assert together.read_bytes() == one_by_one.read_bytes()
    messages = [solution.message for solution in columns]
    assert columns.messages() == messages


def finite(x):
    return x if math.isfinite(x) else None


def test_files_the_results_have_every_case(results):
    statuses = [solution.status for _, solution in results]
    assert {gf.Status.SOLVED, gf.Status.INFEASIBLE, gf.Status.UNBOUNDED} == set(statuses)
    assert any(np.isinf(solution.friction_margins).any() for _, solution in results)
    assert len({solution.problem.m for _, solution in results}) > 2


def test_json_results_round_trip(tmp_path, results):
    path = tmp_path / "out.json"
    files.write(path, results)
    text = path.read_text(encoding="utf-8")
    assert "NaN" not in text
    assert "Infinity" not in text
    back = json.loads(text)["results"]
    assert len(back) == len(results)
    written = numbers_and_vectors(results)
    for got, (name, solution), (numbers, vectors) in zip(back, results, written, strict=True):
        certificate = got.pop("certificate")
        got |= {f"certificate_{k}": (certificate or {"y": [], "z": []})[k] for k in "yz"}
        assert (certificate is None) == (solution.certificate is None)
        expected = {
            "name": name,
            "status": solution.status.name,
            "message": solution.message,
            **{key: finite(value) for key, value in numbers.items()},
            **{key: [finite(x) for x in v.tolist()] for key, v in vectors.items()},
        }
        assert got == expected


def test_json_certificate_still_proves(tmp_path, results):
    files.write(tmp_path / "out.json", results)
    back = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["results"]
    proofs = 0
    for got, (_, solution) in zip(back, results, strict=True):
        if got["certificate"]:
            y, z = (np.array(got["certificate"][key]) for key in "yz")
            assert gf.check_certificate(solution.problem, gf.Certificate(y, z))
            proofs += 1
    assert proofs == 2


def test_csv_results_round_trip(tmp_path, results):
    path = tmp_path / "out.csv"
    files.write(path, results)
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file, strict=True))
    assert len(rows) == len(results)
    written = numbers_and_vectors(results)
    for row, (name, solution), (numbers, vectors) in zip(rows, results, written, strict=True):
        assert row.pop("name") == name
        assert row.pop("status") == solution.status.name
        assert row.pop("message") == solution.message
        for key, value in numbers.items():
            cell = row.pop(key)
            assert (float(cell) if cell else None) == finite(value)
        for key, vector in vectors.items():
            for index, value in enumerate(vector):
                cell = row.pop(f"{key}_{index}")
                assert (float(cell) if cell else None) == finite(value)
        assert set(row.values()) <= {""}  # columns of larger grasps


def test_npz_results_round_trip(tmp_path, results):
    path = tmp_path / "out.npz"
    files.write(path, results)
    with np.load(path, allow_pickle=False) as archive:
        back = dict(archive)
    assert all(len(array) == len(results) for array in back.values())
    written = numbers_and_vectors(results)
    for i, ((name, solution), (numbers, vectors)) in enumerate(zip(results, written, strict=True)):
        assert back["name"][i] == name
        assert back["status"][i] == solution.status.name
        assert back["message"][i] == solution.message
        for key, value in numbers.items():
            np.testing.assert_equal(back[key][i], value)
        for key, vector in vectors.items():
            length = back[f"{key}_length"][i]
            np.testing.assert_array_equal(back[key][i, :length], vector)
            assert np.isnan(back[key][i, length:]).all()


@pytest.mark.parametrize("ending", [".json", ".csv", ".npz"])
def test_files_failed_write_keeps_what_was_there(tmp_path, results, ending, monkeypatch):
    path = tmp_path / f"out{ending}"
    path.write_text("precious")

    def full(*_):
        raise OSError(28, "No space left on device")

    # The last step of a write, when all the bytes of the temporary file are there.
    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OSError, match="No space left") as caught:
        files.write(path, results)
    assert caught.value.filename == str(path)
    assert path.read_text() == "precious"
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_write_replaces_whole_files_and_keeps_links(tmp_path, results):
    (tmp_path / "real.csv").write_text("x" * 10**6)
    (tmp_path / "link.csv").symlink_to(tmp_path / "real.csv")
    files.write(tmp_path / "link.csv", results[:1])
    assert (tmp_path / "link.csv").is_symlink()
    files.write(tmp_path / "fresh.csv", results[:1])
    assert (tmp_path / "real.csv").read_bytes() == (tmp_path / "fresh.csv").read_bytes()


def test_files_bad_outputs_are_refused(tmp_path, results):
    with pytest.raises(gf.InvalidInputError, match=r"ending in '\.xlsx', expected one in \.json"):
        files.write(tmp_path / "out.xlsx", results)
    with pytest.raises(gf.InvalidInputError, match=r"directory .* does not exist"):
        files.write(tmp_path / "nowhere" / "out.json", results)
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(gf.InvalidInputError, match="got a directory, expected a file"):
        files.write(tmp_path / "folder.csv", results)


# ---- examples and documentation ----------------------------------------------------------------


def test_files_examples_are_what_their_script_makes(tmp_path):
    script = [sys.executable, str(EXAMPLES / "make_examples.py"), str(tmp_path)]
    subprocess.run(script, check=True, timeout=60)
    made = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()}
    kept = {path.name: path.read_text(encoding="utf-8") for path in EXAMPLES.glob("*.json")}
    assert made == kept


def test_files_paper_example_is_the_static_scenario():
    ((_, problem),) = files.read(EXAMPLES / "paper_grasp.json")
    expected = gf.scenarios.get("static").problem(0.0)
    for name, value in expected.arguments().items():
        if name != "models" and value is not None:
            np.testing.assert_allclose(getattr(problem, name), value, atol=1e-11, err_msg=name)
    assert problem.models == expected.models
    assert gf.solve(problem).status is gf.Status.SOLVED


def test_files_nose_cone_is_the_published_problem():
    """Lobo, Vandenberghe, Boyd and Lebret (1998), in the numbers of Vanderbei's collection."""
    ((_, problem),) = files.read(EXAMPLES / "nose_cone.json")
    document = json.loads((EXAMPLES / "nose_cone.json").read_text(encoding="utf-8"))
    points, normals = nose_cone(5)
    found = [(contact["point"], contact["normal"]) for contact in document["contacts"]]
    np.testing.assert_allclose(found, np.stack((points, normals), axis=1), atol=1e-11)
    assert problem.f.tolist() == [0, 0, 1, 0, 0, 0]
    assert set(problem.mu) == {0.3}
    np.testing.assert_allclose(problem.W[:3, ::3], normals.T, atol=1e-11)
    for i, point in enumerate(points):  # whatever the tangents are, they span the same wrenches
        of_force = np.vstack((np.eye(3), np.cross(point, np.eye(3)).T))
        mine = problem.W[:, 3 * i : 3 * i + 3]
        np.testing.assert_allclose(mine @ mine.T, of_force @ of_force.T, atol=1e-11)

    least = 0.49108896
    assert gf.solve(problem.replace(c_max=1.001 * least)).status is gf.Status.SOLVED
    assert gf.solve(problem.replace(c_max=0.999 * least)).status is gf.Status.INFEASIBLE


def test_files_several_example():
    solutions = [gf.solve(problem) for _, problem in files.read(EXAMPLES / "several_grasps.json")]
    verdicts = [solution.status.name for solution in solutions]
    assert verdicts == ["SOLVED", "INFEASIBLE", "SOLVED", "SOLVED", "INFEASIBLE"]
    assert all(solution.verify().ok for solution in solutions)


def test_files_allegro_file_is_read_as_it_is():
    grasps = files.read(ALLEGRO)
    assert len(grasps) == 12
    assert grasps[0].name == "002_master_chef_can"
    assert grasps[0].problem.tau_hi.tolist() == [0.7] * 16
    assert {"ref_status", "wbf_c_alpha1"} <= set(files.unused_keys(ALLEGRO))


@pytest.mark.parametrize("snippet", blocks(ROOT / "docs" / "file_formats.md", "json"))
def test_json_of_the_docs_is_read_and_solved(tmp_path, snippet):
    (tmp_path / "snippet.json").write_text(snippet, encoding="utf-8")
    for _, problem in files.read(tmp_path / "snippet.json"):
        assert gf.solve(problem).status is gf.Status.SOLVED


def test_files_docs_name_every_key_and_field(tmp_path, results):
    files.write(tmp_path / "out.json", results)
    files.write(tmp_path / "out.npz", results)
    with np.load(tmp_path / "out.npz") as archive:
        fields = {key.removesuffix("_length") for key in archive.files}
    written = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["results"][0]
    text = (ROOT / "docs" / "file_formats.md").read_text(encoding="utf-8")
    definitions = files.schema()["$defs"]
    keys = {
        key for each in ("grasp", "contact", "several") for key in definitions[each]["properties"]
    }
    keys |= {*npz_grasps.KEYS, *fields, *written}
    missing = {key for key in keys if f"`{key}" not in text}
    assert not missing


def test_files_replacing_is_an_alias_that_warns(tmp_path):
    with pytest.warns(DeprecationWarning, match="replacing is now graspforce.files.atomic_write"):
        replacing = files.replacing
    with replacing(tmp_path / "out.txt") as temporary:
        temporary.write_text("whole")
    assert (tmp_path / "out.txt").read_text() == "whole"
    with pytest.raises(AttributeError, match="has no attribute 'other'"):
        files.other  # noqa: B018
