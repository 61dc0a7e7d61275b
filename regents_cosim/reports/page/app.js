// --- The page: which case is open, at which time; keys; day and night ---

const page = JSON.parse(byId("page").textContent);
readColours();
for (const bar of document.querySelectorAll("[data-left], [data-width]")) {
  // Attributes of style are forbidden by the page's own policy.
  for (const side of ["left", "width"]) if (bar.dataset[side]) bar.style.setProperty(side, `${bar.dataset[side]}%`);
}
const table = new CaseTable(page);
const player = new Player(byId("scene"), showTime);
player.names = page.drivers;
const plots = ["speed", "accel", "gap"].map((name) => new TimePlot(byId(`plot-${name}`), (step) => {
  player.pause();
  player.seek(step);
}));
const grounds = new Map();
document.querySelectorAll("[data-case]").forEach((link) => (link.href = hashOf({ case: link.dataset.case })));
let open = null; // the row of the case that is shown
let scrolled = 0; // where the list was

const asked = () => new URLSearchParams(location.hash.slice(1));

async function route() {
  const parts = asked();
  const row = page.rows.find(({ id }) => id === parts.get("case"));
  if (!row) return showList(parts.get("case"));
  if (document.readyState === "loading") await new Promise((done) => document.addEventListener("DOMContentLoaded", done, { once: true }));
  try {
    if (open !== row) await showCase(row);
  } catch (error) {
    byId("count").textContent = `this browser cannot open the case (${error.message})`; // Safari before 16.4, Firefox before 113
    return;
  }
  if (parts.has("t") && Number.isFinite(Number(parts.get("t")))) player.seek(Math.round(Number(parts.get("t")) / row.dt));
}

function showList(missing) {
  const before = open;
  player.pause();
  open = null;
  byId("case").hidden = true;
  byId("overview").hidden = false;
  table.fit();
  document.title = document.querySelector("h1").textContent + " · crash-test report";
  if (missing) byId("count").textContent = `no case is called ${missing}`;
  if (!before) return;
  scrollTo(0, scrolled);
  table.reveal(before).querySelector("a").focus({ preventScroll: true });
}

async function showCase(row) {
  if (!open) scrolled = scrollY;
  open = row;
  const content = await unpack(`case-${row.index}`);
  if (!grounds.has(row.map)) grounds.set(row.map, new Ground(await unpack(`map-${row.map}`)));
  if (open !== row) return; // another click was faster
  byId("overview").hidden = true;
  byId("case").hidden = false;
  scrollTo(0, 0);
  byId("case-title").textContent = row.id;
  document.title = row.id;
  byId("verdicts").replaceChildren(...row.endings.map((hit, k) => verdict(row, hit, k, content)));
  byId("trouble").textContent = row.errors.filter(Boolean).join("\n");
  byId("trouble").hidden = !byId("trouble").textContent;
  showNeighbours(row);
  player.open(content, row, grounds.get(row.map));
  showLegend(content);
  showPlots(content, row);
  fillSheets(content);
  byId("judgement-title").textContent = page.driven ? `Verdict on the crash of ${row.attacked}` : "Verdict";
  showMarks(row, content);
  showTime();
  byId("scene").focus({ preventScroll: true });
}

function verdict(row, hit, k, { stories, braking }) {
  const who = page.drivers.length > 1 ? [element("b", { className: `driver driver-${k}`, textContent: page.drivers[k] }), " "] : [];
  const how = hit ? [`, impact ${kmh(hit.impact)}. ${stories[k]}`] : [];
  return element("li", {}, ...who, ending(row, k), ...how, ...(hit ? graded(row.verdict[k]) : closeness(row.closest[k])), ...brakes(braking[k]));
}

function graded(words) {
  return words ? [element("span", { className: "graded", textContent: ` ${words}` })] : [];
}

function brakes(words) {
  return words ? [element("span", { className: "braking", textContent: words })] : [];
}

function closeness(closest) {
  if (!closest) return [];
  const { ttc_s: ttc, pet_s: pet, gap_m: gap } = closest;
  const parts = [[ttc, "s to collision"], [pet, "s between passing the same place"], [gap, "m apart"]]
    .filter(([value]) => value !== null).map(([value, words]) => `${value.toFixed(1)} ${words}`);
  return parts.length ? [element("span", { className: "faint", textContent: `, at the closest ${parts.join(", ")}` })] : [];
}

function showNeighbours(row) {
  const rows = table.shown.includes(row) ? table.shown : page.rows;
  const at = rows.indexOf(row);
  byId("position").textContent = `${at + 1} of ${rows.length}`;
  for (const [id, other] of [["previous", rows[at - 1]], ["next", rows[at + 1]]]) {
    if (other) byId(id).href = hashOf({ case: other.id });
    else byId(id).removeAttribute("href");
  }
}

// --- what goes with the player ---

function showLegend(content) {
  const item = (colour, words, look = "") => [element("i", { className: look, style: { "--of": `var(--${colour})` } }), words];
  const sign = (colour, letter, words) => element("span", {}, element("i", { className: "sign", dataset: { sign: letter }, style: { "--of": `var(--${colour})` } }), words);
  const fixed = page.drivers.map((name, k) => element("span", {}, ...item(DRIVERS[k], page.drivers.length > 1 ? name : "ego")));
  const on_foot = content.agents[content.adversary]?.kind === "pedestrian";
  if (content.adversary !== null) fixed.push(element("span", {}, ...item("adversary", on_foot ? "adversary, on foot" : "adversary")));
  fixed.push(element("span", {}, ...item("other", "other traffic")));
  const marked = new Map(content.marks.map(({ kind, colour }) => [kind, colour]));
  if (marked.has("gives_way")) fixed.push(sign(marked.get("gives_way"), "▽", "give way"));
  if (marked.has("breaks_rule")) fixed.push(sign(marked.get("breaks_rule"), "✕", "breaks a rule"));
  if (marked.has("enters_lane")) fixed.push(sign(marked.get("enters_lane"), "❙", "enters the ego's path"));
  if (marked.has("is_seen")) fixed.push(sign("evasion", "○", "a careful driver sees it coming"));
  if (marked.has("evades")) fixed.push(sign("evasion", "❙", "a careful driver acts from here"));
  if (Object.keys(content.signals).length) fixed.push(element("span", {}, ...item("green", "traffic light")));
  if (content.contacts.some(Boolean)) fixed.push(sign("burst", "✹", "collision"));
  const layers = [
    content.log && ["log", ...item("adversary", "without the attack", "dashed")],
    content.evasion && ["evasion", ...item("evasion", "careful driver", "outline")],
    content.debug.some((steps) => Object.keys(steps).length) && ["debug", ...item("second", "what the planner weighs, takes, expects", "outline")],
    ["trails", "paths, a dot each second"],
    ["names", "names and speeds"],
  ].filter(Boolean);
  const toggles = layers.map(([layer, ...children]) => {
    const button = element("button", { type: "button", ariaPressed: String(player.shows(layer)), dataset: { layer } }, ...children);
    button.addEventListener("click", () => {
      player.hidden[player.shows(layer) ? "add" : "delete"](layer);
      button.ariaPressed = String(player.shows(layer));
      player.draw();
    });
    return button;
  });
  byId("legend").replaceChildren(...fixed, ...toggles);
}

function showMarks(row, content) {
  const time = byId("time");
  time.max = player.last;
  const tick = (step, colour, className) => element("i", { className, style: { left: `${(100 * step) / player.last}%`, "--of": `var(--${colour})` } });
  const entries = content.marks.filter(({ kind }) => kind === "enters_lane").map(({ step, colour }) => tick(step, colour, "entry"));
  const hits = row.endings.map((hit, k) => hit && tick(hit.step, page.drivers.length > 1 ? DRIVERS[k] : "adversary", ""));
  byId("marks").replaceChildren(...entries, ...hits.filter(Boolean));
}

function showPlots(content, row) {
  const over = player.evasion || player.driven.some((run) => run.crash === Infinity) ? Infinity : Math.max(...player.runs.map((run) => (Number.isFinite(run.crash) ? run.crash : 0)));
  const adversary = player.adversary === null ? null : player.tracks[player.adversary];
  const each = (of, careful) => [
    ...[...player.log].map(([index, track]) => ({ stretches: of(track), colour: index ? "adversary" : "ego", dashed: true })),
    player.evasion && { stretches: of(player.evasion), colour: "evasion", dashed: true, name: careful },
    adversary && { stretches: of(adversary), colour: "adversary", until: over, name: "adversary" },
    ...player.runs.map((run, k) => ({ stretches: of(run.track), colour: run.colour, until: run.crash, name: page.drivers.length > 1 ? page.drivers[k] : "ego" })).reverse(),
  ].filter(Boolean);
  plots[0].show(each((track) => track.speeds().map((part) => part.map(([step, speed]) => [step, 3.6 * speed])), "careful"), player.last, row.dt);
  plots[1].show(each((track) => track.accelerations(row.dt)), player.last, row.dt);
  plots[2].show([
    { stretches: series(content.gaps.log), colour: "faint", dashed: true },
    { stretches: series(content.gaps.evasion), colour: "evasion", dashed: true },
    ...content.gaps.runs.map((spans, k) => ({ stretches: series(spans), colour: DRIVERS[k], until: player.runs[k].crash, name: page.drivers.length > 1 ? page.drivers[k] : "gap" })).reverse(),
  ], player.last, row.dt);
  byId("plot-gap").parentElement.hidden = player.adversary === null;
  player.costs = content.costs.terms;
}

let saving = 0;
let last = ""; // what the words said

function showTime() {
  if (!open) return;
  const seconds = (player.step * open.dt).toFixed(1);
  plots.forEach((plot) => plot.draw(player.step));
  byId("time").value = Math.round(player.step);
  const said = [open.id, seconds, player.playing, player.camera.following].join();
  if (said !== last) showWords(seconds);
  last = said;
  if (player.playing || player.atRest) return;
  clearTimeout(saving);
  const here = open.id;
  saving = setTimeout(() => {
    // Unless the address says already that the user wants to be elsewhere.
    if (asked().get("case") === here) history.replaceState(null, "", hashOf({ case: here, t: seconds }));
  }, 150); // browsers bound how often
}

// What changes ten times a second at most: laying out words is dear.
function showWords(seconds) {
  byId("clock").textContent = `${seconds} s`;
  byId("time").setAttribute("aria-valuetext", `${seconds} seconds`);
  byId("play").textContent = player.playing ? "❚❚" : "▶";
  byId("play").ariaLabel = player.playing ? "Pause" : "Play";
  byId("follow").ariaPressed = String(player.camera.following);
  plots.forEach((plot, k) => showValues(byId(["speed-now", "accel-now", "gap-now"][k]), plot));
}

function showValues(place, plot) {
  const lines = plot.lines.filter((line) => line.name).reverse();
  const values = lines.map((line) => (player.step <= (line.until ?? Infinity) ? valueAt(line.stretches, player.step) : null));
  if (place.children.length !== lines.length) place.replaceChildren(...lines.map(() => element("span")));
  lines.forEach((line, k) => {
    place.children[k].style.color = `var(--${line.colour}-ink)`;
    place.children[k].textContent = values[k] === null ? "" : `${line.name} ${signed(values[k])}`;
  });
}

// With a true minus, and none before zero.
function signed(value) {
  return value.toFixed(1).replace(/^-0\.0$/, "0.0").replace("-", "−");
}

// --- buttons and keys ---

byId("play").addEventListener("click", () => player.toggle());
byId("step-back").addEventListener("click", () => player.move(-1));
byId("step-on").addEventListener("click", () => player.move(1));
byId("time").addEventListener("input", (event) => player.move(Number(event.target.value) - Math.round(player.step)));
byId("speed").addEventListener("input", (event) => (player.speed = Number(event.target.value)));
byId("zoom-in").addEventListener("click", () => player.zoom(1.3));
byId("zoom-out").addEventListener("click", () => player.zoom(1 / 1.3));
byId("follow").addEventListener("click", () => player.follow(!player.camera.following));
byId("copy").addEventListener("click", () => {
  const link = new URL(location.href);
  link.hash = hashOf({ case: open.id, t: (player.step * open.dt).toFixed(1) });
  copy(link.href, byId("copy"));
});

const second = () => Math.round(1 / open.dt);
const KEYS = {
  " ": () => player.toggle(),
  ",": () => player.move(-1),
  ".": () => player.move(1),
  ArrowLeft: (event) => player.move(event.shiftKey ? -second() : -1),
  ArrowRight: (event) => player.move(event.shiftKey ? second() : 1),
  Home: () => player.move(-Infinity),
  End: () => player.move(Infinity),
  "+": () => player.zoom(1.3),
  "=": () => player.zoom(1.3),
  "-": () => player.zoom(1 / 1.3),
  f: () => player.follow(!player.camera.following),
  "[": () => byId("previous").click(),
  "]": () => byId("next").click(),
  Escape: () => (location.hash = ""),
};

document.addEventListener("keydown", (event) => {
  if (!open || event.ctrlKey || event.metaKey || event.altKey || !(event.key in KEYS)) return;
  const { target } = event;
  if (target.closest("select, input[type=search]")) return;
  if (event.key === " " && target.closest("button, a, summary")) return; // they have a use for it
  event.preventDefault();
  KEYS[event.key](event);
});

function redraw() {
  readColours();
  plots.forEach((plot) => (plot.stale = true));
  if (!open) return;
  player.draw();
  drawCosts(player.costs);
  showTime();
}

byId("theme").addEventListener("click", () => {
  const dark = getComputedStyle(document.documentElement).colorScheme === "dark";
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  redraw();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
addEventListener("resize", () => open && redraw());
addEventListener("hashchange", route);
route();
