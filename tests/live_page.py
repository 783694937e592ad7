"""What tests of the live page do in a browser: open pages, turn knobs, drag, look at pixels."""

import time
from contextlib import suppress

import numpy as np
import playwright.sync_api
from viser.transforms import SO3

PATIENCE = 60_000  # [ms]; a page draws slowly without a GPU on a busy machine


def open_tab(browser, url, wait=".gf-verdict"):
    tab = browser.new_page(viewport={"width": 640, "height": 400})
    tab.set_default_timeout(PATIENCE)
    tab.failures = []
    tab.on("pageerror", lambda error: tab.failures.append(str(error)))
    tab.goto(url)
    tab.wait_for_selector(wait)
    return tab


def row(tab, label):
    """Return the row of a knob by its label."""
    return tab.locator(f"label:text-is('{label}')").locator("xpath=ancestor::div[2]")


def enter(tab, label, value, index=-1):
    """Type a number into a knob's field."""
    inputs = row(tab, label).locator("input:not([type=hidden])")
    field = inputs.nth(inputs.count() + index if index < 0 else index)
    field.fill(str(value))
    field.press("Enter")


def choose(tab, label, option):
    """Choose from a list, opened again where an update of the page has closed it."""
    choice = tab.get_by_role("option", name=option, exact=True)

    def opened():
        if not choice.is_visible():
            row(tab, label).locator("input:not([type=hidden])").first.click()
            with suppress(playwright.sync_api.TimeoutError):
                choice.wait_for(timeout=300)
        return choice.is_visible()

    until(opened, f"the choices of {label}")
    choice.click()


def shown(tab, name):
    return tab.locator(f".gf-{name}").first.inner_text().replace("\N{NO-BREAK SPACE}", " ")


def until(condition, what):
    deadline = time.monotonic() + PATIENCE / 1000
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        time.sleep(0.02)


def number(value, unit=""):
    return f"{value:.4g} {unit}".strip()


def session(page, index=0):
    return page.sessions[sorted(page.sessions)[index]]


def picture(tab):
    """Return the left half of what a tab shows, which is the scene's, as a PNG.

    On a busy machine the browser now and then never ends a capture; the next one it does.
    """
    half = {"x": 0, "y": 0, "width": 230, "height": 400}
    for _ in range(3):
        with suppress(playwright.sync_api.TimeoutError):
            return tab.screenshot(clip=half, timeout=PATIENCE / 3)
    return tab.screenshot(clip=half, timeout=PATIENCE)


def pixel(tab, live, point):
    """Return where a page draws a point of the scene."""
    camera, box = live._client.camera, tab.locator("canvas").first.bounding_box()
    x, y, z = SO3(camera.wxyz).as_matrix().T @ (np.asarray(point) - camera.position)
    height = box["height"] / (2 * np.tan(camera.fov / 2))
    return (
        box["x"] + box["width"] / 2 + height * x / z,
        box["y"] + box["height"] / 2 + height * y / z,
    )


def drawn(tab):
    """Wait until a page has drawn anew twice, and so has seen what came before."""
    tab.evaluate(
        "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done())))"
    )


def drag(tab, start, end):
    """Drag from a pixel to another, as slowly as a page without a GPU draws."""
    tab.mouse.move(*start)
    drawn(tab)
    tab.mouse.down()
    drawn(tab)
    tab.mouse.move(*end, steps=4)
    drawn(tab)
    tab.mouse.up()


def clear(tab):
    """Close the browser's notice that it draws in software, which lies over the scene."""
    notice = tab.locator("[class*=Notification] button").first
    notice.click()
    notice.wait_for(state="hidden")


def turquoise(png):
    """Return how many pixels have the colour of another method's forces."""
    import imageio.v3

    r, g, b = np.moveaxis(imageio.v3.imread(png)[..., :3].astype(int), -1, 0)
    return int(((g - r > 40) & (abs(g - b) < 20)).sum())


def is_drawn(png):
    """Tell whether a picture has more on it than a background."""
    import imageio.v3

    pixels = imageio.v3.imread(png)[..., :3].astype(int)
    return pixels.std() > 5 and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 200


def problem_of(subject, knobs):
    return subject.moment(knobs).problem
