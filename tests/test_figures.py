"""Figures 4 to 12: the right numbers from the logs, and those numbers on the axes."""

import dataclasses
import subprocess
import sys
import xml.etree.ElementTree

import numpy as np
import pytest

from graspforce import figures, scenarios
from graspforce._util import plot
from graspforce.contact import SFC
from graspforce.errors import InvalidInputError, MissingExtraError

MU, LIMIT = 0.5, 0.5
BY_NUMBER = {module.NUMBER: module for module in figures.FIGURES}
every_figure = pytest.mark.parametrize("module", figures.FIGURES, ids=lambda m: f"fig{m.NUMBER}")


@pytest.fixture(scope="module")
def sources():
    return {
        "sweep": scenarios.sweep_alpha(),
        "dynamic": scenarios.run(scenarios.dynamic()),
        "regrasp": scenarios.run(scenarios.regrasp()),
    }


@pytest.fixture(scope="module")
def shown(sources):
    return {n: module.data(sources[module.SOURCE]) for n, module in BY_NUMBER.items()}


def residuals(c):
    """mu² n² − x² − y² of every contact, shape (T, n), straight from Eq. (22)."""
    n, x, y = c.reshape(len(c), -1, 3).transpose(2, 0, 1)
    return MU**2 * n**2 - x**2 - y**2


def away(t):
    return (t >= 0.5 - 1e-9) & (t <= 1.5 + 1e-9)


# ---- data() ------------------------------------------------------------------------------------


def test_there_are_nine_figures_in_the_papers_order():
    assert [module.NUMBER for module in figures.FIGURES] == list(range(4, 13))
    for module in figures.FIGURES:
        assert module.__name__.rpartition(".")[2].startswith(f"fig{module.NUMBER:02d}_")


def test_fig04_forces_fall_with_alpha(shown):
    data = shown[4]
    assert data.alpha[0] == pytest.approx(0.01)
    assert data.alpha[-1] == pytest.approx(100)
    assert data.normal_forces.shape == (len(data.alpha), 4)
    assert (np.diff(data.normal_forces, axis=0) < 0).all()
    assert 5 < data.normal_forces[0].min() < data.normal_forces[0].max() < 10.5
    assert 0.8 < data.normal_forces[-1].min() < data.normal_forces[-1].max() < 2.1


def test_fig05_residuals_are_those_of_the_forces(shown, sources):
    data, sweep = shown[5], sources["sweep"]
    np.testing.assert_allclose(data.friction_residual, residuals(sweep.c).min(axis=1), rtol=1e-9)
    margins = LIMIT - np.abs(sweep.tau).max(axis=1)
    np.testing.assert_allclose(data.torque_residual, margins, rtol=0, atol=1e-12)
    assert (np.diff(data.torque_residual) > 0).all()
    assert (np.diff(data.friction_residual) < 0).all()
    assert data.torque_normalised[-1] == data.friction_normalised[0] == 1
    ratio = data.friction_normalised / data.friction_residual
    np.testing.assert_allclose(ratio, ratio[0])


def test_fig05_shares_of_the_variation_are_read_at_a_tenth_and_at_ten():
    alpha = np.logspace(-2, 2, 41)
    straight = 2 + np.log10(alpha)  # changes evenly, so half of it lies between 0.1 and 10
    shown = figures.fig05_residuals_alpha.Data(alpha, straight, 5 - straight, straight, straight)
    numbers = figures.fig05_residuals_alpha.claims(shown)[2].numbers
    assert list(numbers.values()) == pytest.approx([0.5, 0.5])


def test_fig06_to_08_are_the_dynamic_log(shown, sources):
    log = sources["dynamic"]
    for number in (6, 7, 8):
        np.testing.assert_array_equal(shown[number].t, np.arange(500) / 250)
    np.testing.assert_array_equal(shown[6].normal_forces, log.c[:, ::3])
    assert 1.7 < shown[6].normal_forces.min() < shown[6].normal_forces.max() < 4.6
    for k in (0, 137, 499):
        tau = log.scenario.problem(log.t[k]).J.T @ log.c[k]
        assert shown[7].max_torque[k] == pytest.approx(np.abs(tau).max(), abs=1e-12)
    assert 0.17 < shown[7].max_torque.min() < shown[7].max_torque.max() < 0.27
    assert shown[7].limit == LIMIT
    np.testing.assert_allclose(shown[8].friction_residual, residuals(log.c).min(axis=1))
    assert 0.5 < shown[8].friction_residual.min() < shown[8].friction_residual.max() < 2.3


def test_fig09_finger_1_leaves_3_falls_2_and_4_rise(shown):
    data = shown[9]
    gone, before = away(data.t), data.t < 0.25
    assert (data.normal_forces[gone, 0] == 0).all()
    assert (data.normal_forces[~gone] > 0).all()
    change = data.normal_forces[gone].mean(axis=0) - data.normal_forces[before].mean(axis=0)
    assert change[1] > 0
    assert change[2] < -0.5
    assert change[3] > 0


def test_fig09_jump_is_relative_to_the_neighbouring_changes():
    fig09 = figures.fig09_normal_forces_regrasp
    t = np.arange(20.0)
    ramp = np.outer(t, [1.0, 0, 0, 0])
    assert fig09.jump(fig09.Data(t, ramp, np.ones(20)), 10) == pytest.approx(1)
    ramp[10:, 0] += 6  # a change of 7 into tick 10, among changes of 1
    assert fig09.jump(fig09.Data(t, ramp, np.ones(20)), 10) == pytest.approx(7)
    assert fig09.jump(fig09.Data(t, ramp, np.ones(20)), 12) == pytest.approx(1 / 7)


def test_fig10_torque_is_higher_without_finger_1(shown):
    data = shown[10]
    gone = away(data.t)
    assert data.max_torque[gone].mean() > 1.3 * data.max_torque[data.t < 0.25].mean()
    assert data.max_torque.max() < data.limit == LIMIT


def test_fig11_counts_the_fingers_in_the_grasp(shown, sources):
    data, each = shown[11], residuals(sources["regrasp"].c)
    gone = away(data.t)
    np.testing.assert_allclose(data.friction_residual[gone], each[gone, 1:].min(axis=1))
    np.testing.assert_allclose(data.friction_residual[~gone], each[~gone].min(axis=1))
    assert (data.friction_residual > 0).all()


def test_fig12_engagement_is_the_papers_schedule(shown):
    data = shown[12]
    expected = np.interp(data.t, [0.25, 0.5, 1.5, 1.75], [1, 0, 0, 1])
    np.testing.assert_allclose(data.engagement, expected, rtol=0, atol=1e-12)
    assert (data.newton_steps == np.round(data.newton_steps)).all()
    assert data.newton_steps.min() == 1
    assert data.newton_steps.max() <= 6
    assert (data.newton_steps == 1).sum() >= 470
    # Away from the cold start and from w_1 = 0, one step is enough.
    typical = (np.arange(500) >= 2) & ((data.engagement > 0.3) | away(data.t))
    assert data.newton_steps[typical].mean() < 1.05


@every_figure
def test_figures_claims_hold_and_carry_their_numbers(module, shown):
    for claim in module.claims(shown[module.NUMBER]):
        assert claim.holds is True
        assert claim.numbers
        assert all(np.isfinite(value) for value in claim.numbers.values())


def test_figures_claims_say_so_when_they_do_not_hold(shown):
    fig07, fig08 = BY_NUMBER[7], BY_NUMBER[8]
    t = shown[7].t
    assert fig07.claims(fig07.Data(t, np.full(500, 0.49), LIMIT))[0].holds is False
    assert fig08.claims(fig08.Data(t, np.linspace(-0.1, 1, 500)))[0].holds is False
    fig04 = BY_NUMBER[4]
    rising = fig04.Data(shown[4].alpha, shown[4].normal_forces[::-1])
    assert fig04.claims(rising)[0].holds is False


# ---- draw() ------------------------------------------------------------------------------------

LINES = {
    4: lambda d: [(d.alpha, each) for each in d.normal_forces.T],
    5: lambda d: [(d.alpha, d.torque_normalised), (d.alpha, d.friction_normalised)],
    6: lambda d: [(d.t, each) for each in d.normal_forces.T],
    7: lambda d: [(d.t, d.max_torque)],
    8: lambda d: [(d.t, d.friction_residual)],
    9: lambda d: [(d.t, each) for each in d.normal_forces.T],
    10: lambda d: [(d.t, d.max_torque)],
    11: lambda d: [(d.t, d.friction_residual)],
    12: lambda d: [(d.t, d.engagement), (d.t, d.newton_steps)],
}


@every_figure
def test_figures_draw_puts_the_data_on_the_axes(module, shown):
    data = shown[module.NUMBER]
    figure = module.draw(data)
    lines = [line for axes in figure.axes for line in axes.lines if len(line.get_xdata()) > 2]
    expected = LINES[module.NUMBER](data)
    assert len(lines) == len(expected)
    for line, (x, y) in zip(lines, expected, strict=True):
        np.testing.assert_array_equal(line.get_xdata(), x)
        np.testing.assert_array_equal(line.get_ydata(), y)
        low, high = line.axes.get_ylim()
        assert low <= y.min()
        assert y.max() < high


@every_figure
def test_figures_axes_are_labelled_and_legends_are_beside_the_data(module, shown):
    figure = module.draw(shown[module.NUMBER])
    figure.canvas.draw()
    assert figure.axes[-1].get_xlabel() in ("time [s]", "weight α of the limits against the cones")
    if module.NUMBER not in (5, 12):  # those two show pure numbers
        assert "[N" in figure.axes[0].get_ylabel()
    for axes in figure.axes:
        assert axes.get_ylabel()
        if axes.get_legend() is not None:
            legend = axes.get_legend().get_window_extent()
            assert legend.y0 >= axes.get_window_extent().y1
            assert legend.x1 <= figure.bbox.x1


def test_figures_fingers_keep_their_colours_and_dashes(shown):
    looks = {
        number: [
            (line.get_color(), line.get_linestyle(), line.get_label())
            for line in BY_NUMBER[number].draw(shown[number]).axes[0].lines
        ]
        for number in (4, 6, 9)
    }
    assert looks[4] == looks[6] == looks[9]
    assert len({colour for colour, _, _ in looks[4]}) == 4
    assert [label for _, _, label in looks[4]] == [f"finger {i}" for i in (1, 2, 3, 4)]


@pytest.mark.parametrize("number", [9, 10, 11, 12])
def test_figures_the_time_without_finger_1_is_shaded(number, shown):
    for axes in BY_NUMBER[number].draw(shown[number]).axes:
        spans = sorted((patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches)
        edges = [(0.25, 0.5), (0.5, 1.5), (1.5, 1.75)]
        np.testing.assert_allclose(spans, edges, rtol=0, atol=0.0041)  # a tick


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_the_same_figure_is_the_same_bytes(kind, shown):
    first, second = (plot.render(BY_NUMBER[9].draw(shown[9]), kind) for _ in range(2))
    assert first == second
    if kind == "png":
        assert first.startswith(b"\x89PNG\r\n\x1a\n")
    else:
        assert xml.etree.ElementTree.fromstring(first).tag == "{http://www.w3.org/2000/svg}svg"


def test_figures_data_needs_no_matplotlib():
    code = (
        "import sys; from graspforce import figures, scenarios;"
        "figures.fig04_normal_forces_alpha.data(scenarios.sweep_alpha([1.0]));"
        "sys.exit('matplotlib' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_figures_without_matplotlib_the_extra_is_named(monkeypatch, shown):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'matplotlib>="):
        BY_NUMBER[4].draw(shown[4])


# ---- the picture -------------------------------------------------------------------------------


def test_the_picture_shows_the_grasp_at_rest():
    scenario = scenarios.static()
    data = figures.grasp_picture.data(scenario)
    np.testing.assert_allclose(data.forces.sum(axis=0), [0, 0, 0.25 * 9.81], atol=1e-9)
    normal = np.einsum("ij,ij->i", data.forces, data.normals)
    tangent = np.linalg.norm(data.forces - normal[:, None] * data.normals, axis=1)
    assert (tangent < data.mu * normal).all()
    np.testing.assert_allclose(data.joints[:, 2], data.points, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(np.diff(data.joints, axis=1), axis=2), 0.075)
    np.testing.assert_allclose(data.corners.mean(axis=0), [0.025, -0.05, 0.1], atol=1e-12)
    sides = np.linalg.norm(data.corners[[1, 2, 4]] - data.corners[0], axis=1)
    np.testing.assert_allclose(sides, 0.075)


def test_the_picture_is_drawn():
    figure = figures.grasp_picture.draw(figures.grasp_picture.data(scenarios.static()))
    assert len(figure.axes[0].texts) == 4
    assert all(text.get_text().endswith(" N") for text in figure.axes[0].texts)
    assert plot.render(figure, "png").startswith(b"\x89PNG")


def test_the_picture_of_a_finger_out_of_the_grasp_has_no_arrow_of_it():
    shown = figures.grasp_picture.data(scenarios.regrasp(), t=1.0)
    assert not shown.forces[0].any()
    figure = figures.grasp_picture.draw(shown)
    assert len(figure.axes[0].texts) == 3


def test_the_picture_refuses_contacts_whose_cone_it_does_not_draw():
    scenario = scenarios.static()
    contacts = scenario.cube.side_contacts(SFC(0.5, 0.01))
    mixed = dataclasses.replace(scenario, contacts=(*scenario.contacts[:3], contacts[3]))
    with pytest.raises(InvalidInputError, match="scenario: got contacts of model SFC, expected"):
        figures.grasp_picture.data(mixed)
