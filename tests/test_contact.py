"""Contact models and contacts: frames, normalisation, value semantics."""

import dataclasses
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from grasps import unit
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import graspforce as gf
from graspforce.contact import model_of

MODELS = [gf.FPC(), gf.PCWF(0.5), gf.SFC(0.5, 0.01)]
vectors = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)


def contact(point=(0.01, 0.02, 0.03), normal=(0, 0, 1), model=MODELS[1], tangent=None):
    return gf.Contact(point, normal, model, tangent)


@pytest.mark.parametrize(("model", "dim"), [*zip(MODELS, (1, 3, 4), strict=True)])
def test_number_of_components(model, dim):
    assert model.dim == dim


@given(normal=vectors, tangent=st.none() | vectors)
def test_frame_is_right_handed_with_the_normal_first(normal, tangent):
    normal = unit(normal)
    if tangent is not None and np.linalg.norm(np.cross(normal, tangent)) < 1e-6:
        tangent = None
    frame = contact(normal=normal, tangent=tangent).frame
    n, x, y = frame.T
    assert n == pytest.approx(normal, abs=1e-15)
    assert frame.T @ frame == pytest.approx(np.eye(3), abs=1e-14)
    assert np.cross(x, y) == pytest.approx(n, abs=1e-14)
    if tangent is not None:  # x is the given direction without its part along the normal
        across = tangent - (tangent @ normal) * normal
        assert x == pytest.approx(unit(across), abs=1e-9)


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3)])
def test_every_axis_as_normal_has_a_default_tangent(axis):
    assert np.linalg.det(contact(normal=axis).frame) == pytest.approx(1)


def test_tangent_of_any_length_gives_the_same_frame():
    short = contact(tangent=(1e-5, 2e-5, 7))
    long = contact(tangent=(1e5, 2e5, -3))
    assert short.frame == pytest.approx(long.frame, abs=1e-9)


@pytest.mark.parametrize("length", [1 - 0.9e-6, 1 + 0.9e-6])
def test_normal_of_nearly_unit_length_is_normalised(length, rng):
    normal = unit(rng.normal(size=3))
    got = contact(normal=length * normal).normal
    assert np.linalg.norm(got) == pytest.approx(1, abs=1e-15)
    assert got == pytest.approx(normal, abs=1e-15)


@pytest.mark.parametrize("length", [0, 0.5, 1 - 1.1e-6, 1 + 1.1e-6, 2, 1e200])
def test_normal_of_another_length_is_refused(length):
    with pytest.raises(gf.InvalidInputError, match=r"^normal: got .* expected a unit vector"):
        contact(normal=(0, 0, length))


@pytest.mark.parametrize("tangent", [(0, 0, 1), (0, 0, -3), (1e-12, 0, 1), (0, 0, 0)])
def test_tangent_along_the_normal_is_refused(tangent):
    with pytest.raises(gf.InvalidInputError, match=r"^tangent: got .* expected a direction across"):
        contact(tangent=tangent)


def test_friction_may_be_an_integer_and_becomes_a_float():
    assert gf.PCWF(1).mu == 1.0
    assert isinstance(gf.PCWF(1).mu, float)


@pytest.mark.parametrize("thing", [*MODELS, contact(), contact(model=MODELS[2], tangent=(1, 1, 0))])
def test_pickle_returns_an_equal_thing(thing):
    copy = pickle.loads(pickle.dumps(thing))
    assert copy == thing
    assert hash(copy) == hash(thing)
    assert repr(copy) == repr(thing)
    assert type(thing).__name__ in repr(thing)


def test_models_compare_by_value():
    assert gf.PCWF(0.5) == gf.PCWF(0.5)
    assert gf.PCWF(0.5) != gf.PCWF(0.6)
    assert gf.SFC(0.5, 0.01) != gf.SFC(0.5, 0.02)
    assert gf.FPC() == gf.FPC()
    assert gf.PCWF(0.5) != gf.SFC(0.5, 0.01)


def test_contacts_compare_by_value():
    base = contact()
    assert base == contact()
    assert hash(base) == hash(contact())
    assert len({base, contact(), contact(point=(0, 0, 0))}) == 2
    for other in (
        contact(point=(0, 0, 0)),
        contact(normal=(0, 0, -1)),
        contact(model=MODELS[2]),
        contact(tangent=(0, 1, 0)),
        "contact",
    ):
        assert base != other


def test_equal_contacts_hash_equally_whatever_the_sign_of_zero():
    plus, minus = contact(point=(0.0, 0, 0)), contact(point=(-0.0, 0, 0))
    assert plus == minus
    assert hash(plus) == hash(minus)


@pytest.mark.parametrize("thing", [*MODELS[1:], contact()])
def test_frozen(thing):
    name = dataclasses.fields(thing)[0].name
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(thing, name, getattr(thing, name))


@pytest.mark.parametrize("thing", [contact(), pickle.loads(pickle.dumps(contact()))])
@pytest.mark.parametrize("name", ["point", "normal", "tangent"])
def test_arrays_are_read_only(thing, name):
    with pytest.raises(ValueError, match="read-only"):
        getattr(thing, name)[0] = 1.0


def test_arguments_are_copied():
    point = np.zeros(3)
    made = contact(point=point)
    point[0] = 9.0
    assert made.point[0] == 0.0


def test_frame_turns_with_the_world(rng):
    R = Rotation.random(random_state=3).as_matrix()
    normal, tangent = unit(rng.normal(size=(2, 3)))
    turned = contact(normal=R @ normal, tangent=R @ tangent).frame
    assert turned == pytest.approx(R @ contact(normal=normal, tangent=tangent).frame, abs=1e-14)


@pytest.mark.parametrize("model", MODELS, ids=str)
def test_wrench_basis_is_what_each_component_exerts(model, rng):
    """Forces along normal, x and y; a torque about the normal; nothing else."""
    axis = unit(rng.normal(size=3))
    touched = contact(normal=axis, model=model, tangent=rng.normal(size=3))
    basis = touched.wrench_basis
    assert basis.shape == (6, model.dim)
    forces = touched.frame[:, : min(model.dim, 3)]
    assert np.array_equal(basis[:3, :3], forces)
    assert not basis[3:, :3].any()
    if model.dim == 4:
        assert basis[:, 3].tolist() == [0, 0, 0, *touched.normal.tolist()]


@pytest.mark.parametrize(
    ("model", "scaling"),
    [(MODELS[0], [1]), (MODELS[1], [0.5, 1, 1]), (MODELS[2], [0.5, 1, 1, 50])],
)
def test_cone_scaling(model, scaling):
    assert model.cone_scaling.tolist() == scaling


def test_a_model_is_its_components_and_coefficients():
    for model in MODELS:
        assert model_of(model.dim, model.mu, model.gamma) == model
    assert [model.mu for model in MODELS] == [1.0, 0.5, 0.5]


def test_no_part_of_the_package_branches_on_the_class_of_a_model():
    """But for the file that defines them and the reader that makes them of a file's words."""
    branching = re.compile(r"isinstance\([^)]*\b(FPC|PCWF|SFC)\b|\bcase (FPC|PCWF|SFC)\(")
    package = Path(gf.__file__).parent
    files = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if branching.search(path.read_text(encoding="utf-8"))
    }
    assert files == {"contact.py"}
