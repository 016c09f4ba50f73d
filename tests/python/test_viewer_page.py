"""The live view in a real browser: what its page shows, held against the exact picture by values."""

import json
import time

import deltalux as dl
import numpy as np
import pytest
from browser import launched
from deltalux.io import load_image, to_display

pytest.importorskip("websockets", reason="the live view needs websockets")

HALL = dl.Environment.builtin("hall")


@pytest.fixture(scope="module")
def browser():
    with launched() as browser:
        yield browser


@pytest.fixture(scope="module")
def transport(tmp_path_factory):
    scene = dl.Scene.builtin("cornell")
    scene = scene.with_camera(scene.camera.resized(48, 32))
    path = tmp_path_factory.mktemp("page") / "cornell.transport"
    return dl.precompute(scene, path, columns=dl.Haar(8), progress=False)


@pytest.fixture
def view(transport):
    with dl.view(transport, browser=False, port=0) as view:
        yield view


@pytest.fixture
def opened(browser, view):
    """opened(width): a page of the view, once it shows the exact picture."""
    contexts = []

    def run(width=1280, height=800, **options):
        context = browser.new_context(viewport={"width": width, "height": height}, **options)
        contexts.append(context)
        page = context.new_page()
        page.faults = []
        page.on("pageerror", lambda error: page.faults.append(str(error)))
        page.goto(view.url)
        at_rest(page)
        return page

    yield run
    for context in contexts:
        context.close()


def until(page, expression, seconds=30.0):
    """Waits until an expression is true; the page's policy forbids what playwright would do itself."""
    end = time.monotonic() + seconds
    while not page.evaluate(expression):
        assert time.monotonic() < end, f"{expression} did not come true in {seconds:g} s"
        page.wait_for_timeout(30)


def at_rest(page):
    until(page, "window.deltalux?.frame?.exact === true")


def moved(page, act):
    """Does something that moves the light, and waits until the picture stands again."""
    number = page.evaluate("deltalux.frame.n")
    act()
    until(page, f"deltalux.frame.n > {number} + 1 && deltalux.frame.exact === true")


def layer(page, name="a", shape=(32, 48, 3)):
    """A layer as the page has it, in floats."""
    values = page.evaluate(
        """(name) => {
      const own = deltalux.layers[name];
      const half = (h) => {
        const s = h & 0x8000 ? -1 : 1, e = (h >> 10) & 31, m = h & 1023;
        return s * (e ? 2 ** (e - 15) * (1 + m / 1024) : 2 ** -14 * (m / 1024));
      };
      return Array.from(own, own instanceof Uint16Array ? half : Number);
    }""",
        name,
    )
    return np.array(values, np.float32).reshape(shape)


def exact(view, transport):
    env = view.env
    return transport.image(transport.multiply(transport.coefficients(env)), env)


def holds(page, view, transport):
    """Whether the picture that a page has is the exact one."""
    wanted = exact(view, transport)
    return np.abs(layer(page) - wanted).max() <= 2e-3 * wanted.max()


def test_the_picture_on_the_screen_is_the_exact_one(opened, view, transport):
    page = opened()
    assert holds(page, view, transport) and page.faults == []
    # As the display shows it, pixel by pixel.
    page.select_option("#tone", "srgb")
    page.keyboard.press("Escape")
    if not page.evaluate("deltalux.view.locked"):
        page.click("#auto")
    page.fill("#exposure-number", "0.5")
    page.press("#exposure-number", "Enter")
    page.wait_for_timeout(300)
    shown = np.array(page.evaluate("Array.from(deltalux.readPixels())"), np.uint8).reshape(32, 48, 4)[..., :3]
    wanted = to_display(exact(view, transport), 0.5)
    assert np.abs(shown.astype(int) - wanted).max() <= 2


def shows(page, view, transport, seconds=30.0):
    """Waits until a page has the exact picture of what is set now."""
    end = time.monotonic() + seconds
    while not holds(page, view, transport):
        assert time.monotonic() < end, f"the exact picture did not come in {seconds:g} s"
        page.wait_for_timeout(50)


def test_dragging_the_strip_and_shift_dragging_the_picture_turn_the_light(opened, view, transport):
    page = opened()
    for selector, keys in (("#strip", []), ("#picture", ["Shift"])):
        box = page.locator(selector).bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        before = view.env

        def drag(x=x, y=y, keys=keys):
            for key in keys:
                page.keyboard.down(key)
            page.mouse.move(x, y)
            page.mouse.down()
            page.mouse.move(x + 40, y, steps=5)
            page.mouse.up()
            for key in keys:
                page.keyboard.up(key)

        moved(page, drag)
        assert view.env._layers != before._layers and holds(page, view, transport)
    moved(page, lambda: (page.focus("#strip"), page.keyboard.press("ArrowRight")))
    moved(page, lambda: page.locator("#strip").dispatch_event("wheel", {"deltaY": 100, "bubbles": True}))
    assert holds(page, view, transport) and page.faults == []


def test_another_environment_paint_and_lamps(opened, view, transport):
    page = opened()
    moved(page, lambda: page.click("#thumb-sky"))
    assert view.env.name == "sky" and holds(page, view, transport)
    moved(page, lambda: page.click("#add-sun"))
    assert len(view._relit.lights.groups) == 2
    page.click("#brush")
    box = page.locator("#strip").bounding_box()

    def paint():
        page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 0.6 * box["height"])
        page.mouse.down()
        page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.65 * box["height"], steps=6)
        page.mouse.up()

    moved(page, paint)
    assert sum(len(dabs) for dabs in view._relit.lights.dabs.values()) >= 2
    assert holds(page, view, transport)
    painted = transport.coefficients(view.env)
    (paint_group,) = (group.id for group in view._relit.lights.groups if group.kind == "paint")
    moved(page, lambda: page.click(f"#unpaint-{paint_group}"))
    assert not np.array_equal(transport.coefficients(view.env), painted) and holds(page, view, transport)
    moved(page, lambda: page.keyboard.press("Control+z"))
    assert np.array_equal(transport.coefficients(view.env), painted)
    assert holds(page, view, transport) and page.faults == []


def test_the_wipe_shows_the_exact_picture_on_one_side(opened, view, transport):
    page = opened()
    page.keyboard.press("x")
    until(page, "deltalux.layers.exact !== undefined")
    wanted = exact(view, transport)
    assert np.abs(layer(page, "exact") - wanted).max() <= 2e-3 * wanted.max()
    for key, mode in zip("egbda", ("error", "ghosts", "bound", "difference", "beauty"), strict=True):
        page.keyboard.press(key)
        assert page.evaluate("deltalux.view.mode") == mode
    page.keyboard.press("b")
    until(page, "deltalux.layers.bound !== undefined")
    assert (layer(page, "bound") >= 0).all() and page.faults == []


def test_a_method_that_fails_is_seen_to_fail_frame_by_frame(opened, view):
    page = opened()
    page.select_option("#method-a", "bi")
    page.fill("#amount-a-number", "5")
    page.press("#amount-a-number", "Enter")
    page.click("#freeze")
    page.click("#thumb-sky")
    page.wait_for_timeout(200)
    numbers = []
    for _ in range(3):
        number = page.evaluate("deltalux.frame.n")
        page.click("#step")
        until(page, f"deltalux.frame.n > {number} && deltalux.frame.stats")
        page.wait_for_timeout(150)
        stats = page.evaluate("deltalux.frame.stats?.a ?? null")
        if stats is not None:
            numbers.append(stats["columns"])
    assert numbers and set(numbers) == {5}
    assert view.method == dl.Incremental(terms=5) and page.faults == []


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_at_420_pixels_nothing_overflows_and_all_is_in_the_drawer(opened, view, transport, scheme):
    page = opened(420, 860, color_scheme=scheme)
    assert holds(page, view, transport)
    assert page.evaluate("document.documentElement.scrollWidth") <= 420
    assert page.locator("#strip").is_visible()
    page.click("#drawer")
    assert page.locator("#save-exr").is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 420
    page.set_viewport_size({"width": 1280, "height": 800})
    page.wait_for_timeout(200)
    assert page.locator("#plot-time").is_visible() and page.faults == []


def test_reloading_keeps_the_light_and_lets_the_page_in_again(opened, view, transport):
    page = opened()
    moved(page, lambda: page.click("#thumb-studio"))
    assert view._server.token not in page.url
    page.reload()
    at_rest(page)
    assert page.evaluate("deltalux.state.light.groups[0].source") == "studio"
    assert holds(page, view, transport)


def test_two_pages_move_together_and_one_that_is_killed_harms_nobody(opened, view, transport):
    one, two = opened(), opened()
    moved(one, lambda: one.click("#thumb-sky"))
    shows(two, view, transport)
    assert two.evaluate("deltalux.state.light.groups[0].source") == "sky"
    # In the middle of frames, without a goodbye.
    one.focus("#strip")
    for _ in range(5):
        one.keyboard.press("ArrowRight")
    one.context.set_offline(True)
    one.context.close()
    two.click("#thumb-hall")
    shows(two, view, transport)
    assert two.faults == []


def test_a_wrong_token_is_told_where_the_right_one_is(browser, view):
    page = browser.new_page()
    page.goto(view.url.partition("#")[0] + "#wrong")
    page.wait_for_selector("#refused", state="visible", timeout=10_000)
    assert "address" in page.inner_text("#refused")
    page.close()


def test_files_leave_by_the_page(opened, view, transport, tmp_path):
    page = opened()
    with page.expect_download() as download:
        page.click("#save-exr")
    download.value.save_as(tmp_path / "view.exr")
    _, relighter = view._stage.subject._relighters["a"]
    wanted = transport.image(transport.multiply(relighter.values), view.env)
    assert np.array_equal(load_image(tmp_path / "view.exr")[0], wanted)
    with page.expect_download() as download:
        page.click("#save-session")
    download.value.save_as(tmp_path / "session.json")
    session = json.loads((tmp_path / "session.json").read_text())
    moved(page, lambda: page.click("#thumb-sky"))
    moved(page, lambda: page.set_input_files("#session-file", tmp_path / "session.json"))
    assert session["state"]["light"]["groups"][0]["source"] == "hall" and view.env.name == "hall"
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.click("#copy-python")
    page.wait_for_timeout(500)
    assert "import deltalux" in page.evaluate("navigator.clipboard.readText()")


def test_a_page_by_itself_multiplies_as_numpy_does(browser, tmp_path):
    from deltalux.viewer.export import export

    scene = dl.Scene.builtin("cornell")
    scene = scene.with_camera(scene.camera.resized(32, 24))
    lights = {"hall": HALL, "sky": dl.Environment.builtin("sky")}
    made = export(scene, tmp_path / "page", lights, progress=False)
    assert made.nbytes == sum(own.stat().st_size for own in (tmp_path / "page").iterdir() if own.suffix) < 15e6
    page = browser.new_page()
    faults = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(made.page.as_uri())
    until(page, "window.deltalux?.state.frames > 0 && deltalux.state.left === 0")
    columns = dl.Haar(16)
    for name, env in lights.items():
        V = np.array(page.evaluate(f"Array.from(deltalux.forward(deltalux.cubemap(deltalux.lights.{name}, 0)))"))
        wanted = columns.coefficients(env)
        # The page interpolates maps by itself: to a few percent in wavelets, and to less in pictures.
        assert np.linalg.norm(V.reshape(-1, 3) - wanted) < 0.1 * np.linalg.norm(wanted)
        page.evaluate("(V) => { window.given = Float64Array.from(V); }", wanted.ravel().tolist())
        B = np.array(page.evaluate("Array.from(deltalux.product(window.given))")).reshape(-1, 3)
        transport = dl.precompute(scene, tmp_path / f"{name}.transport", columns=columns, progress=False)
        whole = transport.multiply(wanted)
        off = np.linalg.norm(transport.albedo * (B - whole)) / np.linalg.norm(transport.albedo * whole)
        assert off == pytest.approx(made.errors[name], rel=0.02, abs=1e-5) and off < 0.03
    page.click("#light-sky")
    page.select_option("#method", "bi")
    page.focus("#picture")
    for _ in range(3):
        page.keyboard.press("ArrowLeft")
    until(page, "deltalux.state.left === 0 && deltalux.state.error < 1e-6")
    assert page.evaluate("deltalux.state.turn") == 15 and faults == []
    page.close()
